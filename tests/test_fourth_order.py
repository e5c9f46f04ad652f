"""The fourth-order phase field in both solvers: bases, energy, material axes, layers, refusals."""

import tomllib

import numpy as np
import pytest

from cases import CaseError, case_from_tables, load_case
from cases.judging import merge
from fem_reference import FiniteElements
from fem_reference.smooth_basis import SmoothBasis
from mpm import MaterialPoints
from mpm.quasi_static.point_basis import pulled_back
from numerics.quasi_static import increments
from physics.surface_energy import curvature_operator

GENERAL = {
    "gamma_1111": 5.0,
    "gamma_2222": 2.0,
    "gamma_1122": 0.7,
    "gamma_1212": 11.0,
    "gamma_1112": 1.5,
    "gamma_2212": -0.8,
}
FOURTH = {"order": 4, "gamma": GENERAL, "orientation": 25.0, "length_scale": 0.2}
SOLVERS = [FiniteElements, MaterialPoints]
WHOLE = {"lower": [0.0, 0.0], "upper": [1.0, 1.0]}


def plate(variant, **changes):
    """A square plate without a notch whose material is of order 4, on graded lines."""
    fracture = changes.pop("fracture", FOURTH)
    tables = {
        "mesh": {"h": 0.1, "coarse": 0.2, "fine": {"lower": [0.0, 0.3], "upper": [1.0, 0.6]}},
        "mpm": {"order": 3, "points_per_cell": 4},
        "materials": {"steel": {"fracture": fracture}},
        "notches": [],
        "load": {"path": [0.0]},
        "constraints": [{"on": edge, "direction": d, "value": 0.0} for edge in ("bottom", "top") for d in ("x", "y")],
    }
    return variant("sen_tension", **{**tables, **changes})


def set_quadratic_field(solver, coefficients):
    """Give the phase field 1 + a x² + b y² + d x y; its second derivatives are (2 a, 2 b, d)."""
    a, b, d = coefficients
    if isinstance(solver, FiniteElements):
        x, y = solver.basis.nodes.T
        reach = solver.case.mesh.h / 3.0
        steps = reach * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
        hermite = np.stack([1 + a * x * x + b * y * y + d * x * y, 2 * a * x + d * y, 2 * b * y + d * x, d + 0 * x])
        weights = np.stack([np.ones(4), steps[:, 0], steps[:, 1], steps[:, 0] * steps[:, 1]])
        solver.set_phase_field((hermite.T @ weights).ravel())
        return
    solver.begin_step()
    active = solver.basis.active
    used = np.unique(active.cells.nodes)
    x, y = solver.state.positions.T
    values, nodes = solver.basis.own_value, active.nodes_of_points()
    matrix = np.zeros((len(x), active.n_nodes))
    np.put_along_axis(matrix, nodes.astype(np.int64), values, axis=1)
    nodal = np.zeros(active.n_nodes)
    field = 1 + a * x * x + b * y * y + d * x * y
    nodal[used] = np.linalg.lstsq(matrix[:, used], field, rcond=None)[0]
    solver.set_phase_field(nodal)


