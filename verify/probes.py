"""Measurements for maps that need no run: small clouds and matrices, judged by what theory says of them."""

from collections.abc import Callable
from typing import Any

#: (case, levels by name) -> a verdict of `verify.stability`
PROBES: dict[str, Callable[..., Any]] = {}
