"""What the page of `avc explore` sets is a problem like any other: same rules, same files, same answers."""

import json
import re

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.model.gains import Gains
from avc_casadi.present.explore.answers import PARTS, answer
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.fields import FIELDS
from avc_casadi.present.explore.forms import WALL as FORM
from avc_casadi.present.explore.settings import problem_of_settings, settings_of, values_of

BASE = avc.load_problem("figure5").changed(frequency={"points": 30})
FRESH = {"device": None, "values": {}, "method": "direct", "gains": {}, "motion": "press"}


def asked(**changes):
    return {"settings": FRESH | changes}


def told(part, base=BASE, **changes):
    return answer(Explorer(base, "figure5"), PARTS[part], asked(**changes))


def test_nothing_changed_is_the_problem_itself():
    problem = problem_of_settings(BASE, settings_of(FRESH))
    assert problem.changed(scene={}) == BASE.changed(scene=problem.scene)


@pytest.mark.thorough
@given(
    st.dictionaries(
        st.sampled_from([field.key for field in FIELDS]),
        st.one_of(st.none(), st.floats(-1e9, 1e9), st.integers(-9, 2000), st.text(max_size=4), st.booleans()),
        max_size=4,
    ),
    st.sampled_from([None, "novint-falcon", "reference-r1", "no-such-device"]),
)
@settings(max_examples=60)
def test_any_settings_are_a_problem_or_faults_with_their_fields(values, device):
    try:
        problem = problem_of_settings(BASE, settings_of(FRESH | {"values": values, "device": device}))
    except avc.InputError as error:
        event(f"{len(error.faults)} faults")
        return
    assert avc.parse_problem(avc.dump_problem(problem), name=problem.name) == problem
    kept = values_of(problem)
    for key, value in values.items():
        if isinstance(value, float) and kept[key] is not None:
            assert kept[key] == value


def test_bounds_keep_their_ratio_to_the_wall():
    found = problem_of_settings(BASE, settings_of(FRESH | {"values": {"environment.stiffness_n_per_m": 5e4}}))
    assert found.boundaries.upper.stiffness_n_per_m == pytest.approx(5.5e4)
    assert found.boundaries.lower.damping_ns_per_m == BASE.boundaries.lower.damping_ns_per_m


def test_a_device_of_the_catalogue_brings_its_ranges_and_a_value_given_anew_has_none():
    falcon = problem_of_settings(BASE, settings_of(FRESH | {"device": "novint-falcon"}))
    assert falcon.device == avc.load_device("novint-falcon").device
    lighter = FRESH | {"device": "novint-falcon", "values": {"device.mass_kg": 0.3}}
    assert problem_of_settings(BASE, settings_of(lighter)).device.range.mass_kg is None


def test_a_value_typed_as_it_is_shown_keeps_its_range_and_another_says_what_it_drops():
    device = avc.load_device("novint-falcon").device
    low, high = device.range.mass_kg
    same = told("now", device="novint-falcon", values={"device.mass_kg": float(f"{device.mass_kg:.6g}")})
    assert same["dropped"] == []
    assert same["values"]["device.range.mass_kg.0"] == low
    other = told("now", device="novint-falcon", values={"device.mass_kg": 1.5 * device.mass_kg})
    assert other["dropped"] == [{"key": "device.mass_kg", "low": low, "high": high}]
    assert other["values"]["device.range.mass_kg.0"] is None


def test_the_touch_that_is_shown_is_no_part_of_a_run():
    press, tap = (settings_of(FRESH | {"method": "recommend", "motion": motion}) for motion in ("press", "tap"))
    assert press.run == tap.run
    assert press.run != settings_of(FRESH | {"method": "robust"}).run


@pytest.mark.parametrize("method", [method for method in FORM.live if method != "constant"])
def test_the_picture_shows_what_solve_gives(method):
    found = told("now", method=method)["gains"]
    gains = avc.solve(BASE, method)
    shown = np.array([np.nan if value is None else value for value in found["stiffness_n_per_m"]])
    np.testing.assert_allclose(shown, gains.stiffness_n_per_m, rtol=1e-5)
    assert found["counts"] == gains.counts()


