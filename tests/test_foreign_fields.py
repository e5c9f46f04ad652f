"""Fields from elsewhere: from files of any kind to crack path and figures; what is missing is one sentence."""

import locale
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyvista

from cases import Case, CaseError, UserError, load_case
from cases.copies import toml_value, write_copy
from cases.errors import BrokenRuleError
from cases.foreign_fields import ForeignFields, parse_arrays
from cases.loader import read_tables
from reports.report import SECTIONS
from verify import judge
from verify.runs.foreign_fields import read_states, same_locale
from verify.runs.imported_error import ImportedError
from verify.runs.running import run

WIDTH = 0.03


@pytest.fixture(scope="module")
def case() -> Case:
    """The notched square, 1 by 1 about the origin, whose notch ends at its middle."""
    return load_case("sen_tension", "quick")


def plate(case: Case, cells: int = 40, scale: float = 1.0, thick: float = 0.0) -> pyvista.UnstructuredGrid:
    """A mesh of the square with a damage band behind the slit, opened along its line there by 0.01."""
    lower, upper = case.bounding_box()
    x, y = (np.linspace(a, b, cells + 1) for a, b in zip(lower, upper, strict=True))
    z = [0.0, thick] if thick else [0.0]
    mesh = pyvista.RectilinearGrid(x, y, z).cast_to_unstructured_grid()
    middle = 0.5 * (lower[1] + upper[1])
    beside = np.asarray(mesh.points)[:, 1] - middle
    mesh.point_data["d"] = np.exp(-np.abs(beside) / WIDTH) * (np.asarray(mesh.points)[:, 0] > 0.49 * upper[0])
    mesh.point_data["U"] = np.column_stack([0 * beside, 0.005 * np.tanh(beside / 0.01), 0 * beside])
    mesh.cell_data["e"] = np.ones(mesh.n_cells)
    mesh.points *= scale
    return mesh


def fields(file: Path, **keys: str) -> ForeignFields:
    return ForeignFields.model_validate({"file": file.name, **keys}, context={"folder": file.parent})


def saved(mesh: pyvista.UnstructuredGrid, file: Path) -> Path:
    """The mesh in the format of the file's ending."""
    if file.suffix == ".xdmf":
        file.write_text(xdmf(mesh.triangulate()), encoding="utf-8")
    else:
        with same_locale():
            mesh.save(file)
    return file


def xdmf(mesh: pyvista.UnstructuredGrid) -> str:
    """Triangles with their numbers in the text itself, as XDMF allows."""

    def item(values: np.ndarray, kind: str) -> str:
        size = " ".join(map(str, values.shape))
        return f'<DataItem Format="XML" Dimensions="{size}" {kind}>{" ".join(map(str, values.ravel()))}</DataItem>'

    cells, points = mesh.cells_dict[5], np.asarray(mesh.points)
    corners = item(cells, 'NumberType="Int"')
    arrays = "".join(
        f'<Attribute Name="{name}" AttributeType="{kind}" Center="Node">'
        f'{item(np.asarray(mesh.point_data[name]), "")}</Attribute>'
        for name, kind in (("d", "Scalar"), ("U", "Vector"))
    )
    return (
        f'<Xdmf Version="3.0"><Domain><Grid Name="a"><Topology TopologyType="Triangle" NumberOfElements="{len(cells)}">'
        f'{corners}</Topology><Geometry GeometryType="XYZ">{item(points, "")}</Geometry>'
        f"{arrays}</Grid></Domain></Xdmf>"
    )


def as_fenics(text: str) -> str:
    """The same with a collection of two times for each array, whose grids include the mesh of the first one."""
    head, _, _ = text.partition("<Attribute")
    include = '<xi:include xpointer="xpointer(/Xdmf/Domain/Grid[1]/*[self::Topology or self::Geometry])"/>'
    collections = "".join(
        '<Grid GridType="Collection" CollectionType="Temporal">'
        + "".join(f'<Grid GridType="Uniform">{include}<Time Value="{time}"/>{array}</Grid>' for time in ("0.5", "1"))
        + "</Grid>"
        for array in re.findall("<Attribute.*?</Attribute>", text)
    )
    space = '<Xdmf xmlns:xi="http://www.w3.org/2001/XInclude" '
    return f"{head}</Grid>{collections}</Domain></Xdmf>".replace("<Xdmf ", space)


def test_a_mesh_that_grids_of_several_times_include_is_there_once(case: Case, tmp_path: Path) -> None:
    mesh = plate(case)
    (tmp_path / "a.xdmf").write_text(as_fenics(xdmf(mesh.triangulate())), encoding="utf-8")
    states = read_states(fields(tmp_path / "a.xdmf"), case)
    ((_, once),) = read_states(fields(saved(mesh, tmp_path / "a.vtu")), case)
    assert [time for time, _ in states] == [0.5, 1.0]
    for _, state in states:
        assert state.volume.sum() == pytest.approx(once.volume.sum())
        assert np.ptp(state.displacement[:, 1]) == pytest.approx(np.ptp(once.displacement[:, 1]))
        assert state.phase_field.min() == pytest.approx(once.phase_field.min())


