"""The phase-field Material Point Method."""

from .explicit import ExplicitMaterialPoints
from .solver import MaterialPoints

__all__ = ["ExplicitMaterialPoints", "MaterialPoints"]
