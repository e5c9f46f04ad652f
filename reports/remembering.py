"""Matplotlib without its repetitions: while a figure is written, nothing in it changes but the places of its axes."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import matplotlib
from matplotlib.axis import Axis
from matplotlib.text import Text

if TYPE_CHECKING:
    from collections.abc import Iterator

#: the one version whose inner methods are known
KNOWN = "3.11."


@contextmanager
def remembered_layout() -> Iterator[None]:
    """Within it the ticks of an axis, while its place and limits stay, and the size of each text are found once.

    Matplotlib asks for both some ten times a figure, half of the time that a figure takes. Another version than the
    pinned one is left as it is.
    """
    if not matplotlib.__version__.startswith(KNOWN):
        yield
        return
    axes: Any = Axis
    texts: Any = Text
    ticks_of, size_of = axes._update_ticks, texts._get_layout
    ticks: dict[Any, tuple[Any, Any]] = {}
    sizes: dict[Any, Any] = {}

    def remembered_ticks(axis: Any) -> Any:
        place = (*axis.axes.bbox.bounds, *axis.get_view_interval(), axis.get_figure(root=True).dpi)
        if axis not in ticks or ticks[axis][0] != place:
            ticks[axis] = place, ticks_of(axis)
        return ticks[axis][1]

    def remembered_size(text: Any, renderer: Any) -> Any:
        if text.get_wrap() or text.get_transform_rotates_text():  # theirs depends on their place
            return size_of(text, renderer)
        look = (
            text.get_text(), hash(text.get_fontproperties()), text.get_rotation(), text.get_rotation_mode(),
            text.get_ha(), text.get_va(), text._multialignment, text._linespacing, text.get_parse_math(),
            text.get_usetex(), text.get_figure(root=True).dpi,
        )  # fmt: skip
        if look not in sizes:
            sizes[look] = size_of(text, renderer)
        return sizes[look]

    axes._update_ticks, texts._get_layout = remembered_ticks, remembered_size
    try:
        yield
    finally:
        axes._update_ticks, texts._get_layout = ticks_of, size_of
