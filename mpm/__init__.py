"""The phase-field Material Point Method."""

from mpm.describe import describe
from mpm.explicit.solver import ExplicitMaterialPoints
from mpm.quasi_static.solver import MaterialPoints
from mpm.remarks import remarks

__all__ = ["ExplicitMaterialPoints", "MaterialPoints", "describe", "remarks"]
