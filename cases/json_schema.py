"""JSON Schema of case.toml, for editors that complete and check keys while one writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cases.schema import CaseDescription

SCHEMA_FILE = Path(__file__).parent / "case.schema.json"


def case_schema() -> dict[str, Any]:
    """JSON Schema of a case.toml."""
    return CaseDescription.model_json_schema(mode="validation")


def schema_text() -> str:
    """The schema as it is written to `SCHEMA_FILE`."""
    return json.dumps(case_schema(), indent=2, ensure_ascii=False) + "\n"


def write_schema(path: Path = SCHEMA_FILE) -> None:
    """Write the schema to a file."""
    path.write_text(schema_text(), encoding="utf-8")
