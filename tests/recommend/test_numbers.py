"""Numbers beside a recommendation, each worked out by hand: stiffness at the handle, steps of force, limits, hands."""

from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.recommendation.deployed import deployed
from avc_casadi.recommendation.preconditions import nothing_rendered
from avc_casadi.recommendation.recommendation import Recommendation
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of

STEP_M, T = 2e-5, 1e-3
MODE = {"frequency_hz": 120.0, "damping_ratio": 0.05, "mass_ratio": 0.3}
WALL = {"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 4.0}
PROBLEM = avc.load_problem("spring").changed(
    device={"mass_kg": 0.2, "encoder_resolution_m": STEP_M, "resonance": MODE, "encoder_at": "motor"}, environment=WALL
)
COUPLING = Coupling.constant(PROBLEM, Gains(0.0, 1e8, 3.0), "contact damper")


def test_behind_an_encoder_at_the_motor_the_structure_gives_way_too():
    """Two free bodies on a spring K swing at w^2 = K (1/m1 + 1/m2): the spring of the structure from its frequency."""
    people = people_of(PROBLEM.hands, 4)
    none = dict.fromkeys(("confirmed", "off_file", "rest", "with_friction_n_per_m"))
    empty = dict.fromkeys(("beyond_file", "helps", "assumed", "not_used"), ()) | {"reason": ""}
    walls = dict.fromkeys(("stiffest_wall_n_per_m", "plain_wall_n_per_m"), 0.0)
    trial = try_coupling(COUPLING, people)
    answer = Recommendation(
        problem=PROBLEM, coupling=COUPLING, trial=trial, deployable=True, considered=1, **none, **empty, **walls
    )
    felt = answer.felt()
    masses = 0.2 * 0.7, 0.2 * 0.3
    structure = (2 * np.pi * 120.0) ** 2 / (1 / masses[0] + 1 / masses[1])
    at_sensor = felt["stiffness_n_per_m"]
    assert at_sensor == pytest.approx(2000.0, rel=0.01)
    assert 1 / felt["stiffness_at_handle_n_per_m"] == pytest.approx(1 / at_sensor + 1 / structure)
    # One step of the encoder: the spring's force goes by k q, that of both dampers by (b + b_p) q/T for a sample.
    assert felt["encoder_step_n"] == pytest.approx({"spring": 2000.0 * STEP_M, "damping": 7.0 * STEP_M / T}, rel=1e-3)


@pytest.mark.parametrize(("limit_n", "nothing"), [(1.0, True), (3.0, False), (50.0, False)])
def test_nothing_is_rendered_where_one_step_of_the_encoder_asks_for_more_than_the_device_gives(limit_n, nothing):
    coarse = PROBLEM.changed(device={"encoder_resolution_m": 1e-3, "max_force_n": limit_n})
    pressed = SimpleNamespace(stiffness=2000.0, at_force_limit=np.zeros(1, dtype=bool))
    told = nothing_rendered(coarse, 2000.0, pressed)
    assert bool(told) == nothing


@pytest.mark.parametrize(
    ("friction_n", "limit_n", "blamed"), [(100.0, 8.0, True), (11.0, None, True), (2.0, 8.0, False)]
)
def test_dry_friction_that_no_press_overcomes_is_blamed_for_it(friction_n, limit_n, blamed):
    stuck = PROBLEM.changed(device={"coulomb_friction_n": friction_n, "max_force_n": limit_n})
    pressed = SimpleNamespace(stiffness=np.nan, at_force_limit=np.zeros(1, dtype=bool))
    told = nothing_rendered(stuck, 2000.0, pressed)
    assert (f"dry friction (device.coulomb_friction_n, {friction_n:g})" in told) == blamed
    assert ("device.encoder_resolution_m" in told) != blamed


def test_the_worst_hand_is_the_one_with_the_least_damped_pole():
    found = deployed(COUPLING)
    ratios = []
    for loop in found.loop.closed[:-1]:
        poles = np.linalg.eigvals(loop)
        rate = np.log(poles[(np.abs(np.angle(poles)) > 1e-6) & (np.abs(poles) > 1e-9)])
        ratios.append(np.min(-rate.real / np.abs(rate)))
    assert len(ratios) == len(found.hands) > 2
    assert found.worst == np.argmin(ratios) != np.argmax(ratios)
