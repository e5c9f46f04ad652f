"""A result from elsewhere held against the kept results of a case: nothing is solved."""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from cases import Case, Check, UserError, load_case, of_its_file
from cases.copies import write_copy
from cases.errors import BrokenRuleError
from cases.foreign_fields import ForeignFields, parse_arrays
from cases.judging import Reference, merge
from cases.loader import read_tables
from cases.mapping import parse_mapping
from cases.messages import case_error
from cases.solvers import IMPORTED
from physics.surface_energy import RAISED
from verify.judging.judge import checks_of
from verify.judging.summary import summarise, write_summary
from verify.judging.targets import CURVE_METRICS, JudgeError, asked_for, reference_curve
from verify.judging.views import Json
from verify.metrics.curves import Curve, CurveError, displacement_at_peak, peak_force, peak_index
from verify.metrics.registry import PAIR_METRICS
from verify.runs.imported_error import ImportedError
from verify.runs.importing import mapped, read_path, read_table
from verify.runs.kept import main_runs, read_kept, restore
from verify.runs.run_folder import RunFolder
from verify.runs.running import run

DEFAULT_FOLDER = Path("reports/out/judged")
#: shown of every result, whether the case checks them or not
SHOWN = (
    "peak_force", "displacement_at_peak", "initial_stiffness", "curve_l2_before_peak", "curve_l2_whole",
    "dissipated_work", "fracture_energy", "crack_length", "crack_angle", "path_mean_distance_over_h",
    "path_hausdorff_over_h",
)  # fmt: skip
SHOWN_OF_MOVING = ("fracture_energy",)
_SHOWN_LIMIT = 0.05
#: elastic slopes that differ by less are the same
SAME_STIFFNESS = 0.03
#: an elastic part that starts farther from where it should, as a share of u at the peak, is shifted
LARGEST_SHIFT = 0.03


@dataclass(frozen=True)
class ForeignResult:
    """What is to be judged.

    history : CSV file or table. map : as in `cases.mapping`. crack_path : CSV file or table x,y or array (n, 2) [length].
    fields : file of fields. arrays : which they are, "damage = d, displacement = U" (`cases.foreign_fields`).
    name : of the run; that of the file without. within : share that replaces the case's relative limits
    """

    history: Path | pd.DataFrame
    map: str = ""
    crack_path: Path | pd.DataFrame | np.ndarray | None = None
    name: str = ""
    within: float | None = None
    fields: Path | None = None
    arrays: str = ""


@dataclass(frozen=True)
class Judgement:
    """The verdict on a result from elsewhere: its entry of summary.json, the folder of it all, the run, the page."""

    entry: Json
    out: Path
    run: RunFolder
    page: Path | None = None

    @property
    def verdict(self) -> str:
        """PASS, FAIL, MISSING or NOT_CHECKED."""
        return str(self.entry["verdict"])

    @property
    def remarks(self) -> list[str]:
        """What the curves tell of where a difference may come from, and what there was not to compare with."""
        return list(self.entry["remarks"])

    @property
    def checks(self) -> pd.DataFrame:
        """A row for each check; those that are only shown have the verdict INFO."""
        columns = ["metric", "against", "value", "target", "unit", "error", "limit", "verdict", "note"]
        return pd.DataFrame(self.entry["checks"], columns=columns)

    def _repr_html_(self) -> str:
        from verify.runs.sketch import sketch

        runs = {name: RunFolder(self.out / told["folder"]) for name, told in self.entry["runs"].items() if told["folder"]}
        curves = {name: (run.history["u"], run.history["F"]) for name, run in runs.items()}
        said = "".join(f"<li>{escape(remark)}</li>" for remark in self.remarks)
        head = f"<p><b>{escape(self.entry['case'])}: {self.verdict}</b></p><ul>{said}</ul>"
        return f"{head}{sketch(curves, 'u', 'F')}{self.checks.to_html(index=False)}"


