"""An encoder that stands behind play: how much is found, with the device beside it, and none is feigned.

The truth is followed here, on the motion that a simulator made with no encoder's steps.
"""

from dataclasses import replace

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import device_text
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record

USUAL = Truth(mass=0.12, damping=0.8, coulomb=0.1, delay=1.0, encoder=2e-5, spring=30.0, damper=0.5)
SECONDS = 6.0


def behind(position, play):
    """What follows a position with play: it stands still within half of it either way."""
    found, at = np.empty_like(position), position[0]
    for index, value in enumerate(position):
        at = min(max(at, value - play / 2), value + play / 2)
        found[index] = at
    return found


def logged(truth, play, seed, rms=1.5):
    random = np.random.default_rng(seed)
    wanted = multisine(random, SECONDS, truth.period, 0.5, 80.0, rms)
    _, position, force = measured(replace(truth, encoder=1e-9), wanted, random)
    counts = np.floor(behind(position, play) / truth.encoder + 0.5)
    return Record("log", truth.period, truth.encoder * counts, force)


@pytest.fixture(scope="module")
def loose():
    return identify([logged(USUAL, 1e-4, seed=3)])


@pytest.mark.thorough
def test_play_is_told_with_the_device_beside_it(loose):
    assert loose.terms == ("base", "coulomb", "play")
    for key, true in (
        ("backlash_m", 1e-4),
        ("mass_kg", 0.12),
        ("damping_ns_per_m", 0.8),
        ("coulomb_friction_n", 0.1),
        ("delay_samples", 1.0),
    ):
        one = loose.estimates[key]
        assert one.low <= true <= one.high, (key, one)
        assert one.value == pytest.approx(true, rel=0.15)


@pytest.mark.thorough
def test_the_user_is_told_what_it_is_and_the_file_holds_it(loose):
    (note,) = [note for note in loose.notes if "play" in note]
    assert "backlash_m" in note
    assert "preload" in note
    assert isinstance(loose.device, DeviceFile)
    assert loose.device.device.backlash_m == pytest.approx(loose.estimates["backlash_m"].value, rel=1e-3)
    assert "backlash_m" not in loose.device.gaps
    assert "backlash_m = [" in device_text(loose.device)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("play", "of"),
    [(5e-5, {}), (2e-4, {"coulomb": 0.0}), (4e-4, {}), (1e-4, {"coulomb": 0.3, "mass": 0.25})],
    ids=str,
)
def test_more_and_less_play_is_found(play, of):
    one = identify([logged(replace(USUAL, **of), play, seed=11)]).estimates["backlash_m"]
    assert one.value == pytest.approx(play, rel=0.2)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "other",
    [
        {},
        {"coulomb": 0.4, "breakaway": 0.4, "slow": 0.005},
        {"coulomb": 0.8},
        {"resonance": 90.0, "coulomb": 0.3},
        {"bandwidth": 80.0},
        {"encoder": 1e-4},
        {"ground": 200.0},
    ],
    ids=str,
)
def test_a_device_without_play_is_not_said_to_have_any(other):
    found = identify([logged(replace(USUAL, **other), 0.0, seed=21)])
    assert "play" not in found.terms
    assert "backlash_m" not in found.estimates


@pytest.mark.thorough
def test_a_log_that_hardly_turns_tells_of_none():
    time = np.arange(3000) * 1e-3
    force = 0.6 + 0.2 * np.sin(2 * np.pi * 0.6 * time)
    random = np.random.default_rng(1)
    _, position, force = measured(replace(USUAL, spring=0.0, damper=0.0), force, random)
    found = identify([Record("log", 1e-3, position, force)])
    (play,) = [trial for trial in found.trials if trial.term == "play"]
    assert not play.taken
    assert "hardly ever turns" in play.why
