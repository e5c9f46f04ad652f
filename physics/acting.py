"""What acts on the volume of bodies in a quasi-static case: body forces and eigenstrains, body by body."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.loads import Acting, Eigenstrain
from cases.material import Material
from physics.elasticity import MaterialTable


class Acts(NamedTuple):
    """What acts in full at once, and what the load parameter multiplies: arrays, or numbers."""

    constant: Any
    following: Any

    def at(self, load: float) -> Any:
        """Both at a load."""
        return self.constant + load * self.following

    @property
    def is_none(self) -> bool:
        """Nothing acts at any load."""
        return not (np.any(self.constant) or np.any(self.following))


def body_forces(case: Case) -> Acts:
    """Forces per volume (n_bodies, 2) [force/length³]."""
    densities = [case.materials[body.material].density or 0.0 for body in case.bodies.values()]
    acts = Acts(np.zeros((len(densities), 2)), np.zeros((len(densities), 2)))
    for item in case.body_forces:
        for number in _bodies(case, item.on):
            gravity = densities[number] * np.asarray(item.gravity or (0.0, 0.0))
            _part(acts, item)[number] += gravity if item.value is None else item.value
    return acts


def eigenstrains(case: Case) -> Acts:
    """Displacement gradients (n_bodies, 4; xx, xy, yx, yy) of which bodies are free of in-plane stress.

    In plane strain a body that cannot expand out of the plane does so in it, by 1 + nu times its expansion. What the
    stress out of the plane stores then is the same whatever happens in the plane, and drives no crack: it is left out.
    """
    materials = [case.materials[body.material] for body in case.bodies.values()]
    acts = Acts(np.zeros((len(materials), 4)), np.zeros((len(materials), 4)))
    for item in case.eigenstrains:
        for number in _bodies(case, item.on):
            _part(acts, item)[number] += _strain(materials[number], item, case.plane.assumption)
    return acts


class EigenstrainAtPoints:
    """Eigenstrains at points of bodies.

    gradient : (..., 4) of the displacement. stress : (..., 3) what would hold whole material back from it [stress].
    """

    def __init__(self, case: Case, materials: MaterialTable, body: NDArray) -> None:
        """``body`` (...) is the number of each point's body."""
        self.gradient = Acts(*(gradient[body] for gradient in eigenstrains(case)))
        self.stress = Acts(*(eigenstress(materials, gradient, body) for gradient in self.gradient))
        self._is_none = self.gradient.is_none

    def elastic(self, gradient: NDArray, load: float) -> NDArray:
        """What the elastic law acts on: the gradient (..., 4) at a load less the eigenstrain."""
        return gradient if self._is_none else gradient - self.gradient.at(load)

    def heat(self, stress: NDArray, volume: NDArray) -> float:
        """Work of the stress (..., 3) in volumes (...) on the eigenstrain at load factor one [energy]."""
        if self._is_none:
            return 0.0
        return float((work_density(stress, self.gradient.following) * volume).sum())


def eigenstress(materials: MaterialTable, gradient: NDArray, body: NDArray) -> NDArray:
    """Stress (..., 3) that holds whole material of bodies (...) back from a gradient (..., 4) [stress]."""
    strain = np.stack([gradient[..., 0], gradient[..., 3], gradient[..., 1] + gradient[..., 2]], axis=-1)
    return np.einsum("...ij,...j->...i", materials.stiffness[body], strain)


def work_density(stress: NDArray, gradient: NDArray) -> NDArray:
    """Work (...) of stresses (..., 3) on displacement gradients (..., 4) [stress]."""
    xx, xy, yx, yy = np.moveaxis(gradient, -1, 0)
    return stress[..., 0] * xx + stress[..., 1] * yy + stress[..., 2] * (xy + yx)


def _strain(material: Material, item: Eigenstrain, assumption: str) -> NDArray:
    if item.value is not None:
        return np.ravel(item.value)
    held = material.poisson_ratio if assumption == "strain" else 0.0
    return (1.0 + held) * (material.expansion or 0.0) * (item.temperature or 0.0) * np.array([1.0, 0.0, 0.0, 1.0])


def _bodies(case: Case, on: str | None) -> list[int]:
    return [number for number, name in enumerate(case.bodies) if on in (None, name)]


def _part(acts: Acts, item: Acting) -> NDArray:
    return acts.following if item.follows_load else acts.constant
