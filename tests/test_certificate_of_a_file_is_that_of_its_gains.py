"""What is certified of gains is certified of the file that holds them: nothing is lost or invented on the way."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from drawn_problems import drawn_problem
from hypothesis import given, settings
from hypothesis import strategies as st
from walled import has_wall

from avc_casadi import catalogue, certify, load_problem, solve
from avc_casadi._util.json_values import json_text
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.design.registry import METHODS
from avc_casadi.files.coupling_file import coupling_document, read_file
from avc_casadi.files.gain_file import gain_document

NAMES = [entry.name for entry in catalogue() if has_wall(entry.name)]
POINTWISE = ("closed-form", "direct", "exact")


def read_back(gains):
    with TemporaryDirectory() as folder:
        path = Path(folder) / "gains.json"
        path.write_text(json_text(gain_document(gains)))
        return read_file(path)


def few(name):
    """The problem at every twentieth of its frequencies or so."""
    problem = load_problem(name)
    if problem.frequency.values_hz is None:
        return problem.changed(frequency={"points": min(3, problem.frequency.points)})
    return problem


def assert_same_certificates(problem, gains):
    back = read_back(gains)
    for requested in (False, True):
        of_file, of_gains = (certify(problem, one, requested=requested).document() for one in (back, gains))
        assert of_file == of_gains
    assert json_text(gain_document(back)) == json_text(gain_document(gains))


@pytest.mark.thorough
@pytest.mark.one_of(4)
@pytest.mark.parametrize("method", POINTWISE)
@pytest.mark.parametrize("name", NAMES)
def test_over_the_whole_catalogue(name, method):
    problem = few(name)
    gains = solve(problem.changed(stability={"scope": "pointwise"}), method)
    assert_same_certificates(problem, gains)


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize("method", [method for method in METHODS if method not in POINTWISE])
@pytest.mark.parametrize("name", ["figure5", "soft", "hard/rigid"])
def test_of_the_methods_that_search_longer(name, method):
    problem = few(name)
    gains = solve(problem, method)
    assert_same_certificates(problem, gains)


@pytest.mark.thorough
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_over_drawn_problems(seed):
    problem = drawn_problem(np.random.default_rng(seed))
    assert_same_certificates(problem, solve(problem, "closed-form"))


def test_the_contact_damper_that_was_asked_for_is_judged():
    """The closed form in the damped structure stands on Re Z_h = 0 with the damper it asks for, far below without."""
    problem = load_problem("figure5").changed(coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, 1.0)})
    gains = solve(problem, "closed-form")
    without = ~gains.usable & np.isfinite(gains.requested_damping_ns_per_m)
    assert np.any(gains.requested_contact_damping_ns_per_m[without] > 1.0)
    level = certify(problem, read_back(gains), requested=True).levels["L0"]
    assert np.all(level.row_margin_ns_per_m[without] > -1e-9)


def test_a_file_that_does_not_say_which_damper_was_asked_for_is_not_judged_without_one(tmp_path):
    problem = load_problem("figure5").changed(coupling={"structure": "damped", "contact_damping_ns_per_m": (0.0, 1.0)})
    gains = solve(problem, "closed-form")
    document = gain_document(gains)
    del document["requested_contact_damping_ns_per_m"]
    path = tmp_path / "gains.json"
    path.write_text(json_text(document))
    certificate = certify(problem, read_file(path), requested=True)
    assert certificate.rows_without_gains == int(np.count_nonzero(~gains.usable))


@pytest.mark.parametrize(("name", "next_one"), [("mine", "avc recommend P"), ("figure5", "avc recommend figure5")])
def test_the_next_command_names_a_problem_that_is_there(tmp_path, monkeypatch, capsys, name, next_one):
    """A coupling file holds its problem, and not the name of its file."""
    monkeypatch.chdir(tmp_path)
    problem = load_problem("figure5").changed(frequency={"points": 5}).model_copy(update={"name": name})
    Path("gains.json").write_text(json_text(coupling_document(Coupling.of(problem, solve(problem, "direct")))))
    assert main(["certify", "gains.json"]) == 1
    assert f"next: {next_one} --out coupling.json" in capsys.readouterr().out