@pytest.mark.parametrize("solver", SOLVERS)
def test_energy_of_a_quadratic_field_is_the_form_of_gamma(variant, solver):
    case = plate(variant)
    fracture = case.materials["steel"].fracture
    discretisation = solver(case)
    set_quadratic_field(discretisation, (0.3, -0.2, 0.45))
    curvature = curvature_operator(fracture) @ np.array([0.6, -0.4, 0.45])
    assert discretisation.trial.at_points.curvature_squared == pytest.approx(curvature @ curvature, rel=1e-6)
    # the other two terms by quadrature of the field itself
    s, w = np.polynomial.legendre.leggauss(4)
    x, y = np.meshgrid(0.5 * (s + 1), 0.5 * (s + 1))
    weights = np.outer(w, w) / 4.0
    c = 1 + 0.3 * x * x - 0.2 * y * y + 0.45 * x * y
    slopes = (0.6 * x + 0.45 * y) ** 2 + (0.45 * x - 0.4 * y) ** 2
    scale = fracture.length_scale
    density = (c - 1) ** 2 / (4 * scale) + scale * slopes + scale**3 * curvature @ curvature
    exact = fracture.toughness * (weights * density).sum()
    assert discretisation.energies()[1] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_phase_field_minimises_the_energy(variant, solver):
    """With a history field, any other phase field has more of Gc Z_c + H c²."""
    discretisation = solver(plate(variant))
    discretisation.begin_step()
    place = discretisation.fields().reference
    history = 0.05 * np.exp(-(((place - 0.5) / 0.2) ** 2).sum(1))
    volume = (discretisation.geometry if solver is FiniteElements else discretisation.basis.values).volume.ravel()
    discretisation.solve_phase_field(history)
    nodal = discretisation.nodal_phase_field

    def energy(unknowns):
        c = discretisation.set_phase_field(unknowns)
        return discretisation.energies()[1] + float((history * c**2) @ volume)

    least, generator = energy(nodal), np.random.default_rng(4)
    assert discretisation.set_phase_field(nodal).min() < 0.6
    for _ in range(5):
        away = 1e-3 * generator.standard_normal(nodal.size)
        assert energy(nodal + away) > least
        slope = (energy(nodal + 1e-3 * away) - energy(nodal - 1e-3 * away)) / 2e-3
        assert abs(slope) < 1e-6 * (energy(nodal + away) - least)


def test_both_solvers_give_one_phase_field_in_layers_of_different_orientation(variant):
    """Two bodies that touch share the field and its slope; each has its own axes."""
    layer = {"young": 210.0, "poisson": 0.3}
    materials = {
        "steel": {"fracture": FOURTH},
        "other": {**layer, "fracture": {**FOURTH, "orientation": -40.0, "toughness": 0.0027}},
    }

    def half(low, high):
        return {"rectangle": {"lower": [0.0, low], "upper": [1.0, high]}}

    bodies = {
        "plate": {"material": "steel", "shape": half(0.0, 0.5)},
        "top": {"material": "other", "shape": half(0.5, 1.0)},
    }
    case = plate(
        variant,
        materials=materials,
        bodies=bodies,
        mesh={"h": 0.05, "coarse": 0.05, "fine": WHOLE},
        mpm={"order": 3, "points_per_cell": 3},
    )
    fields = []
    for solver in SOLVERS:
        discretisation = solver(case)
        discretisation.begin_step()
        place = discretisation.fields().reference
        history = 0.05 * np.exp(-(((place - 0.5) / 0.2) ** 2).sum(1))
        c = discretisation.solve_phase_field(history)
        fields.append((place, c, discretisation.energies()[1]))
    (places, elements, energy), (points, material_points, other_energy) = fields
    assert energy == pytest.approx(other_energy, rel=2e-3)
    near = np.linalg.norm(places[:, None] - points[None], axis=2)
    matched = near.min(axis=1) < 1e-9
    difference = elements[matched] - material_points[near.argmin(axis=1)[matched]]
    assert matched.sum() > 1000
    assert np.abs(difference).max() < 2e-3
    mirrored = elements[np.lexsort(np.round(places * [1, 1], 9).T)]
    assert not np.allclose(mirrored, mirrored[::-1], atol=1e-3), "the axes make no difference"


