"""The energy release rate from stress and displacement gradient at integration points (domain integral).

Rice's integral along a contour C around the tip, with outward normal n and crack direction e,

    J = int_C [ W (e . n) - n . sigma . (grad u e) ] ds,

is turned into an integral over the area between that contour, where a weight q is 1, and an outer one,
where q is 0. The flux P_j = W e_j - sigma_ij u_i,k e_k has no divergence in equilibrium, and the area's
outward normal on C is -n, so

    J = - int_A P_j q,j dA = int_A ( sigma_ij u_i,k e_k - W e_j ) q,j dA

(Li, Shih & Needleman 1985, doi 10.1016/0013-7944(85)90029-3), which is positive for a crack that opens. Faces
of the crack must be parallel to e where they cross the area. Tractions t on them add

    - int_faces t_i u_i,k e_k q ds

(Shih, Moran & Nakamura 1986, doi 10.1007/BF00034019), and so do forces b per volume over the area. Nothing here tells
of inertia.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def energy_release_rate(
    points: ArrayLike,
    volume: ArrayLike,
    thickness: float,
    stress: ArrayLike,
    gradient: ArrayLike,
    energy_density: ArrayLike,
    tip: ArrayLike,
    inner: float | ArrayLike,
    outer: float | ArrayLike,
    direction: ArrayLike = (1.0, 0.0),
) -> float:
    """Energy release rate J of a straight crack [force / length], by the domain integral above.

    points : (n, 2) reference positions. volume : (n,) [length^2 * thickness].
    stress : (n, 3), Voigt xx, yy, xy. gradient : (n, 4) ux,x ux,y uy,x uy,y. energy_density : (n,) [stress].
    tip : (2,). direction : (2,) of crack growth.
    inner, outer : half sizes (of a square, or in x and y) of the boxes around the tip in which q = 1 and
        outside which q = 0. The body must fill the outer box but for the crack.

    Raises ValueError when the boxes do not enclose one another or no point lies between them.
    """
    points, stress, gradient = (np.asarray(values, dtype=float) for values in (points, stress, gradient))
    weight_gradient = _weight_gradient(points - np.asarray(tip, dtype=float), inner, outer)
    if not weight_gradient.any():
        raise ValueError("no integration point lies between the inner and the outer box; enlarge outer")
    e = np.asarray(direction, dtype=float)
    e = e / np.linalg.norm(e)
    u_along = np.column_stack([gradient[:, :2] @ e, gradient[:, 2:4] @ e])  # u_i,k e_k
    tensor = stress[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
    traction = np.einsum("pij,pi->pj", tensor, u_along)
    flux = traction - np.asarray(energy_density, dtype=float)[:, None] * e
    area = np.asarray(volume, dtype=float) / thickness
    return float(np.sum(area * np.sum(flux * weight_gradient, axis=1)))


def release_rate_of_faces(
    offset: ArrayLike, length: ArrayLike, traction: ArrayLike, gradient: ArrayLike, inner: float, outer: float,
    direction: ArrayLike,
) -> float:  # fmt: skip
    """What tractions on the faces, or forces per volume, add to the energy release rate [force / length].

    offset : (n, 2) from the tip to places on the faces. length : (n,) of the face, or area, that each stands for.
    traction : (n, 2) [stress, or force / volume]. gradient : (n, 4), and the rest, as for `energy_release_rate`.
    """
    slope = np.asarray(gradient, dtype=float).reshape(-1, 2, 2) @ (np.asarray(direction) / np.linalg.norm(direction))
    weight = np.prod(_fall(np.asarray(offset, dtype=float), inner, outer)[0], axis=1)
    return -float(np.sum(np.asarray(length) * weight * np.sum(np.asarray(traction) * slope, axis=1)))


def _weight_gradient(offset: Array, inner: float | ArrayLike, outer: float | ArrayLike) -> Array:
    """Gradient (n, 2) of q = s(x) s(y)."""
    s, slope = _fall(offset, inner, outer)
    return slope * s[:, ::-1]


def _fall(offset: Array, inner: float | ArrayLike, outer: float | ArrayLike) -> tuple[Array, Array]:
    """s (n, 2), which falls from 1 to 0 between the boxes as a smooth cubic, and its slope (n, 2)."""
    inner, outer = np.broadcast_to(inner, 2), np.broadcast_to(outer, 2)
    if not (np.all(inner > 0) and np.all(outer > inner)):
        raise ValueError(f"the boxes need 0 < inner < outer, but inner = {inner}, outer = {outer}")
    t = np.clip((np.abs(offset) - inner) / (outer - inner), 0.0, 1.0)
    s = 1.0 - t**2 * (3.0 - 2.0 * t)
    return s, -6.0 * t * (1.0 - t) / (outer - inner) * np.sign(offset)
