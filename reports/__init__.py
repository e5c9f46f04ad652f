"""Figures and the HTML report of judged cases: a view of ``summary.json`` and the run folders."""

from .report import write_report, write_surface

__all__ = ["write_report", "write_surface"]
