"""The first test of the pair: where nothing moves and the points are the Gauss points, the MPM is the FEM."""

import numpy as np
import pytest

from cases import CaseError
from fem_reference import FiniteElements
from mpm import MaterialPoints
from numerics.quasi_static import increments

COARSE = {"h": 0.03, "coarse": 0.1, "fine": {"lower": [0.4, 0.4], "upper": [1.0, 0.6]}}


def march(solver, case):
    discretisation = solver(case)
    history = [
        (i.u, i.F, i.elastic_energy, i.fracture_energy, i.c_min) for i in increments(discretisation, case)
    ]
    return np.array(history), discretisation


@pytest.mark.parametrize("split", ["none", "volumetric_deviatoric", "spectral"])
def test_mpm_on_gauss_points_is_the_fem_through_fracture(variant, split):
    case = variant(
        "sen_tension",
        mesh=COARSE,
        load={"path": [0.0, 0.012], "increment": 1e-3, "smallest": 1e-3, "adaptive": False, "stop_when_broken": False},
        staggered={"tolerance": 1e-6, "residual_tolerance": 1e-10},
        mpm={"constraints_on": "nodes", "move_points": False},
        materials={"steel": {"fracture": {"length_scale": 0.03, "residual_stiffness": 1e-6, "split": split}}},
    )
    fem, elements = march(FiniteElements, case)
    mpm, points = march(MaterialPoints, case)
    assert fem[:, 4].min() < 0.01, "the specimen did not break"
    largest = np.abs(fem).max(axis=0)
    assert (np.abs(mpm - fem).max(axis=0) <= 1e-9 * largest).all()

    def by_place(fields):
        order = np.lexsort(np.round(fields.reference, 9).T)
        return fields.phase_field[order], fields.stress[order]

    for one, other in zip(by_place(elements.fields()), by_place(points.fields()), strict=True):
        assert np.abs(one - other).max() <= 1e-8 * max(1.0, np.abs(one).max())


def test_penalty_on_the_points_edges_is_elimination_at_the_nodes(variant):
    load = {"path": [0.0, 4e-3], "increment": 1e-3, "adaptive": False, "smallest": 1e-3}
    blunt = {"steel": {"fracture": {"length_scale": 0.03}}}
    case = variant("sen_tension", mesh=COARSE, load=load, materials=blunt, mpm={"move_points": False})
    fem, _ = march(FiniteElements, case)
    mpm, points = march(MaterialPoints, case)
    assert np.abs(mpm[1:, 1] / fem[1:, 1] - 1).max() < 1e-5
    assert 0 < points.measures()["constraint_error"] < 1e-4


def test_moving_points_keep_to_the_fem(variant):
    """Elastic plate; the points pass from cell to cell, and the body must not soften by it."""
    changes = {
        "mesh": {"h": 0.02, "coarse": 0.02, "fine": {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}},
        "load": {"path": [0.0, 0.02], "increment": 2e-3, "adaptive": False, "smallest": 2e-3},
        "materials": {"steel": {"fracture": {"toughness": 1e3, "length_scale": 0.03}}},
    }
    fem, _ = march(FiniteElements, variant("sen_tension", **changes))

    def largest_error(**mpm):
        curve, _ = march(MaterialPoints, variant("sen_tension", mpm=mpm, **changes))
        return np.abs(curve[1:, 1] / fem[1:, 1] - 1).max()

    assert largest_error() < 1e-3, "measured: 2.5e-4 while the top passes one cell"
    assert largest_error(fill_cells=False, strain="updated") > 0.02, "the cure has nothing to cure"


def test_tied_edge_moves_as_one(variant):
    """A load through a tied edge: elimination in the FEM, one more unknown in the MPM."""
    case = variant(
        "sen_tension",
        mesh={"h": 0.1, "coarse": 0.1, "fine": {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}},
        load={"path": [0.0, 1e-3], "increment": 1e-3, "adaptive": False, "smallest": 1e-3},
        materials={"steel": {"fracture": {"length_scale": 0.2}}},
        boundaries={"left": {"edge": "left"}, "right": {"edge": "right"}},
        constraints=[
            {"on": "left", "direction": "x", "value": 0.0},
            {"on": "bottom", "direction": "y", "value": 0.0},
            {"on": "top", "direction": "y", "scale": 1.0},
            {"on": "right", "direction": "x", "tied": True},
        ],
        mpm={"move_points": False},
    )
    forces = []
    for solver in (FiniteElements, MaterialPoints):
        history, discretisation = march(solver, case)
        forces.append(history[-1, 1])
        fields = discretisation.fields()
        edge = fields.reference[:, 0] > 0.97
        spread = np.ptp(fields.displacement[edge, 0] + (1 - fields.reference[edge, 0]) * fields.gradient[edge, 0])
        assert spread < 2e-2 * np.abs(fields.displacement).max()
    assert forces[1] == pytest.approx(forces[0], rel=1e-4)


