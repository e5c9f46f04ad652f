"""The elastic laws that compiled loops call: of isotropic bodies by their split, of all others by the root of C."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from math import nan

import numpy as np
from numba import njit, types
from numba.extending import overload
from numpy.typing import NDArray

from physics.elasticity import Law
from physics.point_response import PointResponse
from physics.splits import SPLIT_CODES, Response


@njit(cache=True, forceinline=True)
def _unknown_response(split, g, exx, eyy, gxy, lam, mu):
    """Not a number, which stops a run, where another law would pass for the one wanted."""
    return PointResponse(nan, nan, nan, nan, nan, nan, nan, nan, nan, nan, nan)


def _first_or(code: int, first: Response, otherwise: Response) -> Response:
    @njit(forceinline=True)
    def either(split, g, exx, eyy, gxy, lam, mu):
        """The first law if the split has its code, or else what follows."""
        if split == code:
            return first(g, exx, eyy, gxy, lam, mu)
        return otherwise(split, g, exx, eyy, gxy, lam, mu)

    return either


def one_of(laws: Mapping[int, Response]) -> Response:
    """The compiled function (split, g, exx, eyy, gxy, lam, mu) -> PointResponse by the law whose code is ``split``."""
    chosen: Response = _unknown_response
    for code, response in laws.items():
        chosen = _first_or(code, response, chosen)
    return chosen


#: the laws by their codes
LAWS = {code: import_module(f"physics.splits.{name}").response for name, code in SPLIT_CODES.items()}
#: energies, stress and consistent tangent at one point, arguments as in `one_of` and `physics.splits`
point_response = one_of(LAWS)
#: the laws as parts of the loops that call them
_INLINED = {code: njit(forceinline=True, error_model="numpy")(law.py_func) for code, law in LAWS.items()}


def inlined_response(split, g, exx, eyy, gxy, lam, mu):
    """``point_response`` as part of a compiled loop that knows the split and may take several points at once then."""
    return point_response(split, g, exx, eyy, gxy, lam, mu)


@overload(inlined_response, jit_options={"forceinline": True, "error_model": "numpy"})
def _known_response(split, g, exx, eyy, gxy, lam, mu):
    if not isinstance(split, types.IntegerLiteral):
        return None
    law = _INLINED[split.literal_value]
    return lambda split, g, exx, eyy, gxy, lam, mu: law(g, exx, eyy, gxy, lam, mu)


@njit(cache=True, forceinline=True)
def _tangent_times(r, x, y, s):
    """Product (xx, yy, xy) of the tangent with a strain."""
    return r.d00 * x + r.d01 * y + r.d02 * s, r.d01 * x + r.d11 * y + r.d12 * s, r.d02 * x + r.d12 * y + r.d22 * s


@njit(cache=True)
def _rooted_response(split, g, exx, eyy, gxy, root):
    """The law of lambda = 0, mu = 1/2 between strain~ = R strain and stress~, stress = R^T stress~ (He and Shao 2019)."""
    a0, a1, a2 = root[0, 0], root[0, 1], root[0, 2]
    b0, b1, b2 = root[1, 0], root[1, 1], root[1, 2]
    c0, c1, c2 = root[2, 0], root[2, 1], root[2, 2]
    x, y, s = a0 * exx + a1 * eyy + a2 * gxy, b0 * exx + b1 * eyy + b2 * gxy, c0 * exx + c1 * eyy + c2 * gxy
    r = point_response(split, g, x, y, s, 0.0, 0.5)
    x0, y0, s0 = _tangent_times(r, a0, b0, c0)
    x1, y1, s1 = _tangent_times(r, a1, b1, c1)
    x2, y2, s2 = _tangent_times(r, a2, b2, c2)
    return PointResponse(
        r.psi_plus, r.psi_minus,
        a0 * r.sxx + b0 * r.syy + c0 * r.sxy, a1 * r.sxx + b1 * r.syy + c1 * r.sxy, a2 * r.sxx + b2 * r.syy + c2 * r.sxy,
        a0 * x0 + b0 * y0 + c0 * s0, a0 * x1 + b0 * y1 + c0 * s1, a0 * x2 + b0 * y2 + c0 * s2,
        a1 * x1 + b1 * y1 + c1 * s1, a1 * x2 + b1 * y2 + c1 * s2, a2 * x2 + b2 * y2 + c2 * s2,
    )  # fmt: skip


@njit(cache=True, forceinline=True)
def body_response(law, body, g, exx, eyy, gxy):
    """The same as ``point_response`` by the law (``Law``) of a body of any stiffness.

    ``body`` is its number, best unsigned: numba asks a signed one whether it counts from the end.
    """
    if law.is_rooted[body]:
        return _rooted_response(law.split[body], g, exx, eyy, gxy, law.root[body])
    return point_response(law.split[body], g, exx, eyy, gxy, law.lam[body], law.mu[body])


@njit(cache=True)
def _responses(law, g, strain, energies, stress, tangent):
    for p in range(strain.shape[0]):
        r = body_response(law, 0, g[p], strain[p, 0], strain[p, 1], strain[p, 2])
        energies[p, 0], energies[p, 1] = r.psi_plus, r.psi_minus
        stress[p, 0], stress[p, 1], stress[p, 2] = r.sxx, r.syy, r.sxy
        tangent[p, 0, 0], tangent[p, 1, 1], tangent[p, 2, 2] = r.d00, r.d11, r.d22
        tangent[p, 0, 1] = tangent[p, 1, 0] = r.d01
        tangent[p, 0, 2] = tangent[p, 2, 0] = r.d02
        tangent[p, 1, 2] = tangent[p, 2, 1] = r.d12


def responses(law: Law, degradation: NDArray, strain: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """The law of one body over many points.

    Parameters
    ----------
    law : of which the first body counts.
    degradation : (n,) values of g.
    strain : (n, 3) Voigt xx, yy, engineering xy.

    Returns
    -------
    energies (n, 2): psi_plus, psi_minus; stress (n, 3); tangent (n, 3, 3).
    """
    n = len(strain)
    energies, stress, tangent = np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 3, 3))
    _responses(law, degradation, strain, energies, stress, tangent)
    return energies, stress, tangent
