"""The notebooks of the documentation run, and what they show is kept in them."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "docs" / "notebooks"
SHOWN = {"first_run": "complete", "own_mesh": "name one of steel, glue", "own_result": "phasefieldx"}


def shown(notebook: dict[str, Any]) -> str:
    return json.dumps([cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"], ensure_ascii=False)


def test_all_notebooks_are_tried() -> None:
    assert {file.stem for file in FOLDER.glob("*.ipynb")} == SHOWN.keys()


@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_runs_and_shows_what_it_says(name: str) -> None:
    spec = importlib.util.spec_from_file_location("execute", FOLDER / "execute.py")
    assert spec is not None and spec.loader is not None
    execute = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(execute)
    notebook = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    kept = shown(notebook)
    execute.execute(notebook)
    for found in (kept, shown(notebook)):
        assert SHOWN[name] in found and "<svg" in found
