"""Maps of failure: verdicts, bisection and borders on stand-ins, and borders that theory gives on small real cases."""

from dataclasses import replace
from pathlib import Path

import fake_solver
import numpy as np
import pandas as pd
import pytest

from cases import Case, CaseError, load_case
from mpm.explicit.step_bound import stable_step
from reports import draw_map, drawing_style
from verify.runs import running
from verify.studies import explicit_clouds, krylov, probes
from verify.studies.maps import make_maps, powers
from verify.studies.records import Made
from verify.studies.study import Options, StudyError

MAP = """
[maps.spacing]
run = "fem"
x = { "mesh.h" = [0.05, 0.1, 0.2, 0.25] }
y = { "mpm.points_per_cell" = [1, 2] }
judged = { metric = "peak_force", against = "value:0.5", within = [0.01, 0.05] }
borders = ["first_order"]
bisections = 6
"""


def write_map(folder: Path, **replaced: str) -> Path:
    text = MAP
    for old, new in replaced.items():
        text = text.replace(next(line for line in MAP.splitlines() if line.startswith(f"{old} =")), new)
    return fake_solver.write_case(folder / "square", text)


@pytest.fixture
def first_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """F (1 + h / 10): 1 % off at h = 0.1, 2.5 % at h = 0.25."""
    fake_solver.install(monkeypatch)
    fake = lambda case: fake_solver.FakeSolver(case, 1.0 + 0.1 * case.mesh.h)  # noqa: E731
    monkeypatch.setitem(running.DISCRETISATIONS, "fem", fake)


def read(file: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    return pd.read_csv(file), pd.read_csv(file.with_name(f"{file.stem}-borders.csv"))


def test_bisection_makes_the_border_sharp_at_little_cost(tmp_path: Path, first_order: None) -> None:
    (file,) = make_maps(load_case(write_map(tmp_path), "quick"), Options(tmp_path / "out"))
    table, borders = read(file)
    assert len(table) == 8 + 2 * 6
    assert borders["measured"].to_numpy() == pytest.approx([0.1, 0.1], rel=0.02)
    assert borders["theory"].to_numpy() == pytest.approx([0.1, 0.1], rel=1e-6)
    assert (borders["verdict_below"] == "within 1 %").all() and (borders["verdict_above"] == "within 5 %").all()
    with drawing_style():
        drawing = draw_map(Made("maps", "spacing", file, load_case(tmp_path / "square" / "case.toml", "quick")), tmp_path)
    assert "Measured over theoretical border (first order" in drawing.caption
    said = "Errors over cell size h [mm] for each points per cell in each direction: 1: 0.5 % to 2.5 %, power 1.00 ± 0.00"
    assert said in drawing.caption
    assert (tmp_path / drawing.file).stat().st_size > 1000


@pytest.mark.parametrize(
    ("end", "verdict"),
    [
        (fake_solver.stopping_at(4), "no convergence"),
        (fake_solver.stopping_at(4, FloatingPointError("overflow")), "blew up"),
    ],
)
def test_a_failure_is_a_verdict_with_step_and_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: object, verdict: str
) -> None:
    fake_solver.install(monkeypatch, end)
    case = load_case(write_map(tmp_path, x='x = { "mesh.h" = [0.1, 0.2] }'), "quick")
    table, _ = read(make_maps(case, Options(tmp_path / "out"))[0])
    assert set(table["verdict"]) == {verdict} and set(table["step"]) == {4}
    assert table["reason"].str.len().gt(5).all()


def test_a_run_that_takes_too_long_is_given_up_and_not_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_solver.install(monkeypatch)
    path = write_map(tmp_path, judged="timeout = 1e-9", x='x = { "mesh.h" = [0.1] }')
    path.write_text(path.read_text().replace('borders = ["first_order"]', ""))

    def verdicts() -> set[str]:
        return set(read(make_maps(load_case(path, "quick"), Options(tmp_path / "out"))[0])[0]["verdict"])

    assert verdicts() == {"timeout"}
    with monkeypatch.context() as patched:
        patched.setattr(running, "solver_records", fake_solver.stopping_at(0, AssertionError("a solver ran")))
        assert verdicts() == {"timeout"}
    path.write_text(path.read_text().replace("timeout = 1e-9", "timeout = 100.0"))
    assert verdicts() == {"stable"}, "it has more time now"


