"""An interval holds chance: what leans an estimate by more stands beside it, on screen, in JSON and in the file."""

import numpy as np
import pytest
from held_device import held_log
from small_logs import multisine, of

from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import device_text
from avc_casadi.identification.identify import identify
from avc_casadi.identification.model import Doubt, Estimate, doubted
from avc_casadi.identification.told import identification_document, identification_text

TRUTH = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "coulomb_friction_n": 0.15}
DEVICE = {"mass": 0.12, "damping": 0.8, "friction": 0.15, "ticks": 6000, "delay": 1}


def law(push, spring=30.0, damper=0.3):
    return lambda tick, z, u: push[tick] - spring * z - damper * u


def holds(found, truth=None):
    """Whether each number is in its interval or in doubt."""
    told = [(found.estimates[key], value) for key, value in (truth or TRUTH).items() if key in found.estimates]
    return all(one.doubt or one.low * (1 - 1e-3) <= value <= one.high * (1 + 1e-3) for one, value in told)


def test_a_doubt_is_of_what_it_concerns_and_never_of_what_is_known():
    keys = ("mass_kg", "damping_ns_per_m", "encoder_resolution_m")
    some = {key: Estimate(key, "", 1.0, 0.9, 1.1, 0.95, "") for key in keys}
    some["mass_kg"] = Estimate("mass_kg", "kg", 1.0, 1.0, 1.0, 1.0, "known beforehand")
    whole = doubted(some, [Doubt("a hand", "")])
    assert [one.doubt for one in whole.values()] == ["", "a hand", ""]
    one = doubted(some, [Doubt("a hand", ""), Doubt("a stop", "", frozenset({"damping_ns_per_m"}))])
    assert one["damping_ns_per_m"].told.endswith("in doubt: a hand; a stop")
    assert not any(one.doubt for one in doubted(some, []).values())


@pytest.mark.thorough
def test_a_hand_on_the_device_throws_doubt_on_screen_in_json_and_in_the_file():
    def hand(tick, position, velocity):
        wants = 0.01 * np.sin(2 * np.pi * 1.1e-3 * tick) + 0.004 * np.sin(2 * np.pi * 2.7e-3 * tick)
        return -300 * (position - wants) - 3 * velocity

    guess = {"mass_kg": 0.3, "damping_ns_per_m": 2.5, "delay_samples": 3, "sample_time_s": 1e-3}
    base = DeviceFile.model_validate({"name": "guess", "device": guess})
    held, free = (
        identify(of(held_log(law(multisine(4.0, 6000)), **DEVICE, **more)), base=base)
        for more in ({"outside": hand}, {})
    )
    assert held.estimates["mass_kg"].doubt
    assert "in doubt" in identification_text(held)
    assert identification_document(held)["estimates"]["mass_kg"]["doubt"]
    assert held.device.sources.mass_kg.grade == "assumed"
    assert "in doubt: the prediction error is not white" in device_text(held.device)
    assert free.device.sources.mass_kg.grade == "measured"
    assert "in doubt" not in device_text(free.device) + identification_text(free)
    assert any("no proof of the model" in note for note in free.notes)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("tick", "then"), [(3000, (0.25, 2.0, 0.15)), (4500, (0.25, 0.8, 0.15)), (3000, (0.12, 0.8, 0.4))]
)
def test_a_device_that_changes_midway_has_no_average_that_is_told_as_measured(tick, then):
    found = identify(of(held_log(law(multisine(4.0, 6000)), **DEVICE, later=(tick, then))))
    second = dict(zip(TRUTH, then, strict=True))
    assert holds(found)
    assert holds(found, second)
    for key, value in TRUTH.items():
        one = found.estimates[key]
        # What changed by much is held with both of its values.
        assert abs(second[key] / value - 1) < 0.1 or one.low < 1.02 * min(value, second[key])
        assert abs(second[key] / value - 1) < 0.1 or one.high > 0.98 * max(value, second[key])
    assert any("the thirds of the log differ" in note for note in found.notes)


def test_thirds_of_one_device_do_not_differ():
    record = of(held_log(law(multisine(4.0, 3000)), **{**DEVICE, "ticks": 3000}))
    found = identify(record)
    assert holds(found)
    assert not any(one.doubt for one in found.estimates.values())


def stops(low, high, stiffness):
    return lambda tick, x, v: -stiffness * (max(x - high, 0.0) + min(x - low, 0.0))  # noqa: ARG005


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("low", "high", "told"), [(-1.0, 0.025, ["above 0.02"]), (-0.012, 0.012, ["above 0.01", "below -0.01"])]
)
def test_a_stop_that_the_device_runs_into_is_named_with_its_place(low, high, told):
    found = identify(of(held_log(law(multisine(4.0, 6000)), **DEVICE, outside=stops(low, high, 5000.0))))
    (note,) = [note for note in found.notes if "end stop" in note]
    assert all(one in note for one in told)
    assert note.count("pushes back") == len(told)
    moving = [one for key, one in found.estimates.items() if key != "encoder_resolution_m"]
    assert all("runs into a stop" in one.doubt for one in moving)
    assert all(one.bounds is None for one in found.refused)
    assert found.device is None or found.device.sources.mass_kg.grade == "assumed"


@pytest.mark.thorough
def test_a_wall_at_the_middle_is_one_and_a_spring_or_a_hand_is_none():
    wide = law(multisine(4.0, 6000, 0.5, 60.0, seed=8), spring=100.0, damper=0.0)
    found = identify(of(held_log(wide, **DEVICE, outside=stops(-1.0, 0.0, 2000.0))))
    (note,) = [note for note in found.notes if "end stop" in note]
    assert note.count("pushes back") == 1
    sprung = identify(of(held_log(law(multisine(4.0, 6000), spring=0.0), **DEVICE, spring=300.0)))
    assert not any("end stop" in note for note in sprung.notes)
    assert sprung.device.sources.mass_kg.grade == "measured"


@pytest.mark.thorough
def test_a_delay_that_rivals_leave_open_is_refused_as_any_other_number():
    slow = lambda tick, z, u: 0.5 * np.sin(np.pi * 1e-3 * tick)  # noqa: ARG005, E731
    found = identify(of(held_log(slow, **{**DEVICE, "friction": 0.45})))
    assert holds(found, {**TRUTH, "coulomb_friction_n": 0.45, "delay_samples": 1.0})
    (refused,) = [one for one in found.refused if one.key == "delay_samples"]
    assert refused.bounds[1] <= 1.0 <= refused.bounds[2]
    assert found.device is None or "delay_samples" in found.device.gaps
