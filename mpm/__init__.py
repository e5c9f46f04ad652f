"""The phase-field Material Point Method."""

from mpm.describe import describe
from mpm.explicit.solver import ExplicitMaterialPoints
from mpm.quasi_static.solver import MaterialPoints

__all__ = ["ExplicitMaterialPoints", "MaterialPoints", "describe"]
