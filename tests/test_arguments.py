"""What is given in Python or on the command line and is no argument is told in one sentence, before anything is done."""

from pathlib import Path

import pytest

from cases.errors import UserError
from verify import cli, run
from verify.runs.listeners import Listener

CASE = """
title = "Square"
requirement = "It is pulled."
units = { length = "mm", force = "kN" }
plane = { assumption = "strain" }
materials.steel = { young = 210.0, poisson = 0.3 }
bodies.square = { material = "steel", shape = { rectangle = { lower = [0, 0], upper = [1, 1] } } }
constraints = [
    { on = "bottom", direction = "x", value = 0 }, { on = "bottom", direction = "y", value = 0 },
    { on = "top", direction = "y", scale = 1 },
]
load = { path = [0, 1e-3], increment = 1e-3 }
mesh = { h = 0.5 }
runs.fem = { solver = "fem" }
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "square.toml"
    path.write_text(CASE)
    return path


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"run_name": None}, "run_name = None is no text"),
        ({"threads": 0}, "threads = 0 is no number of threads; give 1 or more"),
        ({"threads": "2"}, "threads = '2' is no number of threads"),
        ({"out": None}, "out = None is no path; give a folder"),
        ({"out": " "}, "out = ' ' is no path; give a folder"),
        ({"listeners": None}, "listeners = None is no list"),
        ({"listeners": [print]}, "has no start, record, finish; derive it from"),
    ],
)
def test_what_is_no_argument_of_run_is_told(file, tmp_path, arguments, said):
    given = {"run_name": "fem", "out": tmp_path / "out", **arguments}
    with pytest.raises(UserError, match=said):
        run(file, **given)
    assert not (tmp_path / "out").exists()


def test_fields_are_asked_for_by_a_number(file, tmp_path):
    done = run(file, "fem", out=tmp_path, listeners=[Listener()], threads=1)
    with pytest.raises(UserError, match="'last' is no load or time; give a number, or None for the last state"):
        done.points("last")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["accept", "--reason", "finer"], "no run of square is there in tier 'standard'; do it with `verify run` first"),
        (["coverage"], "there is no printed number in these cases"),
        (["coverage", "--source", "Miehe"], "no printed number of a source with 'Miehe' in its name; leave --source out"),
    ],
)
def test_a_command_that_finds_nothing_to_do_says_so(file, tmp_path, command, said, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main([command[0], str(file), "--out", str(tmp_path / "out"), *command[1:]])
    assert ended.value.code == 3
    assert said in " ".join(capsys.readouterr().err.split())