def judge_foreign(case: Case, foreign: ForeignResult, out: Path) -> Judgement:
    """Judge a result from elsewhere by the case's own checks, against the kept results of its tier.

    Under ``out`` there is afterwards what `verify run` and `verify compare` leave: a case file with the run and its
    checks in ``cases/<case>``, run folders, and the summary with its views.

    Raises
    ------
    UserError : the result cannot be read; one sentence tells what was found.
    """
    case = of_its_file(case, None, None)
    _require_readable(case, foreign)
    named = replace(foreign, name=_run_name(foreign, case))
    before = out / "runs" / case.name / case.tier
    if before.exists() and not (out / "cases" / case.name).exists():
        raise ImportedError(f"{before}: holds runs of the case, which judging would replace; give another folder as out.")
    shutil.rmtree(before, ignore_errors=True)
    written = _write_case(case, named, out)
    imported = run(written, named.name, case.tier, out, force=True)
    _, about_kept = restore(written, out, first_branch=not case.dynamics and not _turns_back(imported))
    summary = summarise([written], case.tier, out)
    entry = summary["cases"][0]
    entry["command"] = _command(case, named)
    told = [*energy_remarks(written, imported, out), *imported.info.get("remarks", [])]
    entry["remarks"] = [*remarks(written, imported, out), *told, *about_kept]
    write_summary(summary, out)
    return Judgement(entry, out, imported)


def _require_readable(case: Case, foreign: ForeignResult) -> None:
    """Raise UserError for what is wrong in the map or the files, while they have the names that the user knows."""
    if not isinstance(foreign.map, str):
        raise UserError(f'map: {foreign.map!r} is no text; write one such as "u = U2, F = -2 * RF2 [N]".')
    within = foreign.within
    if within is not None and not (isinstance(within, int | float) and 0.0 < within < 1.0):
        raise UserError(f"within: {within!r} is no share; give a number between 0 and 1, such as 0.05 for 5 %.")
    try:
        mapping = parse_mapping(foreign.map)
    except BrokenRuleError as error:
        raise UserError(f"map: {(error.value or foreign.map)!r} {error.text}; {error.remedy}.") from None
    given = foreign.history
    for file in (given, foreign.crack_path, foreign.fields):
        if isinstance(file, Path) and not file.is_file():
            kind = "a file of fields, such as VTU" if file is foreign.fields else "a CSV file"
            raise UserError(f"{file}: is no file; name {kind}.")
    mapped(read_table(given) if isinstance(given, Path) else given, mapping, case, _called(given))
    if isinstance(foreign.crack_path, Path):
        read_path(foreign.crack_path)
    elif foreign.crack_path is not None:
        _path_table(foreign.crack_path)
    if foreign.fields is not None:
        _require_fields(foreign.fields, foreign.arrays, case)


def _require_fields(file: Path, arrays: str, case: Case) -> None:
    from verify.runs.foreign_fields import read_states

    try:
        tables = {"file": file.name, **parse_arrays(arrays)}
        fields = ForeignFields.model_validate(tables, context={"folder": file.parent})
    except BrokenRuleError as error:
        raise UserError(f"arrays: {error.value!r} {error.text}; {error.remedy}.") from None
    except ValidationError as error:
        raise case_error(file, error, []) from None
    read_states(fields.model_copy(update={"file": file}), case)


def _command(case: Case, foreign: ForeignResult) -> str:
    """What judges the same files again."""
    options = {"--map": foreign.map, "--tier": case.tier, "--name": foreign.name}
    if isinstance(foreign.crack_path, Path):
        options["--crack-path"] = str(foreign.crack_path)
    if foreign.fields is not None:
        options |= {"--fields": str(foreign.fields), "--arrays": foreign.arrays}
    if foreign.within is not None:
        options["--within"] = f"{foreign.within:g}"
    said = [word for pair in options.items() if pair[1] for word in pair]
    return f"verify judge {asked_for(case)} {shlex.join(['--history', _called(foreign.history), *said])}"


def _called(given: Path | pd.DataFrame) -> str:
    return str(given) if isinstance(given, Path) else "TABLE"


def _turns_back(imported: RunFolder) -> bool:
    try:
        return Curve.from_history(imported.history).cyclic
    except CurveError:
        return False