def with_columns(**columns: object):
    """Increments with other values, each a number or a function of u."""

    def increments(solver, case, after=None):
        for increment in fake_solver.fake_increments(solver, case, after):
            changed = {name: value(increment.u) if callable(value) else value for name, value in columns.items()}
            yield replace(increment, **changed)

    return increments


def test_a_cell_that_is_no_valid_case_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_solver.install(monkeypatch)
    path = write_map(tmp_path, x='x = { "mesh.h" = [0.1, -1.0] }', bisections="bisections = 0")
    (file,) = make_maps(load_case(path, "quick"), Options(tmp_path / "out"))
    table, _ = read(file)
    refused = table[table["x"] < 0.0]
    assert (refused["verdict"] == "not possible").all() and refused["reason"].str.contains("mesh.h").all()


def test_energy_that_drifts_away_is_a_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drifting = with_columns(external_work=lambda u: u, elastic_energy=lambda u: u - max(0.0, u - 0.005))
    fake_solver.install(monkeypatch, drifting)
    path = write_map(tmp_path, judged="drift = 0.1", x='x = { "mesh.h" = [0.1] }')
    path.write_text(path.read_text().replace('borders = ["first_order"]', ""))
    table, _ = read(make_maps(load_case(path, "quick"), Options(tmp_path / "out"))[0])
    assert set(table["verdict"]) == {"energy drift"} and set(table["step"]) == {7}, "0.002 of 0.01 is lost at step 7"


@pytest.mark.parametrize(("phase_field", "verdict"), [(1.0, "numerical fracture"), (0.0, "stable")])
def test_a_force_lost_without_damage_is_numerical_fracture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, phase_field: float, verdict: str
) -> None:
    fake_solver.install(monkeypatch, with_columns(c_min=phase_field))
    path = write_map(tmp_path, judged="", x='x = { "history.u" = [0.005, 0.01] }')
    path.write_text(path.read_text().replace('borders = ["first_order"]', ""))
    table, _ = read(make_maps(load_case(path, "quick"), Options(tmp_path / "out"))[0])
    assert table["verdict"].tolist() == ["stable", verdict] * 2


