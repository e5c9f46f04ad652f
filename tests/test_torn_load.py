"""Loads that tear off what they act on."""

import pytest

from cases import Case, case_from_tables
from verify.runs.running import run


def pulled(traction: float, solver: str) -> Case:
    """A strip with edges under a sudden traction [MPa], whose strength is about 4.5 MPa."""
    fracture = {"toughness": 3e-3, "length_scale": 0.5}
    return case_from_tables(
        {
            "title": "strip", "requirement": "a sudden load", "units": {"length": "mm", "force": "N", "time": "us"},
            "plane": {"assumption": "strain"},
            "materials": {"glass": {"young": 32000.0, "poisson": 0.2, "density": 2450.0, "fracture": fracture}},
            "bodies": {"strip": {"material": "glass", "shape": {"rectangle": {"lower": [0, -3], "upper": [6, 3]}}}},
            "tractions": [{"on": on, "value": [0.0, way * traction]} for on, way in (("top", 1), ("bottom", -1))],
            "dynamics": {"end_time": 5.0}, "staggered": {"scheme": "passes", "passes": 1, "tolerance": 1e-3},
            "mesh": {"h": 0.5}, "runs": {"fem": {"solver": "fem"}, "mpm": {"solver": "mpm"}},
        },
        run=solver,
    )  # fmt: skip


@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_an_edge_that_its_load_tears_off_is_told(solver, tmp_path):
    torn, whole = (run(pulled(traction, solver), solver, out=tmp_path, threads=1).info for traction in (6.0, 1.0))
    assert torn["health"]["torn_load"] > 0.8 and whole["health"]["torn_load"] == 0.0
