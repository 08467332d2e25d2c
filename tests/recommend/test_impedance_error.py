"""The impedance error that is told is that of a handle shaken before a plant and a law written here."""

from dataclasses import replace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import regulator
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.shaken import shaken

T, WALL, MASS, DAMPING = 1e-3, 20e3, 0.2, 1.0
BASE = {"mass_kg": MASS, "damping_ns_per_m": DAMPING, "sample_time_s": T, "max_force_n": 8.0}


def problem(wall=WALL, damper=0.0, **device):
    return avc.load_problem("spring").changed(
        device=BASE | device, environment={"stiffness_n_per_m": wall, "damping_ns_per_m": damper}
    )


def measured(force_of, depth, amplitude, hz, late=0.0):
    """Lead the handle along depth + amplitude sin(2 pi f t); return Z_h from the force that is held, as told."""
    each = round(1 / (hz * T))
    count = each * round(max(4 * hz, 8)) + 1000
    time = T * np.arange(count)
    x = depth * np.minimum(time / 0.25, 1) + amplitude * np.sin(2 * np.pi * hz * np.maximum(time - 0.25, 0))
    force = force_of(x)
    last = slice(count - each * round(max(2 * hz, 4)), count)
    wave = np.exp(-2j * np.pi * hz * time[last])
    s = 2j * np.pi * hz
    stiffness = ((force[last] - force[last].mean()) @ wave) / ((x[last] - x[last].mean()) @ wave)
    hold = (1 - np.exp(-s * T)) / (s * T) * np.exp(-s * T * late)
    return MASS * s + DAMPING + stiffness * hold / s


def relative(found, hz, wall=WALL, damper=0.0):
    s = 2j * np.pi * hz
    wanted = MASS * s + DAMPING + damper + wall / s
    return abs(found - wanted) / abs(wanted)


def told_and_measured(coupling, felt, force_of, hz, late=0.0, **wall):
    told = shaken(coupling, felt, [hz])
    return told.error[0], relative(measured(force_of, told.depth_m, told.amplitude_m, hz, late), hz, **wall)


@pytest.mark.parametrize("hz", [1.0, 10.0, 50.0])
def test_of_a_contact_damper_behind_a_coarse_encoder(hz):
    step, damper = 30e-6, 25.0
    coupling = Coupling.constant(problem(encoder_resolution_m=step, delay_samples=1), Gains(0.0, 1e12, damper), "mine")

    def force_of(x):
        z = np.round(x / step) * step
        before = np.concatenate([z[:1], z[:-1]])
        force = WALL * z + damper * (z - before) / T
        return np.where((z > 0) & (force > 0), force, 0.0)

    told, found = told_and_measured(coupling, WALL, force_of, hz, late=1.0)
    assert told == pytest.approx(found, rel=0.1, abs=1e-3)  # where the steps fall differs a little


@pytest.mark.parametrize("hz", [1.0, 10.0])
def test_of_a_law_with_a_dead_zone(hz):
    step = 15e-6
    stated = problem(encoder_resolution_m=step)
    law = regulator(stated.device, stated.hands, WALL, 0)
    coupling = Coupling.constant(stated, Gains(0.0, 1e12), "mine", Runtime(state_feedback=law))
    a, b, gain, weight = (np.array(part) for part in (law.state, law.force_m_per_n, law.innovation, law.feedback))

    def force_of(x):
        state, forces = np.zeros(len(b)), []
        for z in np.round(x / step) * step + law.face_m:
            error = z - state[law.measures]
            state = state + gain * np.sign(error) * max(abs(error) - law.dead_zone_m, 0.0)
            force = max(WALL * (weight @ state), 0.0)
            state = a @ state + b * force
            forces.append(force)
        return np.array(forces)

    told, found = told_and_measured(coupling, WALL, force_of, hz)
    assert told == pytest.approx(found, rel=0.05, abs=5e-3)
    linear = shaken(
        Coupling.constant(problem(), Gains(0.0, 1e12), "mine", Runtime(state_feedback=replace(law, dead_zone_m=0.0))),
        WALL,
        [hz],
    )
    assert abs(found - linear.error[0]) > 0.1 * found, "the dead zone has a part in it"


def test_what_is_rendered_is_felt_beside_the_mass_and_the_damping_of_the_device():
    """Of a wall as soft as the device's own damper is at 50 Hz."""
    hz, wall = 50.0, 400.0
    told = shaken(Coupling.constant(problem(wall), Gains(0.0, 1e12), "mine"), wall, [hz])
    s = 2j * np.pi * hz
    felt = measured(lambda x: wall * x, told.depth_m, told.amplitude_m, hz) - MASS * s - DAMPING
    assert told.stiffness_n_per_m[0] == pytest.approx(abs(felt * s), rel=0.01)
    assert told.mismatch[0] == pytest.approx(abs(np.log(felt * s / wall)), rel=0.02)


def test_of_a_damper_that_never_pulls():
    damper = 15.0
    coupling = Coupling.constant(problem(wall=0.0, damper=damper), Gains(0.0, 1e12), "mine")

    def force_of(x):
        before = np.concatenate([x[:1], x[:-1]])
        return np.maximum(damper * (x - before) / T, 0.0)

    told, found = told_and_measured(coupling, 0.0, force_of, 1.0, wall=0.0, damper=damper)
    assert told == pytest.approx(found, rel=0.03)
    assert told > 0.3, "half of the cycle is lost"
