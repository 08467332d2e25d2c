"""The page of an admittance device: its settings are its file, its answers are those of certify, recommend, zwidth."""

import math

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi._util.progress import SILENT
from avc_casadi.files.admittance_file import dump_admittance, parse_admittance
from avc_casadi.present.explore.admittance import with_law
from avc_casadi.present.explore.explorer import Explorer, _solved
from avc_casadi.present.explore.server import OPENS_WITH, answer
from avc_casadi.present.explore.verdict import of_admittance
from avc_casadi.present.row import Mark, text_of
from avc_casadi.present.rows import admittance

ARM = avc.load_admittance("admittance/cobot")
PEDAL = avc.load_admittance("admittance/pedal")
EXPLORERS = {base.name: Explorer(base, base.name) for base in (ARM, PEDAL)}


def ask(part, base=ARM, extent="rows", kind=None, **changes):
    return answer(EXPLORERS[base.name], part, {"settings": OPENS_WITH | changes, "extent": extent, "kind": kind})


def saved(base=ARM, **changes):
    found = ask("file", base, kind="problem", **changes)
    return parse_admittance(found["text"], name=base.name)


@pytest.mark.parametrize("base", [ARM, PEDAL], ids=["arm", "pedal"])
def test_without_changes_what_is_saved_is_the_file(base):
    assert saved(base) == parse_admittance(dump_admittance(base), name=base.name)


@pytest.mark.parametrize("base", [ARM, PEDAL], ids=["arm", "pedal"])
def test_each_slider_reaches_the_value_that_the_problem_has(base):
    begun = ask("start", base)
    found = ask("evaluate", base, extent="pictures")
    values = found["values"] | found["gains"]
    assert found["headline"].startswith("drive ")
    assert {field["label"] for field in begun["gains"]} == {"virtual mass", "damping", "spring", "force below"}
    assert {"device.force_sensor.stiffness_n_per_m", "contact.stiffness_n_per_m.1"} <= set(values)
    assert not begun["couples"]
    for field in (*begun["fields"], *begun["gains"]):
        value = values[field["key"]]
        if isinstance(value, float) and value > 0:
            assert field["low"] <= value / field["factor"] <= field["high"], field["key"]


def test_what_is_typed_is_saved_and_what_is_refused_names_its_field():
    gains = {"law.admittance.mass_kg": 5.0, "law.admittance.cutoff_hz": None}
    values = {"device.force_sensor.stiffness_n_per_m": 4e5, "contact.stiffness_n_per_m.1": 2e3, "hands.mass_kg.0": 0.7}
    problem = saved(values=values, gains=gains)
    assert (problem.law.admittance.mass_kg, problem.law.admittance.cutoff_hz) == (5.0, None)
    assert problem.device.force_sensor.stiffness_n_per_m == 4e5
    assert problem.contact.stiffness_n_per_m == (0.0, 2e3)
    assert problem.hands.mass_kg == (0.7, 2.0)
    errors = ask("evaluate", gains={"law.admittance.mass_kg": -1.0}, values={"device.drive_bandwidth_hz": 0.0})[
        "errors"
    ]
    assert {error["key"] for error in errors} == {"law.admittance.mass_kg", "device.drive_bandwidth_hz"}
    assert ask("file", kind="coupling")["errors"]


def test_a_range_of_a_typed_value_is_dropped():
    ranged = ARM.changed(device={"range": {"sensor_stiffness_n_per_m": [8e5, 1.2e6], "delay_samples": [1.0, 2.0]}})
    explorer = Explorer(ranged, "ranged")
    typed = {"device.force_sensor.stiffness_n_per_m": 2e6}
    found = answer(explorer, "file", {"settings": OPENS_WITH | {"values": typed}, "kind": "problem"})
    problem = parse_admittance(found["text"])
    assert problem.device.ranges == {"delay_samples": (1.0, 2.0)}


def test_the_picture_of_effort_is_the_law_with_the_handle():
    found = ask("evaluate", PEDAL, extent="pictures", gains={"law.admittance.damping_ns_per_m": 200.0})
    (felt,) = found["charts"]
    (own,) = felt["series"]
    for hz, force in zip(own["x"][::20], own["y"][::20], strict=True):
        w = 2 * math.pi * hz
        assert force == pytest.approx(abs(1j * w * (6.0 + 0.4) + 200.0 + 8000.0 / (1j * w)), rel=1e-4)