@pytest.mark.parametrize("solver", [FiniteElements, MaterialPoints])
def test_a_node_both_tied_and_prescribed_is_refused(variant, solver):
    case = variant(
        "sen_tension", mesh=COARSE, mpm={"constraints_on": "nodes", "margin": 0},
        materials={"steel": {"fracture": {"length_scale": 0.03}}},
        constraints=[
            {"on": "bottom", "direction": "y", "value": 0.0},
            {"on": "top", "direction": "y", "scale": 1.0},
            {"on": "right", "direction": "y", "tied": True},
        ], boundaries={"right": {"edge": "right"}},
    )  # fmt: skip
    with pytest.raises(CaseError, match="contradict each other"):
        march(solver, case)


def test_same_case_twice_and_on_one_or_two_threads(variant):
    from numerics.threads import use_threads

    case = variant(
        "sen_tension", mesh=COARSE, load={"path": [0.0, 5e-3], "increment": 1e-3},
        materials={"steel": {"fracture": {"length_scale": 0.03}}},
    )  # fmt: skip
    for solver in (FiniteElements, MaterialPoints):
        curves = []
        for threads in (1, 1, 2):
            use_threads(threads)
            curves.append(march(solver, case)[0])
        use_threads(2)
        assert np.array_equal(curves[0], curves[1])
        assert np.array_equal(curves[0], curves[2])


def test_long_products_have_the_same_bits_on_one_and_two_threads():
    from numerics.threads import use_threads

    one, other = np.random.default_rng(1).random((2, 100_001))
    products = []
    for threads in (1, 2):
        use_threads(threads)
        products.append((float(one @ other), float(np.linalg.norm(one))))
    use_threads(2)
    assert products[0] == products[1]


def test_a_strip_that_moves_holds_no_more_cells_than_at_first(variant):
    """A strip that ends on a grid line, carried by a tenth of a cell: what touches its end must not be held."""
    case = variant(
        "l_panel", mesh={"h": 10.0, "coarse": 10.0, "fine": {"lower": [0.0, 0.0], "upper": [500.0, 500.0]}},
        materials={"concrete": {"fracture": {"toughness": 1e6, "length_scale": 10.0}}},
        load={"path": [0.0, 1.0], "increment": 0.5, "adaptive": False, "smallest": 0.5},
    )  # fmt: skip
    fem, _ = march(FiniteElements, case)
    mpm, _ = march(MaterialPoints, case)
    assert np.abs(mpm[1:, 1] / fem[1:, 1] - 1).max() < 3e-3


def test_updated_geometry_follows_a_large_stretch_and_ends_where_an_element_is_turned_inside_out(variant):
    """Uniaxial strain in increments: the sum of du / length is the logarithm of the stretch."""
    def pressed_to(end):
        return variant(
            "elastic_mms", "fem", exact=None, mesh={"h": 0.5, "geometry": "updated"},
            boundaries={}, constraints=[
                {"on": "left", "direction": "x", "value": 0.0}, {"on": "right", "direction": "x", "scale": 1.0},
                {"on": "bottom", "direction": "y", "value": 0.0}, {"on": "top", "direction": "y", "value": 0.0},
            ], load={"path": [0.0, end], "increment": 0.002, "adaptive": False},
        )  # fmt: skip

    for end in (0.5, -0.5):
        _, elements = march(FiniteElements, pressed_to(end))
        assert elements.fields().gradient[:, 0] == pytest.approx(np.log(1.0 + end), abs=3e-3)
        assert elements.measures()["element_quality"] == pytest.approx(1.0)
    solver = FiniteElements(pressed_to(-1.2))
    last = list(increments(solver, pressed_to(-1.2)))[-1]
    assert last.status == "no_convergence"
    assert "turned inside out" in last.reason
    assert last.u == pytest.approx(-1.0, abs=0.01)
