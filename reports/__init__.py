"""Figures and the HTML report of judged cases: a view of ``summary.json`` and the run folders."""

from .charts import draw_chart
from .judging import judge
from .maps import draw_map
from .report import write_report, write_surface
from .style import drawing_style

__all__ = ["draw_chart", "draw_map", "drawing_style", "judge", "write_report", "write_surface"]
