"""Descriptions of cases: what is modelled, in which units, how it is loaded, solved and judged."""

from cases.case import Case
from cases.errors import CaseError, UserError
from cases.json_schema import schema_text, write_schema
from cases.judging import TIERS, Check, Reference, RunSpec
from cases.loader import case_at, case_from_tables, list_cases, load_case, of_its_file

__all__ = [
    "TIERS",
    "Case",
    "CaseError",
    "Check",
    "Reference",
    "RunSpec",
    "UserError",
    "case_at",
    "case_from_tables",
    "list_cases",
    "load_case",
    "of_its_file",
    "schema_text",
    "write_schema",
]
