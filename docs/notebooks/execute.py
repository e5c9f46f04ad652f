"""Execute the notebooks of this folder and keep what their cells show; no Jupyter is needed to do it.

    python docs/notebooks/execute.py
"""

import ast
import contextlib
import io
import json
import os
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def execute(notebook: dict[str, Any]) -> None:
    """Run the code cells in one namespace and an empty folder; what they print and show replaces their outputs."""
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        for number, cell in enumerate(code, 1):
            cell |= {"execution_count": number, "outputs": _outputs("".join(cell["source"]), names, number)}


def _outputs(source: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    tree, printed, shown = ast.parse(source), io.StringIO(), None
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        if isinstance(last, ast.Expr):
            shown = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": printed.getvalue()})
    if shown is not None:
        data = {"text/plain": repr(shown)}
        if hasattr(shown, "_repr_html_"):
            data = {"text/plain": f"<{type(shown).__name__}>", "text/html": shown._repr_html_()}
        told = {"output_type": "execute_result", "execution_count": number, "metadata": {}}
        outputs.append({**told, "data": data})
    return outputs


def main() -> None:
    """Execute all and write them back."""
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    for file in sorted(HERE.glob("*.ipynb")):
        notebook = json.loads(file.read_text(encoding="utf-8"))
        execute(notebook)
        file.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
