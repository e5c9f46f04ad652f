"""The reference solver: phase-field finite elements on scikit-fem meshes."""

from fem_reference.describe import describe
from fem_reference.explicit.solver import ExplicitFiniteElements
from fem_reference.quasi_static.solver import FiniteElements

__all__ = ["ExplicitFiniteElements", "FiniteElements", "describe"]
