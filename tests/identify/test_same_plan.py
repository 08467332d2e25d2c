"""A plan is the same on every processor, and a small change of the device changes it little."""

import dataclasses
import json
import os
import subprocess
import sys

import kernels
import numpy as np
import pytest
from excited import DECLARED
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi._errors import InputError
from avc_casadi.identification.excitation import plan_excitation
from avc_casadi.identification.signal import low_crest_phases
from avc_casadi.model.device import Device

LATE = {
    "delay_samples": 9,
    "coulomb_friction_n": 0.5,
    "encoder_resolution_m": 7e-5,
    "range": {"coulomb_friction_n": (0.1, 1.0)},
}
ALONE = DECLARED.model_dump(exclude={"range"}) | {"sample_time_s": 2e-3}
RESONANT = {
    "sample_time_s": 5e-4,
    "delay_samples": 1.5,
    "amplifier_bandwidth_hz": 200.0,
    "resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.4},
}
DEVICES = {
    "declared": DECLARED,
    "late": Device.model_validate(DECLARED.model_dump() | LATE),
    "resonant": Device.model_validate(ALONE | RESONANT),
}


def planned(device):
    """The integers and the numbers of a plan and its forecast by name, or the key at which it is refused."""
    try:
        made = plan_excitation(device, seconds=2.0)
    except InputError as error:
        return {"refused": [fault.key for fault in error.faults]}, {}
    plan = dataclasses.asdict(made.plan)
    integers = {key: np.ravel(value).tolist() for key, value in plan.pop("signal").items()}
    integers |= {key: [plan.pop(key)] for key in ("ticks", "ramp_ticks", "window")}
    numbers = {key: [value] for key, value in plan.items() if not isinstance(value, str)}
    return integers, numbers | {key: values.ravel().tolist() for key, values in vars(made.forecast).items()}


def assert_same(some, others, rtol):
    """Integers are equal: one that rounds to another would be a chance of one in a million plans."""
    (integers, numbers), (other_integers, other_numbers) = some, others
    assert integers == other_integers
    assert numbers.keys() == other_numbers.keys()
    for key, values in numbers.items():
        assert other_numbers[key] == pytest.approx(values, rel=rtol), key


@pytest.mark.slow
def test_plans_are_the_same_on_an_old_and_a_new_kernel():
    if reason := kernels.why_none():
        pytest.skip(reason)
    paths = {"PYTHONPATH": os.pathsep.join(sys.path)}
    processes = [
        subprocess.Popen([sys.executable, __file__], env=kernels.environment(name) | paths, stdout=subprocess.PIPE)  # noqa: S603
        for name in kernels.KERNELS
    ]
    old, new = (json.loads(process.communicate()[0]) for process in processes)
    assert list(old) == list(new) == list(DEVICES)
    for name, plan in old.items():
        assert "refused" not in plan[0]
        assert_same(plan, new[name], rtol=1e-6)


@pytest.mark.slow
@settings(max_examples=12)
@given(
    values=st.fixed_dictionaries(
        {
            "mass_kg": st.floats(0.03, 0.5),
            "damping_ns_per_m": st.just(0.0) | st.floats(0.1, 3.0),
            "coulomb_friction_n": st.sampled_from([0.0, 0.1, 1.0, 3.0]),
            "delay_samples": st.sampled_from([0.5, 1.0, 2.0]) | st.floats(0.1, 6.0),
            # Of these the first three make a window of 1, 2 and 3 ticks exactly.
            "encoder_resolution_m": st.sampled_from([6e-5, 1.2e-4, 1.8e-4, 2e-5]) | st.floats(1e-5, 1e-3),
            "sample_time_s": st.sampled_from([1.6e-3, 2e-3, 3.2e-3]),
        }
    ),
    key=st.sampled_from(["mass_kg", "coulomb_friction_n", "delay_samples", "encoder_resolution_m", "sample_time_s"]),
    nudge=st.sampled_from([-1e-12, 1e-12]),
)
def test_a_change_in_the_twelfth_digit_of_the_device_changes_no_plan(values, key, nudge):
    """Accepted and refused alike, and where a whole number is on the point of being another."""
    device, nudged = (Device.model_validate(ALONE | values | {key: values[key] * (1 + by)}) for by in (0.0, nudge))
    assert_same(planned(device), planned(nudged), rtol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_phases_follow_the_amplitudes_smoothly(seed):
    """Spectra of four decades of power: the phases of the weakest tones are the most sensitive."""
    random = np.random.default_rng(seed)
    frequency_hz = np.unique(np.round(np.geomspace(1, 300, 40)))
    amplitude = 10 ** random.uniform(-2, 0, frequency_hz.size)
    time_s = np.arange(0, 1, 1e-3)
    phase = low_crest_phases(frequency_hz, amplitude, time_s)
    nudged = low_crest_phases(frequency_hz, amplitude * (1 + 1e-12 * random.standard_normal(amplitude.size)), time_s)
    assert np.abs(nudged - phase).max() < 1e-7
    wave = np.sin(np.outer(time_s, 2 * np.pi * frequency_hz) + phase) @ amplitude
    drawn = [
        np.sin(np.outer(time_s, 2 * np.pi * frequency_hz) + random.uniform(0, 7, phase.size)) @ amplitude
        for _ in range(50)
    ]
    assert np.abs(wave).max() < min(np.abs(other).max() for other in drawn)


@pytest.mark.slow
@pytest.mark.parametrize("resolution_m", [2e-5, 7e-5])
def test_what_is_refused_lies_on_a_limit_that_was_approached_steadily(resolution_m):
    """Just below the least friction that is refused, motion is 13 encoder steps or force is 1.2 times friction."""
    low_n, high_n = 0.1, 3.0
    while high_n - low_n > 1e-6:
        middle_n = (low_n + high_n) / 2
        changed = {"coulomb_friction_n": middle_n, "encoder_resolution_m": resolution_m}
        try:
            kept = plan_excitation(Device.model_validate(ALONE | changed), seconds=2.0)
            low_n = middle_n
        except InputError:
            high_n = middle_n
    steps = float(kept.forecast.stroke_m.min()) / resolution_m
    assert min(steps / 13, kept.plan.peak_force_n / (1.2 * low_n)) == pytest.approx(1.0, rel=1e-3)


if __name__ == "__main__":
    sys.stdout.write(json.dumps({name: planned(device) for name, device in DEVICES.items()}))