def _run_name(foreign: ForeignResult, case: Case) -> str:
    stem = foreign.history.stem if isinstance(foreign.history, Path) else "mine"
    name = re.sub(r"\W+", "_", foreign.name or stem, flags=re.ASCII).strip("_")[:60]
    name = name if name[:1].isalpha() else f"run_{name}"
    return f"{name}_imported" if name in case.runs else name


# ------------------------------------------------------------------------------------------- the case file


def _write_case(case: Case, foreign: ForeignResult, out: Path) -> Case:
    """The case with the result as one of its runs beside those that are kept, and the checks that apply to it."""
    tables = read_tables(case.source)
    of_tier = tables.get("tiers", {}).get(case.tier, {})
    runs = merge(tables.get("runs", {}), of_tier.get("runs", {}))
    kept = [name for name in main_runs(case) if read_kept(case, name) is not None]
    tables = {key: value for key, value in tables.items() if key not in ("charts", "maps")}
    left = ("runs", "charts", "maps")
    tables["tiers"] = {case.tier: {key: value for key, value in of_tier.items() if key not in left}}
    tables["runs"] = {name: runs[name] for name in main_runs(case)} | {foreign.name: _run_table(foreign, out)}
    tables["checks"] = foreign_checks(case, foreign, kept)
    path = write_copy(case, out / "cases", tables)
    return load_case(path, case.tier)


def _run_table(foreign: ForeignResult, out: Path) -> dict[str, Any]:
    """The run's table, whose files `write_copy` puts beside the case."""
    table: dict[str, Any] = {"solver": IMPORTED, "history": _as_file(foreign.history, out, foreign.name)}
    if foreign.map:
        table["map"] = foreign.map
    if foreign.crack_path is not None:
        table["crack_path"] = _as_file(_path_table(foreign.crack_path), out, f"{foreign.name}_crack_path")
    if foreign.fields is not None:
        table["fields"] = {"file": str(foreign.fields.resolve()), **parse_arrays(foreign.arrays)}
    return table


def _path_table(crack: Path | pd.DataFrame | np.ndarray) -> Path | pd.DataFrame:
    """A file as it is; columns x and y of a table, or an array (n, 2), as a table of both."""
    if isinstance(crack, Path):
        return crack
    try:
        points = np.asarray(crack.reindex(columns=["x", "y"]) if isinstance(crack, pd.DataFrame) else crack)
    except ValueError:  # rows of several lengths
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "iuf" or not np.isfinite(points).all():
        remedy = "give an array (n, 2) of finite numbers x, y, or a CSV file or table with these columns"
        raise UserError(f"crack_path: is of shape {points.shape} and kind {points.dtype}; {remedy}.")
    return pd.DataFrame(points, columns=["x", "y"])


def _as_file(given: Path | pd.DataFrame, out: Path, name: str) -> str:
    if isinstance(given, Path):
        return str(given.resolve())
    path = out / "given" / f"{name}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    given.to_csv(path, index=False)
    return str(path.resolve())


# ------------------------------------------------------------------------------------------------- checks


def foreign_checks(case: Case, foreign: ForeignResult, kept: list[str]) -> list[dict[str, Any]]:
    """The checks of a result from elsewhere, as tables of a case file.

    Those that hold a kept run against the other, against print or an exact solution apply with the same limits, against
    each of the kept runs, those of two curves or paths against the one that is the reference in the case; those against
    the case's own baseline do not. The metrics of `SHOWN` are told besides.
    """
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for check in checks_of(case):
        for against in _targets(case, check, kept):
            table = _table(check, against, foreign)
            key = (check.metric, against, str(sorted(check.parameters.items())))
            if key not in found or (table["gate"], table["limit"]) > (found[key]["gate"], found[key]["limit"]):
                found[key] = table
    for metric in SHOWN_OF_MOVING if case.dynamics else SHOWN:
        for against in _shown_against(case, metric, kept):
            found.setdefault((metric, against, "[]"), _shown(metric, against, foreign))
    return list(found.values())


def _targets(case: Case, check: Check, kept: list[str]) -> list[str]:
    kind, other = check.target
    mains = main_runs(case)
    if check.run not in mains or kind == "baseline":
        return []
    if kind != "run":
        return [check.against]
    return list(kept) if other in mains else []


