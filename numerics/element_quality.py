"""How far elements are from their ideal shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def scaled_jacobian(nodes: NDArray, elements: NDArray) -> NDArray:
    """Least scaled Jacobian (n_elements,) over the corners of each triangle or quadrilateral (Knupp 2000).

    1 for squares and equilateral triangles, 0 where two edges fall together, negative where an element is turned
    inside out, which VTK's measure of cells in a plane does not tell. ``nodes`` (n, 2) [length], ``elements``
    (n_elements, 3 or 4) counter-clockwise.
    """
    corners = nodes[elements]
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    area = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
    sides = np.linalg.norm(ahead, axis=-1) * np.linalg.norm(back, axis=-1)
    ideal = 2.0 / np.sqrt(3.0) if elements.shape[1] == 3 else 1.0
    return ideal * (area / np.maximum(sides, np.finfo(float).tiny)).min(axis=1)
