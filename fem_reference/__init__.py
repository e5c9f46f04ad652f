"""The reference solver: phase-field finite elements on scikit-fem meshes."""

from .solver import FiniteElements

__all__ = ["FiniteElements"]