def _table(check: Check, against: str, foreign: ForeignResult) -> dict[str, Any]:
    table = check.model_dump(mode="json", include={"metric", "measure", "limit", "gate", "reason", "parameters"})
    table |= {"run": foreign.name, "against": against}
    # an error relative to the force of the other run is another error
    table["gate"] = check.gate and (check.metric not in PAIR_METRICS or against == check.against)
    if foreign.within is not None and check.measure == "relative" and check.target[0] != "none":
        table |= {"limit": foreign.within, "reason": f"asked for; the case: {check.limit:g}, {check.reason}"}
    return table


def _shown_against(case: Case, metric: str, kept: list[str]) -> list[str]:
    curves = [name for name, reference in case.references.items() if _tells(reference, metric)]
    return [*kept, *(f"reference:{name}" for name in curves)]


def _tells(reference: Reference, metric: str) -> bool:
    of_curve = metric in CURVE_METRICS or (metric in PAIR_METRICS and not metric.startswith("path_"))
    return metric in reference.values or (reference.curve is not None and of_curve)


def _shown(metric: str, against: str, foreign: ForeignResult) -> dict[str, Any]:
    reason = f"shown beside a mark of {100 * _SHOWN_LIMIT:g} %: the case sets no limit for it"
    return {
        "metric": metric, "run": foreign.name, "against": against, "limit": _SHOWN_LIMIT, "gate": False, "reason": reason,
    }  # fmt: skip


# ------------------------------------------------------------------------------------------------ remarks


def remarks(case: Case, imported: RunFolder, out: Path) -> list[str]:
    """What the elastic part of the curve tells of where a difference comes from, in sentences."""
    if case.dynamics:
        return []
    try:
        curve = Curve.from_history(imported.history)
        name, expected = _expected(case, out)
        (slope, start), (slope_expected, start_expected) = _elastic_line(curve), _elastic_line(expected)
        ratio = slope / slope_expected
    except (CurveError, JudgeError) as problem:
        return [str(problem)]
    if not np.isfinite(ratio) or ratio == 0.0:
        return []
    said = [_remark(case, ratio, name, abs(peak_force(curve) / peak_force(expected)) - 1.0)]
    peak_at, shift = displacement_at_peak(curve), start - start_expected
    if ratio > 0.0 and curve.direction != expected.direction:
        said.append(f"Its u and F both have the other sign than those of {name}; write u = -COLUMN, F = -COLUMN.")
    if peak_index(curve) == len(curve.F) - 1 and abs(peak_at) < abs(displacement_at_peak(expected)):
        said.append(f"Its largest force is that of its last row, at u = {peak_at:.4g}: the curve ends before a peak.")
    if abs(shift) > LARGEST_SHIFT * abs(peak_at):
        said.append(
            f"Its elastic part, carried on, meets F = 0 at u = {start:.3g}, that of {name} at {start_expected:.3g}:"
            f" a slack, or an axis read with an offset; less that, its peak lies at u = {peak_at - shift:.4g} instead of"
            f" {peak_at:.4g}."
        )
    return said


def energy_remarks(case: Case, imported: RunFolder, out: Path) -> list[str]:
    """The energies that its last fields hold by our integration, beside those of the first kept run at that u."""
    told = imported.history[imported.history[["E_el", "E_frac"]].notna().any(axis=1)]
    if case.dynamics or len(told) in (0, len(imported.history)):
        return []
    state, said = told.iloc[-1], []
    kept = next((RunFolder(folder) for folder in _kept_folders(case, out)), None)
    for name, kind in (("E_frac", "a fracture"), ("E_el", "an elastic")):
        if np.isfinite(state[name]):
            ours = "" if kept is None else _beside(kept, name, state)
            said.append(f"{kind} energy of {state[name]:.4g} {case.unit('energy')}{ours}")
    return [f"At u = {state['u']:.4g} its fields hold {' and '.join(said)}, integrated here over their cells."]


