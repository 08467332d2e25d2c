"""The table: only its column without coupling was fitted, everything else follows, the same for the same seed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import avc_casadi as avc
from avc_casadi.design.comparison.table1 import choose, distance, reference_traces, table1
from avc_casadi.simulation.judge import Traces
from avc_casadi.simulation.population.motions import MOTIONS
from avc_casadi.simulation.population.operators import draw_population

COUPLINGS = ("none", "static", "closed-form", "static-tuned", "schedule")


@pytest.fixture(scope="module")
def table():
    return table1(12, 5, walls=("VE7",), couplings=COUPLINGS)


@pytest.mark.slow
def test_prediction_at_the_stiff_wall(table):
    rows = {row.coupling: row for row in table.rows}
    assert rows["none"].stable == 0
    for tuned in ("static-tuned", "schedule"):
        assert rows[tuned].stable == rows[tuned].asymptotic == 12
        assert rows[tuned].apparent_stiffness_n_per_m == pytest.approx(1e5, rel=0.08)
    assert rows["static"].stable == 12
    assert rows["static"].apparent_stiffness_n_per_m < 2e4
    assert rows["schedule"].matched == 12
    assert rows["schedule"].matched_against == "static"
    # Nobody can tell constant gains from scheduled ones.
    assert rows["static-tuned"].unable == 12


# Choosing between two couplings: Weber's law on traces, against a reference that knows no samples.

far = st.one_of(st.floats(0, 10), st.just(np.inf))
fraction = st.sampled_from([0.07, 0.1, 0.23])


@given(far, far, fraction)
def test_choice_is_fair_and_needs_a_noticeable_difference(one, other, weber):
    first, second = np.array([one]), np.array([other])
    nearer, farther = choose(first, second, weber)
    assert choose(second, first, weber) == (farther, nearer)
    assert not (nearer and farther)
    if max(one, other) <= weber or one == other or abs(one - other) <= weber:
        assert not nearer
        assert not farther
    else:
        assert nearer if one < other else farther


def test_a_share_more_force_is_that_share_away():
    force = np.concatenate([np.zeros(50), np.linspace(0, 5, 100)])[None]
    real = Traces(force / 1e4, 0 * force, force, 1e-3)
    assert distance(real, real) == [0]
    assert distance(Traces(real.position_m, 0 * force, 1.2 * force, 1e-3), real) == pytest.approx([0.2])
    assert distance(Traces(0.7 * real.position_m, 0 * force, force, 1e-3), real) == pytest.approx([0.3])
    assert distance(Traces(real.position_m * np.nan, 0 * force, force, 1e-3), real) == [np.inf]


def continuous_press(problem, hand):
    """Integrate the hand against the wall of the textbook, K x + B v in contact and never pulling."""
    wall, device, motion = problem.environment, problem.device, MOTIONS["press"]
    mass = device.mass_kg + hand["mass_kg"]

    def rates(time, state):
        x, v = state
        arrival = (motion.end_m - motion.start_m) / motion.speed_m_per_s
        aim = motion.start_m + motion.speed_m_per_s * min(time, arrival)
        aim_v = motion.speed_m_per_s if time < arrival else 0.0
        push = max(wall.stiffness_n_per_m * x + wall.damping_ns_per_m * v, 0.0) if x > 0 else 0.0
        pull = hand["stiffness_n_per_m"] * (aim - x) + hand["damping_ns_per_m"] * (aim_v - v)
        return [v, (pull - push - device.damping_ns_per_m * v) / mass]

    time = np.arange(1000) * device.sample_time_s
    return solve_ivp(rates, (0, 1), [motion.start_m, 0.0], t_eval=time, max_step=1e-4, rtol=1e-8, atol=1e-10).y[0]


@pytest.mark.parametrize("wall", ["ve4"])
def test_the_reference_is_the_continuous_wall(wall):
    problem = avc.load_problem(wall).changed(device={"coulomb_friction_n": 0.0})
    people = draw_population("A", 1, 4)
    reference = reference_traces(problem, people)
    exact = continuous_press(problem, people.values(0))
    touched = exact > 0
    error = np.sqrt(np.mean((reference.position_m[0, :1000] - exact)[touched] ** 2) / np.mean(exact[touched] ** 2))
    assert error < 0.04
