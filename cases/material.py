"""Materials: one elastic pair, resolved to the Lamé constants, and an optional fracture model."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cases.errors import BrokenRuleError
from cases.table import Table
from cases.units import Density, Length, Number, Stress, Toughness

_PAIRS = (
    ("young", "poisson"),
    ("lame_lambda", "shear_modulus"),
    ("bulk_modulus", "shear_modulus"),
    ("young", "shear_modulus"),
)
_CONSTANTS = ("young", "poisson", "lame_lambda", "shear_modulus", "bulk_modulus")

Modulus = Annotated[Stress, Field(gt=0)]


class Fracture(Table):
    """Phase-field fracture of a material.

    Attributes
    ----------
    toughness : Gc, energy to open a unit area of crack [force/length]
    length_scale : l0 of the crack density Gc [(c-1)²/(4 l0) + l0 |∇c|²] [length]; never derived from the mesh
    residual_stiffness : k_f in the degradation g(c) = (1 - k_f) c² + k_f, dimensionless
    split : how the elastic energy is divided into a part that drives the crack and one that does not
    """

    toughness: Annotated[Toughness, Field(gt=0)]
    length_scale: Annotated[Length, Field(gt=0)]
    residual_stiffness: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    split: Literal["spectral", "volumetric_deviatoric", "none"] = "spectral"


class Material(Table):
    """Isotropic linear elastic material.

    Exactly one pair is given: young + poisson, lame_lambda + shear_modulus, bulk_modulus + shear_modulus or
    young + shear_modulus. The resolved constants `lam`, `mu`, `young_modulus`, `poisson_ratio` are those of
    three dimensions; plane stress is a matter of the law, not of the material.
    """

    young: Modulus | None = None
    poisson: Annotated[Number, Field(gt=-1, lt=0.5)] | None = None
    lame_lambda: Stress | None = None
    shear_modulus: Modulus | None = None
    bulk_modulus: Modulus | None = None
    density: Annotated[Density, Field(gt=0)] | None = None
    fracture: Fracture | None = None

    @model_validator(mode="after")
    def _has_one_stable_pair(self) -> Material:
        given = {name for name in _CONSTANTS if getattr(self, name) is not None}
        if given not in map(set, _PAIRS):
            remedy = f"give exactly one pair: {', '.join(map(' + '.join, _PAIRS))}"
            raise BrokenRuleError(f"has the elastic constants {', '.join(sorted(given)) or '(none)'}", remedy)
        if not -1.0 < self.poisson_ratio < 0.5:
            key = next(name for name in ("lame_lambda", "bulk_modulus", "young") if name in given)
            text = f"with shear_modulus = {self.shear_modulus} gives Poisson's ratio {self.poisson_ratio:.6g}"
            remedy = "choose moduli whose Poisson's ratio is between -1 and 0.5"
            raise BrokenRuleError(text, remedy, key, getattr(self, key))
        return self

    @property
    def mu(self) -> float:
        """Shear modulus, the second Lamé constant [stress]."""
        if self.shear_modulus is not None:
            return self.shear_modulus
        assert self.young is not None and self.poisson is not None
        return self.young / (2.0 * (1.0 + self.poisson))

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio, dimensionless."""
        if self.poisson is not None:
            return self.poisson
        if self.young is not None:
            return self.young / (2.0 * self.mu) - 1.0
        if self.bulk_modulus is not None:
            return (3.0 * self.bulk_modulus - 2.0 * self.mu) / (2.0 * (3.0 * self.bulk_modulus + self.mu))
        assert self.lame_lambda is not None
        total = self.lame_lambda + self.mu
        return self.lame_lambda / (2.0 * total) if total else -float("inf")

    @property
    def lam(self) -> float:
        """First Lamé constant of three dimensions [stress]."""
        if self.lame_lambda is not None:
            return self.lame_lambda
        if self.bulk_modulus is not None:
            return self.bulk_modulus - 2.0 * self.mu / 3.0
        return 2.0 * self.mu * self.poisson_ratio / (1.0 - 2.0 * self.poisson_ratio)

    @property
    def young_modulus(self) -> float:
        """Young's modulus [stress]."""
        return self.young if self.young is not None else 2.0 * self.mu * (1.0 + self.poisson_ratio)
