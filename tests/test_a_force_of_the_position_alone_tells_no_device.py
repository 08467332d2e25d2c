"""Where the force is made of the position and of nothing else, a hand moves the device: no number of it is told."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_device import Buzzing, logged
from measured_device import Truth, measured, multisine

from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification import estimates as _estimates
from avc_casadi.identification.closed_loop import only_feedback
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record
from avc_casadi.identification.uncertainty import spread_of

BASE = {
    "name": "base",
    "title": "guessed",
    "device": {
        "mass_kg": 0.12,
        "damping_ns_per_m": 0.8,
        "coulomb_friction_n": 0.1,
        "delay_samples": 1,
        "sample_time_s": 1e-3,
        "range": {"coulomb_friction_n": (0.0, 0.3)},
    },
}
NUMBERS = ("mass_kg", "damping_ns_per_m", "delay_samples", "coulomb_friction_n")
# A hand that goes to and fro in a wall, by its own will.
PRESSED = Buzzing(mass=0.12, damping=0.8, friction=0.1, encoder=2e-5, stiffness=1500.0, damper=2.0, end=0.01)


def pressed(seconds=6.0, **changed):
    loop = replace(PRESSED, **changed)
    time, position, force = logged(replace(loop, sway=4e-3), seconds)
    assert np.ptp(position[time > seconds / 2]) > 20 * loop.encoder
    return Record("pressed", loop.period, position, force)


def excited(spring=0.0, coulomb=0.1, seconds=6.0, seed=0):
    random = np.random.default_rng(seed)
    truth = Truth(mass=0.12, damping=0.8, coulomb=coulomb, delay=1.0, encoder=2e-5, spring=spring)
    wanted = multisine(random, seconds, truth.period, 0.5, 100.0, 1.0)
    return Record("excited", truth.period, *measured(truth, wanted, random)[1:])


@pytest.mark.parametrize("changed", [{}, {"keep": 0.6}, {"lag": 2.0}, {"two_sided": 1.0, "stiffness": 800.0}])
def test_the_controller_that_makes_the_whole_force_is_told(changed):
    record = pressed(**changed)
    found = only_feedback([record])
    assert found is not None
    assert found.stiffness_n_per_m == pytest.approx(changed.get("stiffness", 1500.0), rel=1e-3)
    assert found.damping_ns_per_m == pytest.approx(2.0, abs=0.05)
    rounded = replace(record, force_n=0.002 * np.round(record.force_n / 0.002))
    assert only_feedback([rounded]) is not None


def test_a_force_of_its_own_beside_the_controller_is_none():
    record = pressed()
    own = 0.05 * np.ptp(record.force_n) * np.sin(2 * np.pi * 7.0 * np.arange(record.force_n.size) * 1e-3)
    assert only_feedback([replace(record, force_n=record.force_n + own)]) is None
    assert only_feedback([excited()]) is None
    assert only_feedback([excited(spring=80.0)]) is None
    # One log of two with a force of its own is enough.
    assert only_feedback([record, excited()]) is None


def test_what_was_let_go_and_comes_to_rest_is_none():
    loop = replace(PRESSED, end=0.004, hand_stiffness=300.0)
    time, position, force = logged(loop, 6.0)
    assert np.ptp(position[time > 3.0]) < 0.1 * np.ptp(position)
    assert only_feedback([Record("let go", 1e-3, position, force)]) is None


@pytest.mark.thorough
@pytest.mark.parametrize("changed", [{}, {"stiffness": 3000.0, "hand_stiffness": 800.0}])
def test_a_hand_leaves_what_was_known_as_it_was(changed):
    base = DeviceFile.model_validate(BASE)
    found = identify([pressed(**changed)], base=base)
    refused = {one.key: one for one in found.refused}
    assert set(NUMBERS) <= refused.keys()
    assert not set(NUMBERS) & found.estimates.keys()
    assert all("not in the log" in refused[key].why and "hands off" in refused[key].excitation for key in NUMBERS)
    for key in NUMBERS:
        assert getattr(found.device.device, key) == getattr(base.device, key)
        assert getattr(found.device.sources, key).grade == "assumed"
    assert found.device.device.range.coulomb_friction_n == (0.0, 0.3)
    told = " ".join(found.notes)
    assert "a hand or something else moves it" in told
    assert "does not bias" not in told


@pytest.mark.thorough
def test_friction_is_not_bounded_beyond_the_force_that_acted(monkeypatch):
    record = excited(coulomb=0.0)
    assert "no evidence" in identify([record]).estimates["coulomb_friction_n"].how

    def wide(fit, others):
        spread = spread_of(fit, others)
        return replace(spread, half_width=1e6 * spread.half_width)

    monkeypatch.setattr(_estimates, "spread_of", wide)
    found = identify([record])
    assert "coulomb_friction_n" not in found.estimates
    assert "the force that acted" in {one.key: one.why for one in found.refused}["coulomb_friction_n"]
