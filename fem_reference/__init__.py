"""The reference solver: phase-field finite elements on scikit-fem meshes."""

from .explicit import ExplicitFiniteElements
from .solver import FiniteElements

__all__ = ["ExplicitFiniteElements", "FiniteElements"]