def test_the_verdict_is_that_of_certify_and_deployable():
    found = told("judge", method="constant", gains={"stiffness_n_per_m": 900.0})
    problem = problem_of_settings(BASE, settings_of(FRESH))
    coupling = avc.Coupling.constant(problem, Gains(0.0, 900.0), "constant")
    assert found["deployable"]["pass"] == avc.deployable(coupling).passed


def test_a_saved_coupling_is_one():
    question = asked(method="constant", gains={"stiffness_n_per_m": 900.0}) | {"kind": "coupling"}
    found = answer(Explorer(BASE, "figure5"), PARTS["file"], question)
    document = json.loads(found["text"])
    assert document["schema"] == "avc-coupling/1"
    assert document["certificate"]["deployable"]["pass"] is True


def test_the_copied_command_asks_for_the_very_numbers_of_the_page():
    values = {"device.mass_kg": 0.123456789012, "environment.stiffness_n_per_m": 12345.6789}
    gains = {"stiffness_n_per_m": 1234567.875, "damping_ns_per_m": 3.14159265}
    explorer = Explorer(BASE, "figure5")
    question = asked(method="constant", values=values, gains=gains) | {"kind": "command"}
    text = answer(explorer, PARTS["file"], question)["text"]
    problem = avc.parse_problem(text.partition("'AVC_PROBLEM'\n")[2].partition("AVC_PROBLEM\n")[0])
    assert problem.device.mass_kg == values["device.mass_kg"]
    assert problem.environment.stiffness_n_per_m == values["environment.stiffness_n_per_m"]
    k, b = (float(number) for number in text.split("--mine ")[1].split(","))
    assert (k, b) == (gains["stiffness_n_per_m"], gains["damping_ns_per_m"])


def test_a_contact_damper_that_was_typed_is_not_lost_in_the_command():
    gains = {"stiffness_n_per_m": 900.0, "contact_damping_ns_per_m": 5.0}
    question = asked(method="constant", gains=gains)
    explorer = Explorer(BASE, "figure5")
    text = answer(explorer, PARTS["file"], question | {"kind": "command"})["text"]
    saved = answer(explorer, PARTS["file"], question | {"kind": "coupling"})["name"]
    assert text.startswith(f"avc certify {saved} ")


def test_gains_that_are_none_are_told_with_their_fields():
    found = told("now", method="constant", gains={"stiffness_n_per_m": -1, "damping_ns_per_m": "much"})
    assert {fault["key"] for fault in found["errors"]} == {"gains.stiffness_n_per_m", "gains.damping_ns_per_m"}


def test_what_would_take_minutes_is_refused_beside_its_field():
    slow = {"device.sample_time_s": 1e-5, "device.delay_samples": 1000, "frequency.points": 20_000}
    for part in ("now", "touch", "judge"):
        faults = told(part, values=slow)["errors"]
        assert {fault["key"] for fault in faults} == set(slow)
        assert all("allowed on this page" in fault["message"] for fault in faults)


def test_ranges_and_bounds_are_what_was_typed_and_the_rest_follows():
    typed = {
        "environment.stiffness_n_per_m": 5e4,
        "boundaries.upper.stiffness_n_per_m": 9e4,
        "device.range.mass_kg.1": 0.2,
        "device.range.delay_samples.0": 0,
        "device.range.delay_samples.1": 2,
        "device.mass_kg": 0.12,
        "device.sample_time_s": 0.002,
    }
    found = problem_of_settings(BASE, settings_of(FRESH | {"values": typed}))
    assert found.device.range.mass_kg == (0.12, 0.2)
    assert found.device.range.delay_samples == (0, 2)
    assert found.boundaries.upper.stiffness_n_per_m == 9e4
    assert found.boundaries.lower.stiffness_n_per_m == pytest.approx(4e4)
    assert found.frequency.stop_hz == 225.0
    again = problem_of_settings(found, settings_of(FRESH | {"values": {"device.range.mass_kg.1": None}}))
    assert again.device.range.mass_kg is None


