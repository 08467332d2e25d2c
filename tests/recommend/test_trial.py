"""A heavy device in a loose hand swings for seconds with no wall near; no coupling is blamed for that."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import StateSpace, lsim

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import hand_corners
from avc_casadi.simulation.judge import AT_REST_M_PER_S
from avc_casadi.simulation.motion import target_of
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.motions import LONGEST_S, MOTIONS, TRIAL_S, course_of
from avc_casadi.simulation.population.settled import residual_speeds, settled_hands

JUDGED_S = 0.5
R1 = avc.load_problem("reference-r1")
# 5 kg without damping, held by 50 to 300 g with 3 to 20 N.s/m: one swing dies away in 2 m / b, up to 3.5 s.
HEAVY = avc.load_problem("figure5").changed(
    device={"mass_kg": 5.0, "damping_ns_per_m": 0.0, "delay_samples": 1},
    environment={"stiffness_n_per_m": 1000.0, "damping_ns_per_m": 0.0},
)
PEOPLE = hand_corners(HEAVY.hands)


def softly(problem, contact_damping_ns_per_m=30.0):
    gains = Gains(0.0, 1000.0, contact_damping_ns_per_m)
    return Coupling.constant(problem, gains, "by hand")


def speed_alone(problem, motion, duration_s):
    """Largest speed at the end, of all hands with the device and no wall, over that of rest, by scipy."""
    step = problem.device.sample_time_s
    target = target_of(motion, round(duration_s / step), step)
    time, drive = np.arange(len(target.position_m)) * step, np.c_[target.position_m, target.velocity_m_per_s]
    found = []
    hands = hand_corners(problem.hands)
    for hand_mass, damping, stiffness in zip(*vars(hands).values(), strict=True):
        mass = problem.device.mass_kg + hand_mass
        total = damping + problem.device.damping_ns_per_m
        moves = [[0, 1], [-stiffness / mass, -total / mass]], [[0, 0], [stiffness / mass, damping / mass]]
        plant = StateSpace(*moves, np.eye(2), np.zeros((2, 2)))
        _, state, _ = lsim(plant, drive, time, X0=[target.position_m[0], 0])
        found.append(np.abs(state[-round(JUDGED_S / step) :, 1]).max())
    return max(found) / AT_REST_M_PER_S


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(mass=st.floats(0.02, 5.0), damping=st.just(0.0) | st.floats(1e-3, 20.0))
def test_without_a_wall_everybody_is_at_rest_at_the_end(mass, damping):
    problem = R1.changed(device={"mass_kg": mass, "damping_ns_per_m": damping})
    motion, duration_s = course_of(problem).motions["tap"]
    assert speed_alone(problem, motion, duration_s) < 1.25
    assert TRIAL_S <= duration_s <= LONGEST_S


def test_the_motion_is_the_same_until_the_longer_rest():
    (short, short_s), (longer, longer_s) = (MOTIONS["tap"], TRIAL_S), course_of(HEAVY).motions["tap"]
    step = HEAVY.device.sample_time_s
    before, after = (
        target_of(one, round(s / step), step).position_m for one, s in ((short, short_s), (longer, longer_s))
    )
    assert longer_s > 15
    np.testing.assert_array_equal(after[: len(before)], before)
    assert np.ptp(after[len(before) :]) == 0
    assert speed_alone(HEAVY, short, short_s) > 10


def test_a_heavy_device_that_is_only_slow_counts_as_at_rest():
    coupling = softly(HEAVY)
    trial = try_coupling(coupling, PEOPLE)
    assert speed_alone(HEAVY, MOTIONS["tap"], TRIAL_S) > 10
    assert trial.stable.all()
    assert trial.longest_s == trial.document()["longest_s"] == course_of(HEAVY).longest_s
    assert np.isfinite(trial.vibration).all()
    assert settled_hands(coupling, 40, seed=3).at_rest == 40
    assert (residual_speeds([coupling], PEOPLE) < 1).all()


@pytest.mark.thorough
def test_everybody_is_judged_alone_as_among_the_others():
    together = try_coupling(softly(HEAVY), PEOPLE)
    alone = [try_coupling(softly(HEAVY), PEOPLE.pick(slice(row, row + 1))) for row in range(len(PEOPLE))]
    for figure in ("stable", "stiffness_n_per_m", "vibration", "tap_depth_m", "at_force_limit"):
        each = np.concatenate([getattr(one, figure) for one in alone])
        np.testing.assert_allclose(each, getattr(together, figure), rtol=1e-6, atol=1e-12)
