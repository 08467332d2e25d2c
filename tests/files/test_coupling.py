"""A coupling read from its file is the coupling that was written; a table alone loads beside its problem."""

import copy
import json

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi import InputError
from avc_casadi.coupling import Coupling, thinned
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.model.runtime import Runtime

NAMES = ("figure5", "damped", "ve3", "soft", "hard/long-delay", "hard/resonance")
CLOSED = ("figure5", "soft", "hard/long-delay")


def coupling(name="figure5", method="exact", runtime=None):
    problem = avc.load_problem(name)
    return Coupling.from_schedule(problem, avc.solve(problem, method), runtime)


@pytest.mark.parametrize(
    ("name", "method"), [*((name, "exact") for name in NAMES), *((name, "closed-form") for name in CLOSED)]
)
def test_the_file_gives_back_the_same_coupling(name, method, tmp_path):
    made = coupling(name, method, Runtime(observer_mass_kg=0.15, guard="passivity-controller", slew_per_s=None))
    avc.write_coupling(made, tmp_path / "c.json")
    again = avc.read_coupling(tmp_path / "c.json")
    assert again == made
    assert again.id == made.id
    assert again.runtime == made.runtime
    assert again.table == made.table
    assert again.problem == made.problem
    assert again.lacks == ()
    without = made.schedule.frequency_hz[~made.schedule.usable]
    np.testing.assert_array_equal(again.schedule.frequency_hz[~again.schedule.usable], without)


@pytest.mark.parametrize("name", NAMES)
def test_what_runs_is_within_the_thinning_of_every_row(name):
    made = coupling(name)
    full = GainTable.of(made.schedule)
    found = made.table(full.frequency_hz)
    scale = np.where(full.gains == 0, np.maximum(full.gains.max(axis=1, keepdims=True), 1.0), full.gains)
    assert np.abs((found - full.gains) / scale).max() <= 1e-3 * (1 + 1e-9)
    assert len(made.table) <= 256


def test_the_name_of_a_coupling_follows_what_runs():
    problem = avc.load_problem("ve3")
    made = Coupling.constant(problem, Gains(5.0, 1e4), "mine")
    assert made.id == Coupling.constant(problem, Gains(5.0, 1e4), "other").id
    others = [
        Coupling.constant(problem, Gains(5.0, 1.1e4), "mine"),
        Coupling.constant(problem, Gains(5.0, 1e4), "mine", Runtime(guard="energy-tank")),
        Coupling.constant(problem.changed(environment={"stiffness_n_per_m": 4000.0}), Gains(5.0, 1e4), "mine"),
        Coupling.constant(problem.changed(device={"sample_time_s": 5e-4}), Gains(5.0, 1e4), "mine"),
        Coupling.constant(problem.changed(device={"max_force_n": 3.0}), Gains(5.0, 1e4), "mine"),
        Coupling.constant(problem.changed(coupling={"contact": other_law(problem)}), Gains(5.0, 1e4), "mine"),
    ]
    assert len({made.id, *(one.id for one in others)}) == 7


def test_springs_at_rest_are_in_series_and_dampers_alone_act_in_contact():
    problem = avc.load_problem("ve3").changed(coupling={"contact": "clip-last"})
    wall = problem.environment.stiffness_n_per_m
    sprung, damper = (Coupling.constant(problem, Gains(5.0, k), "mine") for k in (wall, 0.0))
    assert (sprung.static_stiffness_n_per_m, damper.static_stiffness_n_per_m) == (wall / 2, 0.0)
    assert (sprung.contact, damper.contact) == ("clip-last", "gated")


def other_law(problem):
    return "gated" if problem.coupling.contact == "clip-last" else "clip-last"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"problem_file": None}, "problem_file"),
        ({"problem_file": {"device": {"mass_kg": -1.0}}}, "problem_file.device.mass_kg"),
        ({"table": {}}, "table.frequency_hz"),
        ({"runtime": {"estimator": "guess"}}, "runtime.estimator"),
        ({"runtime": {"slew_per_s": "fast"}}, "runtime.slew_per_s"),
        ({"runtime": {"colour": 1}}, "runtime.colour"),
        ({"table": {"flags": [1]}}, "table.flags"),
        ({"certificate": 3}, "certificate"),
        ({"method": "direct\x1b[2J"}, "method"),
    ],
)
def test_every_fault_of_a_file_is_named(change, key, tmp_path):
    made = coupling("ve3")
    avc.write_coupling(made, tmp_path / "c.json")
    document = json.loads((tmp_path / "c.json").read_text())
    (tmp_path / "c.json").write_text(json.dumps(document | change))
    with pytest.raises(InputError) as refused:
        avc.read_coupling(tmp_path / "c.json")
    assert key in {fault.key for fault in refused.value.faults}


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("id", lambda document: document["table"]["stiffness_n_per_m"].__setitem__(0, 5e5)),
        ("id", lambda document: document["problem_file"]["device"].update(mass_kg=5.0)),
        ("id", lambda document: document["problem_file"]["environment"].update(stiffness_n_per_m=1e9)),
        ("id", lambda document: document["runtime"].update(guard="energy-tank")),
        ("lacks", lambda document: document.update(lacks=5)),
    ],
)
def test_a_file_of_which_a_part_was_changed_is_refused(key, change, tmp_path):
    problem = avc.load_problem("figure5")
    path = tmp_path / "c.json"
    avc.write_coupling(Coupling.from_schedule(problem, avc.solve(problem, "exact")), path)
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        avc.read_coupling(path)
    assert key in [fault.key for fault in caught.value.faults]


@pytest.mark.slow
def test_constant_gains_are_one_row_and_long_tables_no_more_than_a_device_holds():
    rows = np.array([[f, 2.0, 300.0, 4.0] for f in np.geomspace(1, 400, 264)])
    one = thinned(GainTable(rows))
    assert one.rows.tolist() == [[1.0, 2.0, 300.0, 4.0]]
    assert (one.constant, one.at_rest) == (True, Gains(2.0, 300.0, 4.0))
    rows[::2, 2] = 600.0
    long = thinned(GainTable(rows))
    assert not long.constant
    assert len(long) <= 256


@pytest.mark.parametrize("value", [-1e-3, float("inf"), float("nan")])
def test_a_runtime_made_in_python_is_refused_with_all_its_faults(value):
    with pytest.raises(InputError) as refused:
        Runtime(hold_s=value, slew_per_s=value, observer_mass_kg=value, estimator="none", hold=1.0)
    of_a_worker = copy.copy(refused.value)  # as pickle does
    keys = [fault.key for fault in of_a_worker.faults]
    assert sorted(keys) == ["estimator", "hold", "hold_s", "observer_mass_kg", "slew_per_s"]
    with pytest.raises(InputError) as inner:
        Runtime(state_feedback={"state": [["x"]], "dead_zone_m": value})
    wrong = {f"state_feedback.{key}" for key in ("state[0][0]", "dead_zone_m", "feedback")}
    assert wrong <= {fault.key for fault in inner.value.faults}


@pytest.mark.parametrize("constant", [True, False])
def test_constant_gains_need_nothing_that_follows_a_frequency(constant):
    kinds = {effect.kind for effect in Runtime(guard="energy-tank").effects(constant=constant)}
    assert kinds == {"guard"} | (set() if constant else {"estimator", "adaptation"})
