"""Bodies at rest, and parts of one, that come together across a gap: nothing makes them press on each other there.

Finite elements go through each other, and material points that move hang together as soon as they share functions.
"""

from __future__ import annotations

import numpy as np
import shapely

from cases import Case
from numerics.fields import Fields
from verify.health.state import uses_points

#: how near edges of elements are that meet, over h; samples of edges lie so densely, over that; no whole material is
#: pressed together by so much
_REACH, _DENSITY, _NEARER = 0.25, 0.67, 0.75


def of_gaps(case: Case, fields: Fields) -> dict[str, float]:
    """The indicator `met_across_gap` of the health record: length of the edges that have come within reach, over h."""
    if case.dynamics or case.exact:
        return {}
    from scipy.spatial import cKDTree  # judging does without

    by_points = uses_points(case)
    reach = case.mesh.h * (case.mpm.order if by_points and case.mpm.move_points else _REACH)
    edges = shapely.segmentize(shapely.boundary(shapely.union_all(case.outlines())), _DENSITY * reach)
    places = np.unique(shapely.get_coordinates(edges), axis=0)
    moved = places + fields.displacement[cKDTree(fields.reference).query(places)[1]]
    one, other = cKDTree(moved).query_pairs(_NEARER * reach, output_type="ndarray").T
    apart = np.linalg.norm(places[one] - places[other], axis=1) >= reach * (1.0 - 1e-6)
    met = np.unique(np.concatenate([one[apart], other[apart]]))
    return {"met_across_gap": len(met) * _DENSITY * reach / case.mesh.h}