@pytest.mark.slow
def test_rows_and_verdict_are_those_of_certify_and_the_region_that_of_zwidth():
    gains = {"law.admittance.damping_ns_per_m": 60.0}
    found = ask("evaluate", gains=gains)
    certificate = avc.certify_admittance(ARM, law={"damping_ns_per_m": 60.0}, remedies=False)
    assert found["verdicts"]["own"]["word"] == ("deployable" if certificate.passed else "unstable")
    assert found["verdicts"]["own"]["mark"] == "fail"
    quick = {row["label"]: row["text"] for row in found["rows"]["own"]}
    assert "Stable mass" not in quick
    assert "it swings at" in quick["Deployable"]
    whole = ask("evaluate", extent="whole", gains=gains)
    rows = [(row["label"], row["text"]) for row in whole["rows"]["own"]]
    expected = admittance.certificate(certificate).rows
    assert rows == [(row.label, text_of(row.values, ARM.units)) for row in expected if row.rank == 0]
    region, _ = whole["charts"]
    width = avc.mass_width(ARM)
    band = region["bands"][0]
    assert band["x"] == pytest.approx(width.damping_ns_per_m, rel=1e-5)
    lightest = np.array([np.nan if value is None else value for value in region["series"][0]["y"]])
    assert (np.isnan(lightest) == np.isnan(width.least_kg)).all()
    known = np.isfinite(width.sound_least_kg) & (width.sound_least_kg > 0)
    low = np.array([np.nan if value is None else value for value in band["low"]])
    assert low[known] == pytest.approx(width.sound_least_kg[known], rel=1e-5)
    assert [(point["x"], point["y"]) for point in region["points"]] == [(60.0, 12.0)]
    # Mass and damping do not change the region: another law has its picture at once.
    moved = ask("evaluate", extent="pictures", gains={"law.admittance.mass_kg": 8.0})
    assert [chart["id"] for chart in moved["charts"]] == ["region", "felt"]


@pytest.mark.slow
def test_a_run_of_recommend_has_its_law_and_rows():
    found = _solved((PEDAL, "recommend"), SILENT)
    recommended = avc.recommend_admittance(PEDAL)
    assert found.admittance == recommended.law
    assert found.judged.verdict.word == "deployable"
    labels = [row.label for row in found.judged.rows]
    assert labels[:3] == ["Deployable", "Law", "Effort"]


def test_a_file_without_a_law_begins_with_one():
    bare = ARM.changed(law=None)
    begun = with_law(bare)
    assert begun.law.admittance.mass_kg == pytest.approx(3.0)
    assert with_law(ARM) is ARM
    found = answer(Explorer(begun, "bare"), "evaluate", {"settings": OPENS_WITH, "extent": "pictures"})
    assert found["gains"]["law.admittance.mass_kg"] == pytest.approx(3.0)


def test_a_device_that_turns_shows_its_own_units():
    tables = ARM.model_dump(exclude={"name"}, exclude_unset=True)
    tables["device"] |= {"motion": "rotary", "handle_radius_m": 0.1}
    explorer = Explorer(avc.AdmittanceProblem.model_validate(tables | {"name": "wheel"}), "wheel")
    begun = answer(explorer, "start", {})
    units = {field["key"]: field["unit"] for field in (*begun["gains"], *begun["fields"])}
    assert units["law.admittance.mass_kg"] == "kg.m2"
    assert units["device.force_sensor.stiffness_n_per_m"] == "N.m/rad"
    found = answer(
        explorer,
        "evaluate",
        {"settings": OPENS_WITH | {"values": {"device.handle_radius_m": 0.2}}, "extent": "pictures"},
    )
    assert found["values"]["hands.mass_kg.0"] == pytest.approx(0.5 * 4)


@pytest.mark.slow
@pytest.mark.parametrize(("damping_ns_per_m", "mark"), [(60.0, Mark.FAIL), (100.0, Mark.CAUTION), (200.0, Mark.PASS)])
def test_a_law_has_the_mark_that_certify_gives_it(damping_ns_per_m, mark):
    """With 2 kg at 100 N.s/m the disk margin of the cobot is sound, 0.44, and its damping ratio is below 0.2."""
    law = {"mass_kg": 2.0, "damping_ns_per_m": damping_ns_per_m}
    found = avc.certify_admittance(ARM, law=law)
    assert of_admittance(found).mark is admittance.certificate(found).rows[0].mark is mark
