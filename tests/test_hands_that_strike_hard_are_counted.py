"""After a hard strike a stable loop may go on for ever at its force limit: counted as on a plant written here."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.pages.recommendation import recommendation_page
from avc_casadi.present.terminal import Page
from avc_casadi.recommendation.strike import STRIKES_M_PER_S, STRIKING, strikes
from avc_casadi.simulation.population.operators import people_of

MASS, DAMPING, FRICTION, T, STEP, LIMIT_N = 0.3, 2.0, 0.3, 1 / 60, 5e-5, 8.0
LOOP = avc.load_problem("spring").changed(
    device={
        "mass_kg": MASS,
        "damping_ns_per_m": DAMPING,
        "sample_time_s": T,
        "delay_samples": 1,
        "coulomb_friction_n": FRICTION,
        "encoder_resolution_m": STEP,
        "max_force_n": LIMIT_N,
    },
    environment={"stiffness_n_per_m": 300.0, "damping_ns_per_m": 0.0},
    frequency={"stop_hz": 20.0},
)


def settled(wall, damper, speed, hand, phase):
    """Return whether hands settle after a strike at a wall with a damper that acts in contact only, and never pulls."""
    mass, total = hand.mass_kg + MASS, DAMPING + hand.damping_ns_per_m
    x, v = np.full(len(hand), -0.05), np.zeros(len(hand))
    seen_before, queue, target, fast = x.copy(), np.zeros(len(hand)), -0.05, np.zeros(len(hand))
    substeps = 400
    h = T / substeps
    for tick in range(round(3.25 / T)):
        seen = STEP * (np.round(x / STEP - phase) + phase)
        force = wall * seen + damper * (seen - seen_before) / T
        force = np.where(seen > 0, np.clip(force, 0.0, LIMIT_N), 0.0)
        seen_before, acting, queue = seen, queue, force
        goal = min(-0.05 + speed * T * (tick + 1), 0.01)
        rate = (goal - target) / T
        for _ in range(substeps):
            target += h * rate
            pull = hand.stiffness_n_per_m * (target - x) + hand.damping_ns_per_m * rate
            free = v + h / mass * (pull - acting - total * v)
            stop = h * FRICTION / mass
            v = np.where(np.abs(free) <= stop, 0.0, free - np.sign(free) * stop)
            x = x + h * v
        if tick * T > 2.75:
            fast = np.maximum(fast, np.abs(v))
    return fast < 5e-3


@pytest.mark.parametrize(("wall", "damper"), [(200.0, 5.0), (400.0, 2.0), (500.0, 11.0)])
def test_as_many_settle_as_on_a_plant_written_here(wall, damper):
    loop = LOOP.changed(environment={"stiffness_n_per_m": wall})
    hands, phases = people_of(LOOP.hands, STRIKING), np.random.default_rng(0).random(STRIKING)
    found = strikes(Coupling.constant(loop, Gains(0.0, 1e9, damper), "mine"))
    assert [float(one) for one in found] == list(STRIKES_M_PER_S)
    for speed, count in found.items():
        assert abs(settled(wall, damper, float(speed), hands, phases).sum() - count) <= 1


def test_it_is_a_row_where_some_go_on_and_none_where_all_settle():
    found = avc.recommend("spring", hands=10)
    document = found.document()
    assert document["felt"]["strikes"] == dict.fromkeys(("0.3", "0.5", "1"), STRIKING)
    assert "Hard strikes" not in recommendation_page(document, found.problem, Page(100))
    document["felt"]["strikes"] |= {"0.5": 31, "1": 30}
    page = recommendation_page(document, found.problem, Page(100))
    assert "! Hard strikes" in page
    assert "31 of 32 at 0.5 m/s, 30 of 32 at 1 m/s" in " ".join(page.split())
