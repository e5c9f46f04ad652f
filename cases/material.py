"""Materials: one elastic pair, resolved to the Lamé constants, or a stiffness; and an optional fracture model."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from cases.errors import BrokenRuleError
from cases.splits import ANISOTROPIC_SPLITS, SplitName
from cases.table import Table
from cases.units import Angle, Density, Length, Number, Stress, Toughness

_PAIRS = (
    ("young", "poisson"),
    ("lame_lambda", "shear_modulus"),
    ("bulk_modulus", "shear_modulus"),
    ("young", "shear_modulus"),
)
_CONSTANTS = ("young", "poisson", "lame_lambda", "shear_modulus", "bulk_modulus")

Modulus = Annotated[Stress, Field(gt=0)]


class Gamma(Table):
    """Fourth-order term of the crack density in the material's axes, dimensionless (Eq. 5.5).

    It is the symmetric matrix of a quadratic form of (c,11, c,22, c,12), the mixed derivative counted once, so that
    γ_θ is that of Eq. 5.9. The default is isotropic with γ_s = 1 (Eq. 5.13).
    """

    gamma_1111: Number
    gamma_2222: Number
    gamma_1122: Number = 0.0
    gamma_1212: Number = 0.0
    gamma_1112: Number = 0.0
    gamma_2212: Number = 0.0

    @model_validator(mode="after")
    def _is_an_energy(self) -> Gamma:
        matrix = self.matrix()
        if np.linalg.eigvalsh(matrix).min() < -_ROUND_OFF * np.abs(matrix).max(initial=1.0):
            remedy = "choose entries whose matrix has no negative eigenvalue"
            raise BrokenRuleError("has a negative energy for some curvatures of the phase field", remedy)
        return self

    def matrix(self) -> NDArray[np.float64]:
        """The matrix (3, 3) of Eq. 5.5."""
        return np.array(
            [
                [self.gamma_1111, self.gamma_1122, self.gamma_1112],
                [self.gamma_1122, self.gamma_2222, self.gamma_2212],
                [self.gamma_1112, self.gamma_2212, self.gamma_1212],
            ]
        )


# Share of the largest entry by which an eigenvalue of zero may miss it.
_ROUND_OFF = 1e-12
_ISOTROPIC = {"gamma_1111": 1.0, "gamma_2222": 1.0, "gamma_1122": 0.5, "gamma_1212": 1.0}


class Fracture(Table):
    """Phase-field fracture of a material.

    Attributes
    ----------
    toughness : Gc [force/length], the factor of the crack density; to open a unit area of crack takes Gc at
        order 2 and Gc sqrt(1 + sqrt(γ_θ)) at order 4
    length_scale : l0 of the crack density Gc [(c-1)²/(4 l0) + l0 |∇c|² + l0³ γ_ijkl c,ij c,kl] [length]; never
        derived from the mesh
    residual_stiffness : k_f in the degradation g(c) = (1 - k_f) c² + k_f, dimensionless
    split : how the elastic energy is divided into a part that drives the crack and one that does not; "orthogonal"
        parts the strain by the principal values of C^(1/2) strain, for any stiffness C, in quasi-static cases;
        "spectral" takes the principal strains of the plane, "spectral_plane_stress" the third one with them
    functional : of Ambrosio and Tortorelli: "AT2" with the crack density above; "AT1" with Gc [3 (1-c)/(16 l0) +
        3/4 l0 |∇c|²], below whose threshold c stays 1, in quasi-static cases of order 2
    order : of the equation for the phase field; 4 has the last term of the crack density, 2 has not
    gamma : that term, only with order 4
    orientation : of the material's axis 1, counter-clockwise from the x axis [degrees], only with order 4
    """

    toughness: Annotated[Toughness, Field(gt=0)]
    length_scale: Annotated[Length, Field(gt=0)]
    residual_stiffness: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    split: SplitName = "spectral"
    functional: Literal["AT1", "AT2"] = "AT2"
    order: Literal[2, 4] = 2
    gamma: Gamma = Field(default_factory=lambda: Gamma(**_ISOTROPIC))
    orientation: Angle = 0.0

    @model_validator(mode="after")
    def _has_the_order_of_its_terms(self) -> Fracture:
        for key in ("gamma", "orientation"):
            if self.order == 2 and key in self.model_fields_set:
                raise BrokenRuleError("has no effect with order 2", "set order = 4 or remove it", key)
        if self.order == 4 and self.functional == "AT1":
            raise BrokenRuleError("is of order 2", 'set order = 2, or give "AT2"', "functional", self.functional)
        return self


class Stiffness(Table):
    """In-plane stiffness of an anisotropic material in its own axes: entries of the matrix, or engineering constants.

    The matrix takes the strains 11, 22 and engineering 12 to the stresses 11, 22, 12. Engineering constants are those
    of an orthotropic material in plane stress; plane strain needs the entries.

    Attributes
    ----------
    C11, C22, C66, C12, C16, C26 : entries of the symmetric, positive definite matrix [stress]
    young_1, young_2 : moduli of tension along the axes 1 and 2 [stress]
    poisson_12 : contraction along axis 2 under tension along axis 1, over the extension
    shear_modulus_12 : [stress]
    orientation : of the material's axis 1, counter-clockwise from the x axis [degrees]
    """

    C11: Modulus | None = None
    C22: Modulus | None = None
    C66: Modulus | None = None
    C12: Stress | None = None
    C16: Stress | None = None
    C26: Stress | None = None
    young_1: Modulus | None = None
    young_2: Modulus | None = None
    poisson_12: Number | None = None
    shear_modulus_12: Modulus | None = None
    orientation: Angle = 0.0

    @model_validator(mode="after")
    def _is_positive_definite(self) -> Stiffness:
        given = {name for name in (*_ENTRIES, *_ENGINEERING) if getattr(self, name) is not None}
        if given != set(_ENGINEERING) and not set(_NEEDED_ENTRIES) <= given <= set(_ENTRIES):
            remedy = f"give {', '.join(_NEEDED_ENTRIES)} (and C16, C26), or else {', '.join(_ENGINEERING)}"
            raise BrokenRuleError(f"has the constants {', '.join(sorted(given)) or '(none)'}", remedy)
        if self.is_engineering:
            self._has_a_stable_poisson_ratio()
        matrix = self.matrix()
        if np.linalg.eigvalsh(matrix).min() <= _ROUND_OFF * np.abs(matrix).max():
            raise BrokenRuleError("is not positive definite", "choose entries that give every strain a positive energy")
        return self

    def _has_a_stable_poisson_ratio(self) -> None:
        assert self.young_1 is not None and self.young_2 is not None and self.poisson_12 is not None
        if self.poisson_12**2 * self.young_2 >= self.young_1:
            bound = (self.young_1 / self.young_2) ** 0.5
            remedy = f"keep its size below sqrt(young_1 / young_2) = {bound:.6g}"
            raise BrokenRuleError("makes the stiffness indefinite", remedy, "poisson_12", self.poisson_12)

    @property
    def is_engineering(self) -> bool:
        """Given by engineering constants, which hold in plane stress only."""
        return self.young_1 is not None

    def matrix(self) -> NDArray[np.float64]:
        """Matrix (3, 3) from strains 11, 22, engineering 12 to stresses 11, 22, 12 [stress]."""
        if self.is_engineering:
            e1, e2, nu, shear = (getattr(self, name) for name in _ENGINEERING)
            compliance = np.array([[1 / e1, -nu / e1, 0.0], [-nu / e1, 1 / e2, 0.0], [0.0, 0.0, 1 / shear]])
            return np.linalg.inv(compliance)
        c11, c22, c66, c12, c16, c26 = (getattr(self, name) or 0.0 for name in _ENTRIES)
        return np.array([[c11, c12, c16], [c12, c22, c26], [c16, c26, c66]])


_ENTRIES = ("C11", "C22", "C66", "C12", "C16", "C26")
_NEEDED_ENTRIES = _ENTRIES[:4]
_ENGINEERING = ("young_1", "young_2", "poisson_12", "shear_modulus_12")


class Material(Table):
    """Linear elastic material.

    Either exactly one pair of isotropic constants is given (young + poisson, lame_lambda + shear_modulus, bulk_modulus +
    shear_modulus or young + shear_modulus), or the stiffness of an anisotropic material. The resolved constants `lam`,
    `mu`, `young_modulus`, `poisson_ratio` of an isotropic one are those of three dimensions; plane stress is a matter of
    the law, not of the material. `expansion` is the strain that a change of temperature by one kelvin gives [1/kelvin].
    """

    young: Modulus | None = None
    poisson: Annotated[Number, Field(gt=-1, lt=0.5)] | None = None
    lame_lambda: Stress | None = None
    shear_modulus: Modulus | None = None
    bulk_modulus: Modulus | None = None
    stiffness: Stiffness | None = None
    density: Annotated[Density, Field(gt=0)] | None = None
    expansion: Number | None = None
    fracture: Fracture | None = None

    @model_validator(mode="after")
    def _has_one_stable_law(self) -> Material:
        given = {name for name in _CONSTANTS if getattr(self, name) is not None}
        if self.stiffness is not None:
            self._has_the_split_of_its_stiffness(given)
            return self
        if given not in map(set, _PAIRS):
            remedy = f"give exactly one pair: {', '.join(map(' + '.join, _PAIRS))}; or the table stiffness"
            raise BrokenRuleError(f"has the elastic constants {', '.join(sorted(given)) or '(none)'}", remedy)
        if not -1.0 < self.poisson_ratio < 0.5:
            key = next(name for name in ("lame_lambda", "bulk_modulus", "young") if name in given)
            text = f"with shear_modulus = {self.shear_modulus} gives Poisson's ratio {self.poisson_ratio:.6g}"
            remedy = "choose moduli whose Poisson's ratio is between -1 and 0.5"
            raise BrokenRuleError(text, remedy, key, getattr(self, key))
        return self

    def _has_the_split_of_its_stiffness(self, isotropic: set[str]) -> None:
        if isotropic:
            text = f"stands beside {', '.join(sorted(isotropic))}"
            raise BrokenRuleError(text, "remove it, or the isotropic constants", "stiffness")
        if self.fracture is not None and self.fracture.split not in ANISOTROPIC_SPLITS:
            text = "is a split of isotropic materials, beside a stiffness"
            raise BrokenRuleError(text, 'give "orthogonal" or "none"', "fracture.split", self.fracture.split)

    @property
    def is_anisotropic(self) -> bool:
        """Its elasticity has a direction."""
        return self.stiffness is not None

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