def _beside(kept: RunFolder, name: str, state: pd.Series) -> str:
    """What a kept run has of an energy at the u of a state, where it went so far and has any."""
    u, energy = (kept.history[column].to_numpy(dtype=float) for column in ("u", name))
    if not u.min() <= state["u"] <= u.max():
        return f" ({kept.info['run']} ends at u = {u[-1]:.4g})"
    order = np.argsort(u, kind="stable")
    ours = float(np.interp(state["u"], u[order], energy[order]))
    return f" ({state[name] / ours:.3f} times that of {kept.info['run']})" if ours > 0 else ""


def _kept_folders(case: Case, out: Path) -> list[Path]:
    folders = (out / "runs" / case.name / case.tier / name for name in main_runs(case))
    return [folder for folder in folders if folder.is_dir()]


def _elastic_line(curve: Curve) -> tuple[float, float]:
    """Slope of the first branch between a tenth and two fifths of the way to the peak, where readings are surest, and
    the u at which that line meets F = 0.

    Raises CurveError where the first row has the largest force already.
    """
    end = peak_index(curve)
    way = np.abs(curve.u[: end + 1] - curve.u[0])
    if not way.any():
        remedy = "map the column of the force that moves the load, and begin with the unloaded state"
        raise CurveError(f"history: no force is larger than the first one, {curve.F[0]:g}; {remedy}")
    places = np.linspace(0.1, 0.4, 13) * way.max()
    force = np.interp(places, np.maximum.accumulate(way), curve.F[: end + 1])
    slope, offset = np.polyfit(places, force, 1)
    start = curve.u[0] - curve.direction * offset / slope if slope else np.nan
    return curve.direction * float(slope), float(start)


def _expected(case: Case, out: Path) -> tuple[str, Curve]:
    """The first kept run's curve, or the first published one."""
    for folder in _kept_folders(case, out):
        return folder.name, Curve.from_history(RunFolder(folder).history, folder.name)
    for name, reference in case.references.items():
        if reference.curve:
            return name, reference_curve(case, name)
    raise JudgeError(f"{case.name}: neither a kept result nor a published curve is there to compare a curve with.")


def _remark(case: Case, ratio: float, name: str, excess: float) -> str:
    said = f"The elastic slope is {ratio:.4g} times that of {name}"
    causes = {
        -1.0: "the sign of the force or of u is the other one; write for instance F = -COLUMN",
        0.5: "half a model looks so; write the word 'half model'",
        2.0: "a half that is cut across the load looks so, write u = 2 * COLUMN; or a whole whose force was doubled",
        4.0: "'half model' of a half that is cut across the load looks so; leave it out and write u = 2 * COLUMN",
        1e3: "a force in a unit a thousand times smaller looks so, or a length; give the unit in brackets",
        1e-3: "a force in a unit a thousand times larger looks so, or a length; give the unit in brackets",
        1e6: "a unit a million times smaller looks so; give the unit in brackets",
        1e-6: "a unit a million times larger looks so; give the unit in brackets",
        1.0 / case.plane.thickness: "a force per unit of thickness looks so; write the words 'per thickness'",
    }
    if abs(ratio - 1.0) <= SAME_STIFFNESS:
        elastic = f"{said}: the elastic part agrees"
        if abs(excess) <= SAME_STIFFNESS:
            return f"{elastic}, and the peak differs by {100 * excess:+.2g} %."
        return (
            f"{elastic}, the peak differs by {100 * excess:+.3g} %: look at toughness, length scale, split,"
            f" the spacing h over l0 and the increments.{_seen_toughness(case, name)}"
        )
    for value, cause in causes.items():
        if abs(ratio / value - 1.0) <= SAME_STIFFNESS:
            return f"{said}: {cause}."
    return (
        f"{said}: the elastic part differs already; look at elastic constants, plane strain or stress, thickness,"
        " supports and where u is measured."
    )


def _seen_toughness(case: Case, name: str) -> str:
    """What the spacing of a kept run does to its toughness, as in `verify.judging.targets.seen_toughness`."""
    fractures = [material.fracture for material in case.materials.values() if material.fracture]
    if name not in case.runs or not fractures:
        return ""
    words, share = RAISED[fractures[0].functional]
    excess = 100.0 * share * case.mesh.h / fractures[0].length_scale
    return f" That of {name} raises the toughness that it sees by {words} = {excess:.2g} %."
