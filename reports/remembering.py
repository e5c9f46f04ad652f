"""Matplotlib without its repetitions: while a figure is written, nothing in it changes but the places of its axes."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from matplotlib.axis import Axis
from matplotlib.text import Text

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def remembered_layout() -> Iterator[None]:
    """Keep the ticks of an axis while its place and limits stay, and the sizes of texts, that are asked for ten times."""
    update_ticks, text_layout = Axis._update_ticks, Text._get_layout
    ticks: dict[Axis, tuple[Any, list[Any]]] = {}
    sizes: dict[Any, Any] = {}

    def remembered_ticks(axis: Axis) -> list[Any]:
        place = (*axis.axes.bbox.bounds, *axis.get_view_interval(), axis.get_figure(root=True).dpi)
        kept = ticks.get(axis)
        if kept is None or kept[0] != place:
            kept = ticks[axis] = place, update_ticks(axis)
        return kept[1]

    def remembered_size(text: Text, renderer: Any) -> Any:
        look = (
            text.get_text(), hash(text.get_fontproperties()), text.get_rotation(), text.get_ha(), text.get_va(),
            text.get_rotation_mode(), text._linespacing, text._multialignment, text.get_figure(root=True).dpi,
            text.get_parse_math(), text.get_usetex(),
        )  # fmt: skip
        if text.get_wrap() or text.get_transform_rotates_text():
            return text_layout(text, renderer)
        if look not in sizes:
            sizes[look] = text_layout(text, renderer)
        return sizes[look]

    Axis._update_ticks, Text._get_layout = remembered_ticks, remembered_size
    try:
        yield
    finally:
        Axis._update_ticks, Text._get_layout = update_ticks, text_layout
