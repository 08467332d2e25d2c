"""A wall behind an observer rests when it is hardly touched, in loose hands and behind a coarse encoder too."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.scene import Press
from avc_casadi.simulation.population.operators import loose_grips
from avc_casadi.simulation.population.trial import Conditions, judged


@pytest.fixture(scope="module")
def touched():
    """60 g in place of 100, 55 um: a law for a press of 10 mm alone leaves every third loose hand buzzing."""
    device = {
        "mass_kg": 0.06,
        "damping_ns_per_m": 0.3,
        "coulomb_friction_n": 0.0,
        "encoder_resolution_m": 5.5e-5,
        "max_force_n": 10.0,
        "amplifier_bandwidth_hz": None,
        "resonance": None,
    }
    wall = {"stiffness_n_per_m": 15e3, "damping_ns_per_m": 0.0}
    return avc.recommend(avc.load_problem("reference-r1").changed(device=device, environment=wall), hands=40)


@pytest.mark.thorough
@pytest.mark.parametrize("end_m", [2e-4, 5e-4, 1e-3, 2e-3])
def test_loose_hands_that_touch_lightly_come_to_rest(touched, end_m):
    coupling = touched.coupling
    assert coupling.runtime.state_feedback is not None
    assert touched.felt()["stiffness_n_per_m"] > 10e3
    hands, gains = touched.problem.hands, Gains(**vars(coupling.table.at_rest))
    for people in (hand_corners(hands), loose_grips(hands, 100, 5)):
        run = judged(touched.problem, gains, people, Press(end_m=end_m, speed_m_per_s=0.03), Conditions.of(coupling))
        assert np.count_nonzero(~run.stable) <= (5 if end_m < 5e-4 else 2)