def test_what_the_page_has_no_field_for_is_saved_as_it_was():
    base = BASE.changed(
        device={"position_noise_rms_m": 1e-6, "amplifier_order": 2, "range": {"backlash_m": [0.0, 1e-4]}},
        scene={"duration_s": 3.0, "motion": {"kind": "hold"}},
        stability={"scope": "hands"},
    )
    kept = told("now", base)["kept"]
    assert {"device.position_noise_rms_m = 1e-06", "device.range.backlash_m = [0.0, 0.0001]"} <= set(kept)
    question = asked(values={"environment.damping_ns_per_m": 5.0}) | {"kind": "problem"}
    found = answer(Explorer(base, "b"), PARTS["file"], question)
    saved = avc.parse_problem(found["text"], name=base.name)
    bounds = {"upper": {"damping_ns_per_m": 5.5}, "lower": {"damping_ns_per_m": 3.5}}
    expected = base.changed(environment={"damping_ns_per_m": 5.0}, boundaries=bounds)
    assert saved.model_dump(exclude={"title", "source"}) == expected.model_dump(exclude={"title", "source"})


def test_a_device_file_is_taken_whole():
    text = "[device]\nmass_kg = 0.2\ndamping_ns_per_m = 1\nbacklash_m = 1e-5\n[device.range]\nbacklash_m = [0, 2e-5]\n"
    found = answer(Explorer(BASE, "figure5"), PARTS["device"], {"text": text, "file": "mine.toml"})
    device = problem_of_settings(BASE, settings_of(FRESH | {"device": found["device"]})).device
    assert (device.mass_kg, device.backlash_m, device.range.backlash_m) == (0.2, 1e-5, (0.0, 2e-5))
    assert told("now", device={"mass_kg": -1.0})["errors"][0]["key"] == "device.mass_kg"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("device.sample_time_s", -0.002, "is -2; allowed: 0.0001 to 10000 ms"),
        ("device.sample_time_s", 0.5, "takes too long to follow here; allowed on this page: 0.02 to 100 ms"),
        ("device.encoder_resolution_m", "fine", 'is "fine", not a number; allowed: 0 or 1e-6 to 1e6 µm'),
        ("device.encoder_resolution_m", "38 um", 'is "38 um", not a number; allowed: 0 or 1e-6 to 1e6 µm'),
        ("environment.damping_ns_per_m", -1.0, "is -1.0; allowed: 0 or 1e-9 to 1e9 N·s/m"),
        ("hands.mass_kg.1", None, "is missing; allowed: 0 or 1e-9 to 1e6 kg"),
        ("frequency.stop_hz", 600.0, "below 500 Hz, half the rate of sample time = 1 ms"),
    ],
)
def test_faults_speak_the_unit_of_their_field(key, value, message):
    (fault,) = told("now", values={key: value})["errors"]
    assert fault["key"] == key
    assert message in fault["message"]


def test_a_range_without_its_value_names_the_field():
    (fault,) = told("now", values={"device.range.mass_kg.0": 0.5, "device.range.mass_kg.1": 0.6})["errors"]
    assert fault["key"] == "device.range.mass_kg.0"
    assert "holds mass = 0.1 kg" in fault["message"]


def test_a_file_of_ones_own_opens_on_the_recommended_coupling():
    opens = {source: answer(Explorer(BASE, source), PARTS["start"], {})["opens"] for source in ("figure5", "wall.toml")}
    assert opens == {"figure5": "direct", "wall.toml": "recommend"}


def test_a_device_file_that_is_wrong_says_where():
    found = answer(
        Explorer(BASE, "figure5"), PARTS["device"], {"text": "[device]\nmass_kg = -1\n", "file": "mine.toml"}
    )
    faults = [(fault["file"], fault["line"], fault["key"]) for fault in found["errors"]]
    assert ("mine.toml", 2, "device.mass_kg") in faults


KNOB = avc.load_problem("knob").changed(frequency={"points": 30})


