"""Laws of others and the plant on which they are compared: against another simulator, and against what they promise."""

import numpy as np
import pytest
from baseline_laws import BASELINES, Exported, Loop
from baseline_plant import Deeds, frequency_sweep, simulated
from hardware_bench import export_c, with_gains
from whole_device import WholeDevice, held, thrown

import avc_casadi as avc

STEP = 2e-5
DRY_N, SECONDS = 0.1, 1.5


def device(**changed):
    found = avc.load_device("reference-r1").device
    return found.model_copy(update={"delay_samples": 0, "encoder_resolution_m": STEP} | changed)


@pytest.mark.slow
@pytest.mark.parametrize("rigid", [False, True], ids=["structure", "rigid"])
def test_the_plant_does_what_another_simulator_does(rigid):
    """Motor and force at the end of presses and strikes, and of a device thrown at the wall, from one exported C."""
    problem = avc.load_problem("reference-r1").changed(
        device={"encoder_resolution_m": 0.0}, environment={"stiffness_n_per_m": 800.0, "damping_ns_per_m": 0.0}
    )
    files = export_c(with_gains(problem, 0.0, 1e8, 1.0))
    hands, speeds = [(0.05, 3.0, 200.0), (0.3, 20.0, 800.0)], (0.07, 0.3)
    each = [(*hand, speed, False, DRY_N, 0.0) for hand in hands for speed in speeds]
    each.append((0.0, 0.0, 0.0, 1.0, False, DRY_N, 0.2))
    mass, damping, stiffness, speed, taps, friction, velocity = np.array(each).T
    deeds = Deeds(mass, damping, stiffness, speed, taps > 0, friction, velocity)
    mine = problem.device.model_copy(update={"resonance": None} if rigid else {})
    found = simulated(mine, Exported(files).lanes(len(each)), deeds, np.zeros(len(each)), SECONDS)
    changed = {"friction": DRY_N} | ({"resonance": 0.0} if rigid else {})
    other = WholeDevice(problem.device, files)
    told = [other.meets(held(hand, speed), SECONDS, **changed) for hand in hands for speed in speeds]
    told.append(other.meets(thrown(0.2), SECONDS, **changed))
    np.testing.assert_allclose(found.depth_m, [one.motor for one in told], rtol=5e-3, atol=2e-5)
    np.testing.assert_allclose(found.force_n, [one.force for one in told], rtol=5e-3, atol=1e-2)
    assert max(one.force for one in told) > 3


def test_a_shaken_spring_and_damper_are_told_as_their_impedance():
    wall, hz = Loop(device(encoder_resolution_m=0.0, max_force_n=None), 2e3, 3.0), np.array([1.0, 10.0])
    rendered = frequency_sweep(wall.device, BASELINES["the wall itself"](wall, 2), 1e-3, hz, np.zeros(2))
    t, s = wall.device.sample_time_s, 2j * np.pi * hz
    exact = (2e3 + 3.0 * (1 - np.exp(-s * t)) / t) * (1 - np.exp(-s * t)) / (s * t)
    np.testing.assert_allclose(rendered, exact, rtol=1e-3)
