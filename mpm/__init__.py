"""The phase-field Material Point Method."""

from .solver import MaterialPoints

__all__ = ["MaterialPoints"]
