"""What a call is given in place of its numbers, names and tables is refused by name: no other exception leaves it."""

import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from quick import first

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains

JOINT = {"simulation": {"tool_mass_kg": 0.01, "step_s": 0.005, "integrator": "implicit-damping"}}
PROBLEM = avc.load_problem("soft").changed(frequency={"points": 2})
COUPLING = Coupling.constant(PROBLEM, Gains(1.0, 100.0), "x")


class System:
    """A discrete system with any matrices."""

    def __init__(self, a=0.5, b=1.0, c=1.0, d=300.0, dt=PROBLEM.device.sample_time_s):
        self.A, self.B, self.C, self.D, self.dt = a, b, c, d, dt


def law(**stated):
    return avc.certify_law(PROBLEM, **stated, remedies=False, limits=False)


# Each call takes one value, which is no number, name, table or path that it accepts.
CALLS = {
    "certify_law k": lambda value: law(k=value, b=1.0),
    "certify_law b": lambda value: law(k=100.0, b=value),
    "certify_law b_p": lambda value: law(k=100.0, b_p=value),
    "certify_law cutoff_hz": lambda value: law(k=100.0, b=1.0, cutoff_hz=value),
    "certify_law law": lambda value: law(law=value),
    "certify_law law value": lambda value: law(law={"stiffness_n_per_m": value}),
    "system A": lambda value: law(law=System(a=value)),
    "system B": lambda value: law(law=System(b=value)),
    "system C": lambda value: law(law=System(c=value)),
    "system D": lambda value: law(law=System(d=value)),
    "system dt": lambda value: law(law=System(dt=value)),
    "certify_joint kp": lambda value: avc.certify_joint(JOINT, kp=value, kd=1.0),
    "certify_joint kd": lambda value: avc.certify_joint(JOINT, kp=1.0, kd=value),
    "recommend_joint": lambda value: avc.recommend_joint(JOINT, frequency_hz=value),
    "certify_admittance law": lambda value: avc.certify_admittance("admittance/cobot", law=value),
    "certify_admittance value": lambda value: avc.certify_admittance("admittance/cobot", law={"mass_kg": value}),
    "certify_force_feedback law": lambda value: avc.certify_force_feedback("admittance/guided", law=value),
    "compare mine": lambda value: avc.compare(PROBLEM, mine=value),
    "compare mine k": lambda value: avc.compare(PROBLEM, mine=(value, 1.0)),
    "compare methods": lambda value: avc.compare(PROBLEM, methods=value),
    "solve method": lambda value: avc.solve(PROBLEM, value),
    "solve solver": lambda value: avc.solve(PROBLEM, "direct", solver=value),
    "solve tolerance": lambda value: avc.solve(PROBLEM, "direct", tolerance=value),
    "recommend hands": lambda value: avc.recommend(PROBLEM, value),
    "recommend seed": lambda value: avc.recommend(PROBLEM, seed=value),
    "certify gains": lambda value: avc.certify(PROBLEM, value),
    "certify draws": lambda value: avc.certify(PROBLEM, COUPLING, draws=value),
    "certify seed": lambda value: avc.certify(PROBLEM, COUPLING, seed=value),
    "simulate gains": lambda value: avc.simulate(PROBLEM, value),
    "simulate seed": lambda value: avc.simulate(PROBLEM, COUPLING, seed=value),
    "simulate hand": lambda value: avc.simulate(PROBLEM, COUPLING, hand=value),
    "screen tolerance": lambda value: avc.screen(PROBLEM, COUPLING, tolerance=value),
    "simulate_batch hands": lambda value: avc.simulate_batch(PROBLEM, value, COUPLING),
    "deployable": avc.deployable,
    "dump_problem": avc.dump_problem,
    "parse_problem": avc.parse_problem,
    "load_problem": avc.load_problem,
    "load_device": avc.load_device,
    "load_admittance": avc.load_admittance,
    "catalogue_path": avc.catalogue_path,
    "read_coupling": avc.read_coupling,
    "write_coupling": lambda value: avc.write_coupling(value, "c.json"),
    "write_coupling path": lambda value: avc.write_coupling(COUPLING, value),
    "zwidth": avc.zwidth,
    "mass_width": avc.mass_width,
    "recommend": avc.recommend,
    "recommend_admittance": avc.recommend_admittance,
    "recommend_force_feedback": avc.recommend_force_feedback,
    "problem changed": lambda value: PROBLEM.changed(device={"mass_kg": value}),
    "problem table": lambda value: PROBLEM.changed(device=value),
}
WRONG = st.one_of(
    st.sampled_from(
        [
            "x",
            "\0.json",
            "no_folder/c.json",
            "3 N/mm",
            True,
            -1,
            math.nan,
            math.inf,
            1e300,
            10**400,
            1j,
            [1.0],
            (1.0, 2.0, 3.0),
            [[1.0], [1.0, 2.0]],
            ("a", "b"),
            {"a": 1},
            b"x",
            object(),
            np.array([1.0, 2.0]),
            np.zeros((2, 3)),
            np.ones((1, 1, 1)),
            np.array("x"),
            float,
        ]
    ),
    st.complex_numbers(),
    st.text(max_size=3).filter(str.strip),
    st.lists(st.one_of(st.booleans(), st.text(max_size=2)), min_size=1, max_size=3),
)


@pytest.mark.parametrize("call", first(CALLS.values(), 5), ids=CALLS)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(value=WRONG)
def test_no_other_exception_leaves_a_call(call, value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with suppress(avc.AvcError):  # a value that happens to be right has an answer
        call(value)


def test_a_coupling_is_written_only_where_it_is_read_again(tmp_path):
    for path in (None, tmp_path / "c.txt", str(tmp_path / "c.csv"), tmp_path, tmp_path / "none" / "c.json"):
        with pytest.raises(avc.InputError):
            avc.write_coupling(COUPLING, path)
    avc.write_coupling(COUPLING, tmp_path / "c.json")
    assert avc.read_coupling(tmp_path / "c.json") == COUPLING


@pytest.mark.parametrize(
    ("part", "value", "says"),
    [
        ("a", np.eye(2), "A n by n"),
        ("a", np.zeros((2, 3)), "A n by n"),
        ("b", np.ones(3), "A n by n"),
        ("b", [[0.5j]], "real numbers"),
        ("a", "a", "real numbers"),
        ("c", [[1.0], [1.0, 2.0]], "real numbers"),
        ("d", math.nan, "finite"),
        ("d", 1e300, "finite"),
        ("d", np.zeros((2, 2)), "one of each"),
        pytest.param("dt", 10**400, "dt = an integer", id="dt-huge"),
    ],
)
def test_what_is_no_discrete_system_of_real_numbers_is_refused(part, value, says):
    with pytest.raises(avc.InputError, match=says) as raised:
        law(law=System(**{part: value}))
    assert raised.value.faults[0].key == "law"


def test_an_admittance_device_is_led_to_the_calls_that_take_it():
    with pytest.raises(avc.UnsupportedError, match="mass_width"):
        avc.zwidth("admittance/cobot")