def test_smooth_basis_has_continuous_slopes_and_doubled_nodes_part():
    nodes = np.array([[0, 0], [0.3, 0], [1, 0], [0, 0.5], [0.3, 0.5], [1, 0.5]], float)
    elements = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
    unknowns = np.random.default_rng(5).random(24)
    identity = np.broadcast_to(np.eye(3), (2, 3, 3))

    def at(place):
        basis = SmoothBasis(nodes, elements, np.array([[place[0]], [place[1]]]), 0.1, identity)
        return basis, unknowns[basis.unknowns]

    for y in (0.1, 0.7):
        right_end, coefficients = at((1.0, y))
        left_end, _ = at((0.0, y))
        value = [(b.value[b.kind[e], 0] @ coefficients[e]) for b, e in ((right_end, 0), (left_end, 1))]
        slope = [(coefficients[e] @ b.slope[b.kind[e], 0]) for b, e in ((right_end, 0), (left_end, 1))]
        assert value[0] == pytest.approx(value[1])
        assert slope[0] == pytest.approx(slope[1])
    doubled = np.vstack([nodes, nodes[[1, 4]]])
    parted = SmoothBasis(doubled, np.array([[0, 1, 4, 3], [6, 2, 5, 7]]), np.zeros((2, 1)), 0.1, identity)
    assert not set(parted.unknowns[0]) & set(parted.unknowns[1])


def test_material_axes_follow_the_material():
    """Second derivatives on a grid that the material has turned against, taken back to its first place."""
    turn = np.radians(20.0)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    hessian = np.array([[1.3, 0.4], [0.4, -0.7]])
    now = np.array([hessian[0, 0], hessian[1, 1], hessian[0, 1]])
    first = rotation.T @ hessian @ rotation
    back = pulled_back(rotation[None])[0] @ now
    assert back == pytest.approx([first[0, 0], first[1, 1], first[0, 1]])


@pytest.mark.parametrize(
    ("solver", "changes", "message"),
    [
        (
            FiniteElements,
            {"mesh": {"element": "triangle", "h": 0.1, "fine": WHOLE, "coarse": 0.1}},
            "axis-parallel rectangles",
        ),
        (
            FiniteElements,
            {"mesh": {"geometry": "updated", "h": 0.1, "fine": WHOLE, "coarse": 0.1}},
            'set it to "initial"',
        ),
        (
            MaterialPoints,
            {"notches": [{"kind": "slit", "start": [0.0, 0.5], "end": [0.5, 0.5]}]},
            "not smooth on the line",
        ),
    ],
)
def test_what_has_no_smooth_basis_is_refused(variant, solver, changes, message):
    with pytest.raises(CaseError, match=message):
        solver(plate(variant, **changes))


def test_a_checkpoint_brings_the_same_smooth_phase_field(variant):
    case = plate(
        variant, load={"path": [0.0, 2e-3], "increment": 1e-3, "adaptive": False, "smallest": 1e-3},
        constraints=[
            {"on": "bottom", "direction": "x", "value": 0.0}, {"on": "bottom", "direction": "y", "value": 0.0},
            {"on": "top", "direction": "y", "scale": 1.0},
        ],
    )  # fmt: skip
    one, other = FiniteElements(case), FiniteElements(case)
    list(increments(one, case))
    other.begin_step()
    other.restore(one.checkpoint())
    assert other.energies() == pytest.approx(one.energies(), rel=1e-12)
    assert np.array_equal(other.phase_field, one.phase_field)


def test_a_plate_turned_with_its_load_is_as_stiff(variant):
    """Edges held along segments across the grid: the outline is a staircase of points."""
    changes = {
        "mesh": {"h": 0.03}, "tiers": {}, "materials": {"solid": {"fracture": {"toughness": 1e6, "length_scale": 0.03}}},
        "load": {"path": [0.0, 1e-4], "increment": 1e-4, "adaptive": False, "smallest": 1e-4},
    }  # fmt: skip
    source = load_case("turned_specimen").source
    tables = tomllib.loads(source.read_text(encoding="utf-8"))
    forces = []
    for run in ("aligned", "turned"):
        case = case_from_tables(merge({**tables, "checks": []}, changes), run=run, name="turned", source=source)
        forces.append(list(increments(MaterialPoints(case), case))[-1].F)
    assert forces[1] == pytest.approx(forces[0], rel=0.03), "measured: 2.2 % with 20 cells along a side"