@pytest.mark.thorough
def test_a_device_that_turns_has_its_units_everywhere():
    begun, found = told("start", KNOB), told("now", KNOB, values={"environment.stiffness_n_per_m": 0.5})
    units = {field["key"]: field["unit"] for field in begun["fields"]}
    assert units["device.mass_kg"] == "kg·m²"
    assert units["environment.damping_ns_per_m"] == begun["words"]["impedance"] == "N·m·s/rad"
    assert units["detent.force_n"] == begun["words"]["force"] == "N·m"
    assert units["device.handle_radius_m"] == "mm"
    assert {one["name"] for one in begun["devices"]} == {"smartknob", "direct-drive-wheel"}
    assert all(KNOB.device.motion == avc.load_device(one["name"]).device.motion for one in begun["devices"])
    assert begun["values"]["device.mass_kg"] == 3e-5
    assert found["title"] == "Wall of 0.5 N.m/rad for the device of knob"
    spoken = json.dumps([begun, found, told("judge", KNOB), told("region", KNOB)], ensure_ascii=False)
    texts = re.sub(r'"[a-z_.0-9]+"', "", spoken)  # keys stay inside
    assert not re.search(r"N[.·]s/m|N/m|\d kg(?!·)", texts)


def test_the_slider_of_every_value_of_a_knob_reaches_it():
    begun = told("start", KNOB)
    for field in begun["fields"]:
        value = begun["values"][field["key"]]
        if isinstance(value, float) and value > 0 and not field["choices"]:
            assert field["low"] <= value / field["factor"] <= field["high"], field["key"]


def test_faults_of_a_knob_are_told_in_its_units():
    typed = {"environment.stiffness_n_per_m": -1.0, "device.encoder_resolution_m": -1.0, "detent.pitch_m": None}
    faults = {one["key"]: one["message"] for one in told("now", KNOB, values=typed)["errors"]}
    assert faults == {
        "environment.stiffness_n_per_m": "is -1.0; allowed: 0 or 1e-9 to 1e12 N·m/rad",
        "device.encoder_resolution_m": "is -1e6; allowed: 0 or 1e-6 to 1e6 µrad",
    }


def test_a_knob_saved_and_its_coupling_are_files_of_a_device_that_turns():
    values = {"environment.stiffness_n_per_m": 0.5, "detent.force_n": 0.02}
    ask = {
        "values": values,
        "method": "constant",
        "gains": {"contact_damping_ns_per_m": 1e-3, "stiffness_n_per_m": 9.0},
    }
    files = {
        kind: answer(Explorer(KNOB, "knob"), PARTS["file"], asked(**ask) | {"kind": kind})
        for kind in ("problem", "coupling", "csv")
    }
    problem = avc.parse_problem(files["problem"]["text"], name=KNOB.name)
    assert problem.environment.stiffness_n_per_m == 0.5
    assert problem.detent == KNOB.changed(detent={"force_n": 0.02}).detent
    assert problem.device == KNOB.device
    document = json.loads(files["coupling"]["text"])
    assert document["units"]["stiffness"] == "N.m/rad"
    assert document["table"]["stiffness_nm_per_rad"] == [9.0]
    assert files["csv"]["text"].splitlines()[0].endswith("stiffness_nm_per_rad,contact_damping_nms_per_rad")


def test_hands_go_with_the_handle_of_another_device_and_motions_do_not_mix():
    wheel = problem_of_settings(KNOB, settings_of(FRESH | {"device": "direct-drive-wheel"}))
    wall = {"device": "direct-drive-wheel", "environment": {"stiffness_nm_per_rad": 1.0, "damping_nms_per_rad": 0.0}}
    alone = avc.parse_problem(
        "\n".join(
            (f'device = "{wall["device"]}"', "[environment]", "stiffness_nm_per_rad = 1", "damping_nms_per_rad = 0")
        )
    )
    for key, ends in alone.hands.model_dump().items():
        assert getattr(wheel.hands, key) == pytest.approx(ends)
    (fault,) = told("now", KNOB, device="novint-falcon")["errors"]
    assert (fault["key"], "avc explore figure5" in fault["message"]) == ("device", True)
    (fault,) = told("now", device="smartknob")["errors"]
    assert (fault["key"], "avc explore knob" in fault["message"]) == ("device", True)


def test_detents_are_put_in_and_taken_out():
    without = problem_of_settings(KNOB, settings_of(FRESH | {"values": {"detent.force_n": None}}))
    assert without.detent is None
    within = problem_of_settings(BASE, settings_of(FRESH | {"values": {"detent.force_n": 0.5}}))
    assert within.detent.force_n == 0.5