def test_a_cell_that_is_no_case_is_not_possible(tmp_path: Path, first_order: None) -> None:
    path = write_map(tmp_path, x='x = { "mesh.h" = [0.2, 0.5] }', bisections="bisections = 0")
    table, _ = read(make_maps(load_case(path, "quick"), Options(tmp_path / "out"))[0])
    assert (table.loc[table["x"] == 0.5, "verdict"] == "not possible").all(), "h is above l0 = 0.3"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('run = "fem"\nx', 'run = "fem"\nprobe = "p"\nx', "exactly one way to measure"),
        ('"mesh.h"', '"meh.h"', "did you mean 'mesh'"),
        ('against = "value:0.5"', 'against = "run"', "give both or none"),
    ],
)
def test_a_mistake_in_a_map_is_told(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = write_map(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(CaseError, match=words):
        load_case(path, "quick")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"first_order"', '"second_order"', "'second_order' is not known; choose one of"),
        ('metric = "peak_force"', 'metric = "peak"', "'peak' is no metric of one run"),
        ('run = "fem"\nx', 'probe = "p"\nx', "'p' is not known"),
    ],
)
def test_an_unknown_name_in_a_map_is_told(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = write_map(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(StudyError, match=words):
        make_maps(load_case(path, "quick"), Options(tmp_path / "out"))


def test_a_penalty_ends_where_its_round_off_reaches_the_residual(tmp_path: Path) -> None:
    """Violation falls as 1 / penalty; Newton's method ends within a decade of residual_tolerance / machine epsilon."""
    (file,) = make_maps(load_case("cantilever", "quick"), Options(tmp_path), ["penalty"])
    table, borders = read(file)
    for _, row in table[table["x"] <= 100.0].groupby("y"):
        assert float(np.polyfit(np.log(row["x"]), np.log(row["error"]), 1)[0]) == pytest.approx(-1.0, abs=0.1)
    ratio = (borders["measured"] / borders["theory"]).groupby(borders["border"])
    assert set(ratio.groups) == {"first_order", "round_off"}
    assert ratio.min()["round_off"] > 0.1 and ratio.max()["round_off"] < 10.0
    assert ratio.min()["first_order"] > 0.3 and ratio.max()["first_order"] < 3.0, "one bisection of two decades"


@pytest.fixture(scope="module")
def tension(tmp_path_factory: pytest.TempPathFactory) -> list[pd.DataFrame]:
    """Cells of two maps of the plate in tension, which have a run in common."""
    options = Options(tmp_path_factory.mktemp("tension"))
    files = make_maps(load_case("sen_tension", "quick"), options, ["increments", "increments_converged"])
    return [read(file)[0] for file in files]


def test_one_pass_converges_at_first_order_in_the_increment(tension: list[pd.DataFrame]) -> None:
    """Passes of the thesis: error in proportion to the increment, and less with more passes."""
    error = tension[0].set_index(["y", "x"])["error"]
    assert np.log(error[1, 2e-4] / error[1, 1e-4]) / np.log(2.0) == pytest.approx(1.0, abs=0.3)
    assert error[4, 1e-4] < 0.3 * error[1, 1e-4] and error[4, 2e-4] < 0.3 * error[1, 2e-4]


def test_the_converged_scheme_does_not_feel_its_increment(tension: list[pd.DataFrame]) -> None:
    """Peak loads of twice and four times the reference's increment are its own within 0.5 %."""
    assert (tension[1]["error"] < 0.005).all()


def test_the_mesh_sees_its_own_toughness_as_long_as_a_crack_is_as_wide_as_a_cell(tmp_path: Path) -> None:
    """J is Gc (1 + h / (4 l0)) within 2 % at h = l0, and no longer at h = 2 l0."""
    (file,) = make_maps(load_case("surfing", "quick"), Options(tmp_path), ["length_scale"])
    table, _ = read(file)
    assert table["x"].tolist() == [0.02, 0.04] and table["verdict"].tolist() == ["within 2 %", "beyond 10 %"]


def test_points_of_an_elongated_bar_part_where_a_cell_can_be_empty(tmp_path: Path) -> None:
    """Two points in a cell part at a stretch of two, one by one at once; nothing is damaged."""
    (file,) = make_maps(load_case("homogeneous_bar", "quick"), Options(tmp_path), ["stretch"])
    table, borders = read(file)
    assert (table.loc[table["y"] == 1, "verdict"] == "numerical fracture").all()
    assert table.loc[table["y"] == 2, "verdict"].tolist() == ["stable", "stable", "numerical fracture"]
    assert borders["measured"].to_numpy() == pytest.approx(borders["theory"].to_numpy(), abs=0.11), "two increments"


# ---------------------------------------------------------------------------------------------- small clouds


@pytest.fixture(scope="module")
def bar() -> Case:
    return load_case("vibrating_bar", "quick")


@pytest.mark.parametrize("update", list(explicit_clouds.UPDATES))
@pytest.mark.parametrize("cloud", ["full", "fragment", "single"])
def test_the_solver_blows_up_where_the_eigenvalues_of_its_cloud_say(bar: Case, cloud: str, update: str) -> None:
    """Within 5 %; strains after the velocities leave a single point no motion that could grow."""
    free = explicit_clouds.free_case(bar, 2, update)
    points = explicit_clouds.clouds_of(cloud, 2)[0]
    critical = explicit_clouds.critical_step(free, points)
    if cloud == "single" and update == "musl":
        assert critical == np.inf and explicit_clouds.steps_until_blown(free, points, 5.0 * stable_step(free)) is None
        return
    assert explicit_clouds.steps_until_blown(free, points, 0.97 * critical) is None
    assert explicit_clouds.steps_until_blown(free, points, 1.05 * critical) is not None


@pytest.mark.parametrize("update", ["usl", "affine"])
@pytest.mark.parametrize("order", [2, 3])
def test_no_random_cloud_needs_less_than_the_proven_step(bar: Case, order: int, update: str) -> None:
    """A thousand clouds, single points among them; the worst single point comes close."""
    free, random = explicit_clouds.free_case(bar, order, update), np.random.default_rng(17)
    clouds = [explicit_clouds.points_of(cloud, random) for cloud in ("single", "fragment") for _ in range(500)]
    shares = np.array([explicit_clouds.critical_step(free, points) for points in clouds]) / stable_step(free)
    assert 1.0 <= shares.min() < 1.02
    worst = clouds[int(shares.argmin())]
    assert explicit_clouds.steps_until_blown(free, worst, 0.99 * stable_step(free)) is None
    assert explicit_clouds.steps_until_blown(free, worst, 1.07 * stable_step(free)) is not None


def test_hat_functions_have_no_step_that_holds_for_every_cloud(bar: Case) -> None:
    """The step of a point beside a cell's edge goes to nothing with the square root of its distance."""
    free = explicit_clouds.free_case(bar, 1, "usl")
    steps = [
        explicit_clouds.critical_step(free, explicit_clouds.MIDDLE[0] + np.array([[distance, 0.5]]))
        for distance in (1e-2, 1e-4)
    ]
    assert steps[1] / steps[0] == pytest.approx(0.1, rel=0.05)


def test_the_map_of_the_time_step_has_its_border_at_the_eigenvalue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explicit_clouds, "CLOUDS", 3)
    (file,) = make_maps(load_case("vibrating_bar", "quick"), Options(tmp_path), ["time_step"])
    table, borders = read(file)
    assert (table.loc[table["x"] <= 1.0, "verdict"] == "stable").all() and len(borders) == 3
    assert borders["measured"].to_numpy() == pytest.approx(borders["theory"].to_numpy(), rel=0.05)


def test_a_moving_run_is_stable_drifts_or_blows_up(tmp_path: Path) -> None:
    (file,) = make_maps(load_case("vibrating_bar", "quick"), Options(tmp_path), ["energy"])
    verdict = read(file)[0].set_index(["y", "x"])["verdict"]
    assert verdict[1.0, 0.8] == "stable" and verdict[0.9, 0.8] == "energy drift" and verdict[1.0, 3.0] == "blew up"


def test_points_that_cross_cells_exert_a_force_as_large_as_their_spacing_on_hat_functions() -> None:
    """One point more or less in a cell is a force of its spacing; a continuous slope leaves a tenth of it, or less."""
    case = load_case("homogeneous_bar", "quick", "mpm")
    for count in (2, 4, 8):
        linear, quadratic, cubic = (
            probes.cell_crossing(case, points_per_cell=count, order=order).value for order in (1, 2, 3)
        )
        assert linear == pytest.approx(probes.STRETCH / count, rel=1e-9)
        assert quadratic < 0.11 * linear and cubic < 0.11 * quadratic


def orders(errors: pd.Series) -> np.ndarray:
    """Order of convergence from each number of cells to the next."""
    return -np.diff(np.log(errors)) / np.diff(np.log(errors.index.to_numpy(float)))


def test_points_that_travel_end_the_convergence_of_hat_functions_and_not_that_of_quadratic_splines(
    tmp_path: Path,
) -> None:
    """Hat functions: on top of the error at rest that of a stiffness 1 + 2 pi d cos(2 pi X), pi sqrt(10 / 9) d.

    Quadratic splines: second order until points come near to crossing, then a small part of that error.
    """
    names = ["cell_crossing_linear", "cell_crossing_quadratic"]
    linear, quadratic = (
        read(file)[0].pivot(index="x", columns="y", values="error")
        for file in make_maps(load_case("homogeneous_bar", "quick"), Options(tmp_path), names)
    )
    assert orders(linear[0.0]) == pytest.approx(2.0, abs=0.01), "points at rest"
    for distance in (0.001, 0.002, 0.005):  # first order in the distance
        added = (linear[distance] - linear[0.0])[(linear.index >= 16) & (linear.index * distance <= 1 / 6)]
        assert added.to_numpy() == pytest.approx(np.pi * np.sqrt(10 / 9) * distance, rel=0.07)
    assert orders(linear[0.001]).min() < 0.1
    for distance, part in quadratic.items():
        assert (orders(part[part.index * distance <= 1 / 7]) > 1.8).all()
        assert distance == 0.0 or part[256] < 0.01 * linear.loc[256, distance]


def test_the_noise_of_the_stress_under_crossing_points_falls_with_the_order_of_the_basis() -> None:
    case = load_case("homogeneous_bar", "quick", "mpm")
    noise = {
        order: [probes.crossed_bar(case, cells=64, distance=d, order=order, of="strain").error for d in (0.0, 0.005)]
        for order in (1, 2, 3)
    }
    assert noise[1][1] > 10 * noise[1][0] and noise[1][1] > 50 * noise[2][1]
    assert noise[3][1] < 1.1 * noise[3][0], "what cubic splines have at rest comes from their ends"


def test_the_condition_grows_with_the_penalty_and_the_square_of_the_cells() -> None:
    case = load_case("cantilever", "quick", "mpm")

    def number(penalty: float, h: float) -> float:
        return probes.condition(case, penalty=penalty, h=h).value

    assert number(1e8, 0.1) / number(1e4, 0.1) == pytest.approx(1e4, rel=0.01)
    assert number(1e4, 0.025) / number(1e4, 0.05) == pytest.approx(4.0, rel=0.15)


def test_a_map_states_the_power_that_fits_its_errors() -> None:
    x = np.array([1.0, 2.0, 4.0, 8.0])
    rows = [
        pd.DataFrame({"y": "even", "x": x, "error": 0.01 * x**1.5}),
        pd.DataFrame({"y": "uneven", "x": x, "error": [0.01, 0.001, 0.1, 0.02]}),
        pd.DataFrame({"y": "few", "x": x, "error": [np.nan, 0.01, 0.02, 0.0]}),
    ]
    told = powers(pd.concat(rows)).set_index("y")
    assert told.loc["even", "power"] == pytest.approx(1.5, abs=1e-9) and told.loc["even", "uncertainty"] < 1e-6
    assert told.loc["uneven", "uncertainty"] > 0.25
    assert told.loc["few", "levels"] == 2 and np.isnan(told.loc["few", "power"])


def test_a_map_of_probes_needs_no_run(tmp_path: Path) -> None:
    (file,) = make_maps(load_case("homogeneous_bar", "quick"), Options(tmp_path), ["cell_crossing"])
    table, _ = read(file)
    assert len(table) == 21 and not (tmp_path / "runs").exists()
    assert table.loc[table["y"] == 1, "verdict"].tolist()[0] == "beyond 10 %"


def test_stress_that_does_not_turn_is_off_by_twice_the_sine_of_the_angle(tmp_path: Path) -> None:
    (file,) = make_maps(load_case("rotating_stressed_disc", "quick"), Options(tmp_path), ["turned_point"])
    table, borders = read(file)
    error = table.set_index(["y", "x"])["error"]
    assert error["additive"].to_numpy() == pytest.approx(2.0 * np.sin(np.radians(error["additive"].index)), rel=1e-9)
    assert error["corotational"].max() < 1e-3
    known = borders.dropna(subset="theory")
    assert list(known["y"]) == ["additive"]
    assert known["measured"].to_numpy() == pytest.approx(known["theory"].to_numpy(), rel=0.05)


def test_a_block_slides_where_the_slope_is_above_its_friction(tmp_path: Path) -> None:
    """The solver's block slides at 0.34 and holds at 0.39 on a slope of 0.364; its way is Coulomb's on either side."""
    (file,) = make_maps(load_case("sliding_block", "quick"), Options(tmp_path), ["slope"])
    table, borders = read(file)
    assert borders[["verdict_below", "verdict_above"]].to_numpy().tolist() == [["slides", "holds"]]
    assert borders["measured"].item() == pytest.approx(np.tan(np.radians(20.0)), abs=0.025)
    assert (table["error"] < 0.02).all()


def test_the_whole_factor_needs_no_more_iterations_than_the_least_degradation_allows() -> None:
    case = load_case("cantilever", "quick", "fem")
    for damage in (0.0, 0.3, 0.5, 0.7, 0.9):
        found = krylov.krylov(case, method="old_factor", damage=damage, residual_stiffness=0.0, allowed=1000)
        assert found.iterations <= 0.5 * np.log(2.0 / krylov.TOLERANCE) / (1.0 - damage)
    assert found.iterations > 30, "many more than for the whole body"


def test_a_body_broken_through_without_residual_stiffness_has_no_factor() -> None:
    case = load_case("cantilever", "quick", "fem")
    broken = {"damage": 1.0, "allowed": 300}
    verdicts = {
        method: [krylov.krylov(case, method=method, residual_stiffness=k, **broken).verdict for k in (0.0, 1e-6)]
        for method in ("direct", "old_factor")
    }
    assert verdicts == {"direct": ["no convergence", "stable"], "old_factor": ["stable", "stable"]}
