"""A coupling's name follows from what runs, whatever is known of it; its file gives the same coupling back."""

import json

import numpy as np
import pytest
from schedule_problems import figure5

from avc_casadi import InputError, solve
from avc_casadi.coupling import Coupling, thinned
from avc_casadi.files.coupling_file import read_coupling, write_coupling
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.model.runtime import Runtime

RUNTIME = Runtime(estimator="zero-crossing", hold_s=0.3, slew_per_s=None, observer_mass_kg=0.2, guard="energy-tank")


@pytest.fixture(scope="module")
def coupling():
    problem = figure5(points=30, device={"max_force_n": 20.0})
    return Coupling.of(problem, solve(problem, "schedule"), RUNTIME)


def test_the_file_gives_the_same_coupling_back(coupling, tmp_path):
    told = coupling.with_certificate({"levels": {}}).with_trial({"hands": 5})
    write_coupling(told, tmp_path / "coupling.json")
    again = read_coupling(tmp_path / "coupling.json")
    assert again == told
    assert (again.table, again.runtime, again.problem) == (told.table, told.runtime, told.problem)
    assert (again.certificate, again.trial) == ({"levels": {}}, {"hands": 5})
    assert json.loads((tmp_path / "coupling.json").read_text())["id"] == coupling.id


def test_what_is_known_of_it_leaves_the_name_and_what_runs_changes_it(coupling):
    assert coupling.with_certificate({"a": 1}).with_trial({"b": 2}).id == coupling.id
    problem, schedule = coupling.problem, coupling.schedule
    wall = coupling.wall
    others = [
        Coupling.of(problem, schedule),
        Coupling.of(
            problem.changed(environment={"stiffness_n_per_m": 0.99 * wall.stiffness_n_per_m}), schedule, RUNTIME
        ),
        Coupling.of(problem.changed(environment={"damping_ns_per_m": 1.01 * wall.damping_ns_per_m}), schedule, RUNTIME),
        Coupling.of(problem.changed(device={"max_force_n": 10.0}), schedule, RUNTIME),
        Coupling.constant(problem, coupling.table.at_rest, "hand", RUNTIME),
    ]
    assert len({coupling.id, *(other.id for other in others)}) == 6


def test_gains_of_another_sample_time_are_refused(coupling, tmp_path):
    path = tmp_path / "coupling.json"
    write_coupling(coupling, path)
    for factor in (0.5, 1 + 1e-6, 2.0):
        document = json.loads(path.read_text())
        document["problem_file"]["device"]["sample_time_s"] *= factor
        (tmp_path / "other.json").write_text(json.dumps(document))
        with pytest.raises(InputError, match=r"id: |frequency"):
            read_coupling(tmp_path / "other.json")


def test_constant_gains_are_one_row_and_long_tables_no_more_than_a_device_holds():
    rows = np.array([[f, 2.0, 300.0, 4.0] for f in np.geomspace(1, 400, 264)])
    one = thinned(GainTable(rows))
    assert one.rows.tolist() == [[1.0, 2.0, 300.0, 4.0]]
    assert (one.constant, one.at_rest) == (True, Gains(2.0, 300.0, 4.0))
    rows[::2, 2] = 600.0
    long = thinned(GainTable(rows))
    assert not long.constant
    assert len(long) <= 256


@pytest.mark.parametrize("key", ["hold_s", "slew_per_s", "observer_mass_kg"])
@pytest.mark.parametrize("value", [-1e-3, float("inf"), float("nan")])
def test_times_and_masses_are_finite_and_not_negative(key, value):
    with pytest.raises(InputError, match=key):
        Runtime(**{key: value})
