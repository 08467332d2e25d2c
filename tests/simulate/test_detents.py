"""Detents: the scene against a simulation of its own, the certificate's slopes against what the scene then does."""

import math

import numpy as np
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import damping_range, in_contact
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import released_hand

T = 1e-3
KNOB = """
[device]
motion = "rotary"
handle_radius_m = 0.02
inertia_kgm2 = 3e-5
damping_nms_per_rad = 1e-4
delay_samples = {delay}
[environment]
stiffness_nm_per_rad = {wall}
damping_nms_per_rad = 0.0
[detent]
torque_nm = {torque}
per_turn = {count}
width = {width}
centre_rad = -0.11
damping_nms_per_rad = {damping}
[scene]
duration_s = 1.5
[scene.motion]
kind = "stroke"
start_rad = -1.2
end_rad = -0.4
amplitude_rad = 0.3
speed_rad_per_s = 3.0
frequency_hz = 2.0
"""


def knob(torque=0.01, count=24, width=0.7, damping=0.0005, delay=1, wall=0.5):
    text = KNOB.format(torque=torque, count=count, width=width, damping=damping, delay=delay, wall=wall)
    return avc.parse_problem(text, name="knob")


def by_hand(problem, target, velocity, hand):
    """Inertia, damper and hand exactly over a sample; the held torque from the angle a sample before."""
    j, b, k = (3e-5 + hand["mass_kg"], 1e-4 + hand["damping_ns_per_m"], hand["stiffness_n_per_m"])
    whole = np.zeros((5, 5))  # angle, speed, torque, target, speed of the target
    whole[0, 1] = whole[3, 4] = 1.0
    whole[1] = [-k / j, -b / j, -1 / j, k / j, hand["damping_ns_per_m"] / j]
    step = expm(whole * T)
    one, pitch = problem.detent, 2 * math.pi / 24
    angle, speed, before, asked = target[0], 0.0, target[0], 0.0
    angles = []
    for aim, rate in zip(target, velocity, strict=True):
        angles.append(angle)
        off = (angle + 0.11) / pitch
        u = (off - math.floor(off + 0.5)) / one.width
        torque = 0.01 * math.sin(2 * math.pi * u) if abs(u) < 0.5 else 0.0
        torque += 0.0005 * (angle - before) / T + max(0.0, 0.5 * angle)
        before, acts, asked = angle, asked, torque
        angle, speed, *_ = step @ [angle, speed, acts, aim, rate]
    return np.array(angles)


def test_the_scene_is_that_of_a_simulation_of_its_own():
    problem = knob()
    found = avc.simulate(problem, Coupling.constant(problem, Gains(0.0, 1e8), "rigid"))
    hands = problem.hands
    hand = {name: sum(getattr(hands, name)) / 2 for name in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")}
    velocity = np.append(np.diff(found.target_m), found.target_m[-1] - found.target_m[-2]) / T
    angles = by_hand(problem, found.target_m, velocity, hand)
    assert np.ptp(angles) > 0.5  # over several detents
    np.testing.assert_allclose(found.position_m, angles, atol=1e-7)
    assert found.energy_generated_j < 1e-3


def test_what_is_claimed_of_a_valley_is_what_the_device_does_let_go():
    """Just within the damping that holds the slope the device comes to rest in a valley; just outside it does not."""
    free = released_hand()
    problem = knob(torque=0.02, wall=0.0)
    limits = damping_range(PlantFamily.of(problem).released, problem.detent.slope_n_per_m)
    assert limits.lowest_ns_per_m > 0
    for share, rests in ((1.3, True), (0.7, False)):
        one = knob(torque=0.02, damping=share * limits.lowest_ns_per_m, wall=0.0)
        verdict = deployable(Coupling.constant(one, Gains(0.0, 1e8), "rigid"))
        claim = next(claim for claim in verdict.claims if claim.name == "detent")
        assert (
            claim.passed
            == (
                in_contact([one.device], free, one.detent.slope_n_per_m, share * limits.lowest_ns_per_m).radius.max()
                < 1
            )
            == rests
        )
        if not rests:
            assert "in a valley" in claim.sentence