@pytest.mark.parametrize("name", ["a.vtu", "a.vtk", "a.xdmf"])
def test_a_file_gives_phase_field_displacement_and_their_gradient(name: str, case: Case, tmp_path: Path) -> None:
    file, before = saved(plate(case), tmp_path / name), locale.setlocale(locale.LC_ALL)
    ((_, state),) = read_states(fields(file), case)
    assert locale.setlocale(locale.LC_ALL) == before
    assert state.volume.sum() == pytest.approx(case.plane.thickness * np.prod(np.subtract(*case.bounding_box()[::-1])))
    assert state.phase_field.min() < 0.2 and state.phase_field.max() > 0.95
    assert np.ptp(state.displacement[:, 1]) == pytest.approx(0.01, rel=1e-3)
    assert (state.gradient[:, 3] * state.volume).sum() == pytest.approx(0.01 * case.plane.thickness, rel=1e-3)
    assert np.isnan(state.stress).all()


def test_a_plane_cut_of_a_solid_is_judged_and_without_one_it_is_refused(case: Case, tmp_path: Path) -> None:
    file = saved(plate(case, 30, scale=1e-3, thick=0.2), tmp_path / "solid.vtu")
    ((_, state),) = read_states(fields(file, cut="z = 0.0001", unit="m"), case)
    assert np.ptp(state.grid_points, axis=0) == pytest.approx(np.subtract(*case.bounding_box()[::-1]))
    with pytest.raises(ImportedError, match=r'three-dimensional, z from 0 to 0\.0002; name a plane .*crack fronts'):
        read_states(fields(file, unit="m"), case)
    with pytest.raises(ImportedError, match=r'cut = "z = 5" meets no cell; the mesh reaches from 0 to 0\.0002'):
        read_states(fields(file, unit="m", cut="z = 5"), case)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"damage": "D"}, "has no array 'D' for damage; it has d, U, e"),
        ({"damage": "U"}, "the array for phase_field has 3 components"),
        ({"phase_field": "d"}, "most of the body is broken; name it with damage = \"d\""),
        ({"damage": "d", "displacement": "e"}, "the array for displacement has 1 components"),
        ({"unit": "um"}, "give the unit of its lengths"),
        ({"unit": "furl"}, "unit = 'furl' has an unknown unit"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_sentence(keys: dict[str, str], said: str, case: Case, tmp_path: Path) -> None:
    file = saved(plate(case, 20), tmp_path / "a.vtu")
    with pytest.raises(ImportedError) as error:
        read_states(fields(file, **keys), case)
    assert said in str(error.value) and str(error.value).startswith(str(file)) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "text"), [("a.vtu", "no XML"), ("a.vtu", ""), ("a.abc", "x"), ("a.pvd", "<VTKFile/>"), ("a.xdmf", "<Xdmf/>"),
     ("a.pvd", '<VTKFile><Collection><DataSet timestep="0" file="none.vtu"/></Collection></VTKFile>')],
)  # fmt: skip
def test_a_file_that_holds_nothing_is_one_sentence(name: str, text: str, case: Case, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ImportedError, match=r"cannot be read \("):
        read_states(fields(tmp_path / name), case)


@pytest.mark.parametrize("move", ["mirrored", "shifted", "half", "wider"])
def test_a_mesh_that_is_not_where_the_bodies_are_is_refused(move: str, case: Case, tmp_path: Path) -> None:
    """Half a model, and one with more around it, are where the bodies are."""
    mesh = plate(case)
    (_, width), (low, high) = mesh.bounds[:2], mesh.bounds[2:4]
    if move == "mirrored":
        mesh.points[:, 0] = -mesh.points[:, 0]
    elif move == "shifted":
        mesh.points[:, 1] -= 0.5 * (high - low)
    elif move == "half":
        mesh = mesh.extract_cells(mesh.cell_centers().points[:, 1] > 0.5 * (low + high))
    else:
        mesh.points[:, 0] = 1.5 * mesh.points[:, 0] - 0.25 * width
    file = saved(mesh, tmp_path / "moved.vtu")
    if move in ("half", "wider"):
        assert len(read_states(fields(file), case)) == 1
        return
    with pytest.raises(ImportedError, match=r"its mesh spans .*; move it to where they are"):
        read_states(fields(file), case)


def test_arrays_are_told_in_one_line() -> None:
    assert parse_arrays("damage = d, cut = z = 0.5") == {"damage": "d", "cut": "z = 0.5"}
    for wrong in ("damage", "velocity = V", "damage = a, damage = b", "damage ="):
        with pytest.raises(BrokenRuleError, match="is not understood"):
            parse_arrays(wrong)


