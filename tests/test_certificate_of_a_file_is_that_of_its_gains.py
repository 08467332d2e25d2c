"""What is certified of a coupling is certified of the file that holds it: nothing is lost or invented on the way."""

from pathlib import Path

import pytest
from walled import has_wall

import avc_casadi as avc
from avc_casadi import catalogue, certify, load_problem, solve
from avc_casadi._util.json_values import json_text
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_document

NAMES = [entry.name for entry in catalogue() if has_wall(entry.name)]


@pytest.mark.thorough
@pytest.mark.one_of(4)
@pytest.mark.parametrize("method", ["closed-form", "direct", "exact"])
@pytest.mark.parametrize("name", NAMES)
def test_over_the_whole_catalogue(name, method, tmp_path):
    """Every row of the table is certified as in the schedule, and the verdict is the same."""
    problem = load_problem(name).changed(stability={"scope": "pointwise"})
    if problem.frequency.values_hz is None:
        problem = problem.changed(frequency={"points": min(3, problem.frequency.points)})
    gains = solve(problem, method)
    if not gains.usable.any():
        return
    made = Coupling.of(problem, gains)
    avc.write_coupling(made, tmp_path / "c.json")
    back = avc.read_coupling(tmp_path / "c.json")
    assert avc.deployable(back).document() == avc.deployable(made).document()
    of_file, of_gains = certify(problem, back), certify(problem, gains)
    rows = [list(gains.frequency_hz).index(hz) for hz in of_file.frequency_hz]
    for level, found in of_gains.levels.items():
        assert of_file.levels[level].row_passed.tolist() == found.row_passed[rows].tolist()


@pytest.mark.parametrize(("name", "next_one"), [("mine", "avc recommend P"), ("figure5", "avc recommend figure5")])
def test_the_next_command_names_a_problem_that_is_there(tmp_path, monkeypatch, capsys, name, next_one):
    """A coupling file holds its problem, and not the name of its file."""
    monkeypatch.chdir(tmp_path)
    problem = load_problem("figure5").changed(frequency={"points": 5}).model_copy(update={"name": name})
    Path("gains.json").write_text(json_text(coupling_document(Coupling.of(problem, solve(problem, "direct")))))
    assert main(["certify", "gains.json"]) == 1
    assert f"next: {next_one} --out coupling.json" in capsys.readouterr().out
