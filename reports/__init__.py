"""Figures and the HTML report of judged cases: a view of ``summary.json`` and the run folders."""

from .report import write_report

__all__ = ["write_report"]
