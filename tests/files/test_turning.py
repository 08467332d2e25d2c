"""Files of a device that turns: keys in rad, N.m and kg.m2, read back as written; those of the other motion refused."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from linear_keys import linear_keys

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import GUESSES, regulator
from avc_casadi.design.program import program_answers
from avc_casadi.model.gains import Gains
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.rendered import contact_onset_m, leaving_contact, ripple
from avc_casadi.simulation.population.motions import motions_at

KNOB = """
[device]
motion = "rotary"
handle_radius_m = 0.02
inertia_kgm2 = 3e-5
damping_nms_per_rad = 1e-4
delay_samples = 1
coulomb_friction_nm = 0.002
encoder_counts_per_turn = 16384
max_torque_nm = 0.2
[environment]
stiffness_nm_per_rad = 1.0
damping_nms_per_rad = 0.0
[coupling]
structure = "damped"
contact_damping_nms_per_rad = [0.0, 0.05]
[frequency]
values_hz = [1.0, 10.0, 60.0]
[scene]
duration_s = 1.0
"""


def test_keys_of_the_other_motion_are_refused_at_once():
    wrong = KNOB.replace("inertia_kgm2", "mass_kg").replace("stiffness_nm_per_rad", "stiffness_n_per_m")
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(wrong.replace("coulomb_friction_nm = 0.002", "coulomb_friction_nm = -1"))
    lines = {fault.key: fault.line for fault in refused.value.faults}
    assert set(lines) == {"device.mass_kg", "environment.stiffness_n_per_m", "device.coulomb_friction_nm"}
    assert lines["device.coulomb_friction_nm"] == 8
    with pytest.raises(avc.InputError) as refused:
        avc.parse_problem(KNOB.replace('motion = "rotary"\nhandle_radius_m = 0.02', ""))
    wrong = {"device.inertia_kgm2", "environment.stiffness_nm_per_rad", "device.encoder_counts_per_turn"}
    assert wrong | {"device.max_torque_nm"} <= {fault.key for fault in refused.value.faults}


def test_a_problem_is_written_and_read_in_its_own_keys():
    problem = avc.parse_problem(KNOB, name="knob")
    text = avc.dump_problem(problem)
    assert linear_keys(text) == []
    assert avc.parse_problem(text, name="knob") == problem


# A device that turns is the linear one at its handle: m = J/r^2, b = B/r^2, f = tau/r, x = r theta, and nothing else.

FREQUENCY = {"values_hz": (1.0, 5.0, 30.0, 120.0)}
# Powers of the radius with which a value of the handle becomes one of the turn, and its key there.
POWERS = {
    "mass_kg": (2, "inertia_kgm2"),
    "damping_ns_per_m": (2, "damping_nms_per_rad"),
    "stiffness_n_per_m": (2, "stiffness_nm_per_rad"),
    "coulomb_friction_n": (1, "coulomb_friction_nm"),
    "max_force_n": (1, "max_torque_nm"),
    "encoder_resolution_m": (-1, "encoder_resolution_rad"),
}

DEVICES = st.fixed_dictionaries(
    {
        "mass_kg": st.floats(0.03, 0.5),
        "damping_ns_per_m": st.floats(0.2, 5.0),
        "delay_samples": st.sampled_from([0, 1, 2]),
        "coulomb_friction_n": st.sampled_from([0.0, 0.1, 0.4]),
        "encoder_resolution_m": st.sampled_from([0.0, 1e-5, 5e-5]),
        "max_force_n": st.floats(2.0, 30.0),
    }
)
WALLS = st.fixed_dictionaries(
    {"stiffness_n_per_m": st.floats(300.0, 5000.0), "damping_ns_per_m": st.sampled_from([0.0, 1.0, 5.0])}
)


def written(table, radius):
    turned = ((key, value, *POWERS.get(key, (0, key))) for key, value in table.items())
    return "\n".join(f"{name} = {value * radius**power!r}" for _, value, power, name in turned)


def both(device, wall, radius):
    linear = Problem(name="p", device=device, environment=wall, frequency=FREQUENCY)
    text = f'[device]\nmotion = "rotary"\nhandle_radius_m = {radius}\n{written(device, radius)}\n'
    text += f"[environment]\n{written(wall, radius)}\n[frequency]\nvalues_hz = {list(FREQUENCY['values_hz'])}"
    return linear, avc.parse_problem(text, name="p")


def same(linear, rotary, power, radius, rel=1e-12):
    np.testing.assert_allclose(
        np.asarray(linear) * radius**power, rotary, rtol=rel, atol=0.0, equal_nan=True, verbose=True
    )


@pytest.mark.slow
@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(device=DEVICES, wall=WALLS, power=st.integers(-5, 1))
def test_design_and_certificate_are_those_of_the_handle(device, wall, power):
    radius = 2.0**power
    linear, rotary = both(device, wall, radius)
    for one, other in zip(vars(linear.hands).items(), vars(rotary.hands).items(), strict=True):
        if one[0] != "let_go":
            same(one[1], other[1], 2, radius)
    one, other = avc.solve(linear, "exact"), avc.solve(rotary, "exact")
    assert one.status == other.status
    for name in ("damping_ns_per_m", "stiffness_n_per_m", "real_part", "magnitude_error"):
        same(getattr(one, name), getattr(other, name), 2, radius, 1e-9)
    plain = [
        Coupling.constant(problem, Gains(0.0, 1e8 * scale, 2.0 * scale), "mine")
        for problem, scale in ((linear, 1.0), (rotary, radius**2))
    ]
    pairs = [plain, *([(one, other)] if one.usable.any() else [])]
    for first, second in pairs:
        found, turning = avc.certify(linear, first), avc.certify(rotary, second)
        for level, judged in found.levels.items():
            beside = turning.levels[level]
            assert judged.outcome == beside.outcome, level
            if level != "L4":  # of a coupling that is nearly rigid, a difference of two huge numbers
                same(judged.margin_ns_per_m, beside.margin_ns_per_m, 2, radius, 1e-6)


@settings(max_examples=4, deadline=None)
@given(device=DEVICES, wall=WALLS, power=st.integers(-5, 1), kind=st.sampled_from(["press", "tap", "hold"]))
def test_a_scene_is_that_of_the_handle(device, wall, power, kind):
    radius = 2.0**power
    problems = [
        problem.changed(scene={"motion": motions_at(problem.device)[kind]}) for problem in both(device, wall, radius)
    ]
    gains = Gains(0.0, 1e8, 3.0), Gains(0.0, 1e8 * radius**2, 3.0 * radius**2)
    one, other = (avc.simulate(problem, chosen) for problem, chosen in zip(problems, gains, strict=True))
    assert (one.claim, one.buzzing) == (other.claim, other.buzzing)
    np.testing.assert_allclose(one.position_m / radius, other.position_m, rtol=1e-6, atol=1e-9 / radius)
    np.testing.assert_allclose(one.force_n * radius, other.force_n, rtol=1e-6, atol=1e-6 * radius)
    assert one.energy_generated_j == pytest.approx(other.energy_generated_j, rel=1e-6, abs=1e-12)


@pytest.mark.slow
def test_a_law_is_that_of_the_handle():
    radius = 0.125
    device = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "delay_samples": 1, "encoder_resolution_m": 2e-5}
    linear, rotary = both(device, {"stiffness_n_per_m": 3000.0, "damping_ns_per_m": 0.0}, radius)
    one, other = (program_answers(problem)[0].performance for problem in (linear, rotary))
    assert one.error == pytest.approx(other.error, rel=0.02)
    assert one.disk_margin == pytest.approx(other.disk_margin, rel=0.02)
    assert one.noise_n_per_m * radius**2 == pytest.approx(other.noise_n_per_m, rel=0.05)


def test_what_is_felt_is_what_is_felt_at_the_handle():
    radius, device = 0.125, {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "encoder_resolution_m": 5e-5, "max_force_n": 8.0}
    problems = both(device, {"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 2.0}, radius)
    one, other = (
        Coupling.constant(problem, Gains(0.0, 1e8 * scale, 3.0 * scale), "mine")
        for problem, scale in zip(problems, (1.0, radius**2), strict=True)
    )
    same([*ripple(one).force_n.values()], [*ripple(other).force_n.values()], 1, radius, 0.02)
    same([*contact_onset_m(one).values()], [*contact_onset_m(other).values()], -1, radius, 1e-6)


def test_a_force_outside_the_wall_after_a_press_is_that_at_the_handle():
    radius, device = 0.125, {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "encoder_resolution_m": 5e-5, "delay_samples": 3}
    problems = both(device, {"stiffness_n_per_m": 6000.0, "damping_ns_per_m": 0.0}, radius)
    found = []
    for problem in problems:
        law = regulator(problem.device, problem.hands, problem.environment.stiffness_n_per_m, GUESSES[0])
        gains, runtime = Gains(0.0, 1e8 * problem.device.metres_per_unit**2), Runtime(state_feedback=law)
        found.append(leaving_contact(Coupling.constant(problem, gains, "mine", runtime)))
    linear, rotary = found
    assert linear.lasting_s == rotary.lasting_s > 0.02
    # The numbers of both laws are rounded to single precision.
    assert linear.outside_m / radius == pytest.approx(rotary.outside_m, rel=0.01)
    assert linear.force_n * radius == pytest.approx(rotary.force_n, rel=0.01)
