"""Small cases shared by the tests of the solvers."""

import copy
import os
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cases import Case, case_from_tables
from reports.report import SECTIONS

LIBRARY = Path(__file__).parents[1] / "cases" / "library"
#: files that take longest: two workers that begin with them end together
LONGEST = (
    "test_library.py", "test_maps.py", "test_attack.py", "test_health.py", "test_explicit_fourth_order.py",
    "test_reports.py", "test_foreign.py", "test_cluster.py", "test_quick_figures.py", "test_charts.py",
    "test_rigid_block.py", "test_moving_phase_field.py", "test_moving_fourth_order.py", "test_records.py",
    "test_run_folder.py", "test_random_scenes.py", "test_acceleration.py", "test_inclined_slits.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, the others as they come."""
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(LONGEST)))


def merged(tables: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """The tables with others merged over them."""
    result = copy.deepcopy(tables)
    for key, value in changes.items():
        result[key] = merged(result.get(key, {}), value) if isinstance(value, dict) else value
    return result


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """Files are not flushed to the disk, which guards against a cut of power that no test makes."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session")
def variant() -> Callable[..., Case]:
    """Builder of a library case with other tables: ``variant("sen_tension", mesh={"h": 0.05})``."""

    def build(name: str, run: str = "mpm", **changes: Any) -> Case:
        source = LIBRARY / name / "case.toml"
        tables = tomllib.loads(source.read_text(encoding="utf-8"))
        nothing: dict[str, Any] = {"tiers": {}, "checks": [], "charts": {}, "maps": {}}
        plain = merged({**tables, **nothing, "runs": {run: {"solver": run}}}, changes)
        return case_from_tables(plain, tier="standard", run=run, name=name, source=source)

    return build


def draw_few_sections(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of pages, the first sections alone are drawn, and the studies that the library has on record are not."""
    monkeypatch.setattr("reports.overview.studied_cases", lambda *_: [])
    monkeypatch.setattr("reports.report.SECTIONS", SECTIONS[:3])


@pytest.fixture
def few_sections(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `draw_few_sections`, in one test."""
    draw_few_sections(monkeypatch)