def series(case: Case, folder: Path) -> pd.DataFrame:
    """A PVD of two states, the second broken, and the history of three rows that it goes with."""
    for number, broken in enumerate((0.0, 1.0)):
        mesh = plate(case)
        mesh.point_data["d"] *= broken
        saved(mesh, folder / f"state {number}.vtu")
    sets = "".join(f'<DataSet timestep="{number}.0" file="state {number}.vtu"/>' for number in (0, 1))
    (folder / "mine.pvd").write_text(f'<VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>')
    table = pd.DataFrame({"time": [0.0, 0.5, 1.0], "u": [0.0, 0.005, 0.01], "F": [0.0, 0.7, 0.0]})
    table.to_csv(folder / "mine.csv", index=False)
    return table


def test_a_run_of_a_case_file_has_its_states_and_its_crack(case: Case, tmp_path: Path) -> None:
    series(case, tmp_path)
    told = {"history": str(tmp_path / "mine.csv"), "fields": {"file": str(tmp_path / "mine.pvd")}}
    tables = read_tables(case.source) | {"runs": {"theirs": {"solver": "imported", **told}}, "checks": [], "tiers": {}}
    tables = {key: value for key, value in tables.items() if key not in ("charts", "maps")}
    made = run(write_copy(case, tmp_path / "copy", tables), "theirs", "quick", tmp_path / "out")
    assert made.index["u"].tolist() == [0.0, 0.01]
    (notch,) = case.all_notches
    assert made.crack_path[0] == pytest.approx(notch.end)
    assert np.abs(made.crack_path[:, 1] - notch.end[1]).max() < case.mesh.h
    assert made.crack_path[-1, 0] > case.bounding_box()[1][0] - 2 * case.mesh.h
    assert toml_value(told["fields"])  # the table stands in a case file


def test_a_result_with_fields_is_judged_with_its_crack(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("reports.report.SECTIONS", [each for each in SECTIONS if each[0] == "Phase field"])
    table = series(case, tmp_path)
    judged = judge(case, table, fields=tmp_path / "mine.pvd", arrays="damage = d", out=tmp_path / "out")
    checks = judged.checks.set_index("metric")
    assert checks["value"]["crack_length"].iloc[0] == pytest.approx(0.5, abs=0.05)
    assert checks["value"]["fracture_energy"].iloc[0] > 0
    (told,) = (remark for remark in judged.remarks if "integrated here over their cells" in remark)
    assert told.startswith("At u = 0.01 its fields hold a fracture energy of") and "and a elastic" not in told
    page = judged.page.read_text(encoding="utf-8")
    assert 'id="phase-field"' in page and "could not be drawn" not in page
    for arrays in ("damage = X", "what", "cut = 5"):
        with pytest.raises(UserError):
            judge(case, table, fields=tmp_path / "mine.pvd", arrays=arrays, out=tmp_path / "out")
    with pytest.raises(ImportedError, match=r"2 states and table\.csv 3 rows without a column of time"):
        judge(case, table[["u", "F"]], name="table", fields=tmp_path / "mine.pvd", out=tmp_path / "out")


@pytest.mark.parametrize(
    "fields", ['{ file = "no.vtu" }', '{ cut = "z" }', '{ file = "a.vtu", damage = "d", phase_field = "c" }']
)
def test_a_table_of_fields_is_checked(fields: str, tmp_path: Path) -> None:
    (tmp_path / "a.vtu").write_text("x")
    (tmp_path / "a.csv").write_text("u,F\n0,0\n1,1\n")
    text = (load_case("sen_tension").source).read_text(encoding="utf-8").partition("\n[runs")[0]
    (tmp_path / "case.toml").write_text(f'{text}\n[runs.a]\nsolver = "imported"\nhistory = "a.csv"\nfields = {fields}\n')
    with pytest.raises(CaseError, match=r"runs\.a\.fields"):
        load_case(tmp_path / "case.toml")


@pytest.mark.parametrize("key", ["damage", "phase_field"])
def test_a_phase_field_of_cells_is_that_of_their_middles(key: str, case: Case, tmp_path: Path) -> None:
    mesh = plate(case)
    band = np.asarray(mesh.point_data_to_cell_data().cell_data["d"])
    mesh.point_data.clear()
    mesh.cell_data["band"] = band if key == "damage" else 1.0 - band
    ((_, found),) = read_states(fields(saved(mesh, tmp_path / "a.vtu"), **{key: "band"}), case)
    assert found.phase_field.min() == pytest.approx(1.0 - band.max(), abs=1e-6)


def test_vtk_adds_nothing_to_the_sentence_of_a_damaged_file(
    case: Case, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.vtu").write_text("<VTKFile")
    with pytest.raises(ImportedError, match="cannot be read"):
        read_states(fields(tmp_path / "a.vtu", damage="d"), case)
    assert capfd.readouterr().err == ""
