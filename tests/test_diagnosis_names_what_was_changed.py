"""A loop that rests and of which one thing is changed: the diagnosis names that, or says that it cannot tell."""

import json
from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import case_of, declared_of
from buzzing_device import Buzzing, logged
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import find_peaks

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, growth_over, limit_of, worst_mode
from avc_casadi.identification.diagnosis.law import find_law
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.diagnosis.oscillation import find_oscillation
from avc_casadi.identification.record import Columns
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand

HEALTHY = Buzzing(encoder=5e-6, stiffness=3000.0, damper=12.0)
SAMPLES = 1500


def columns(loop, missed=None, name="log"):
    return Columns(name, *logged(loop, SAMPLES * loop.period, missed))


def found_of(loop, meant=HEALTHY, missed=None):
    return diagnose(columns(loop, missed), device=declared_of(meant))


def answer_of(loop):
    device = {
        "mass_kg": loop.mass,
        "damping_ns_per_m": loop.damping,
        "sample_time_s": loop.period,
        "delay_samples": loop.delay,
    }
    return Hypothesis(Device.model_validate(device), Hand(loop.hand_mass, loop.hand_damping, loop.hand_stiffness))


CHANGES = {
    "delay": {"delay": 7.0},
    "damping": {"damper": 250.0},
    "stiffness": {"stiffness": 20000.0},
    "rate": {"period": 3e-3},
}


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("cause", CHANGES)
def test_one_number_too_large_is_named_with_a_cure_that_rests(cause):
    meant = replace(HEALTHY, stiffness=9000.0) if cause == "rate" else HEALTHY
    wrong = replace(meant, **CHANGES[cause])
    found = found_of(wrong, meant)
    assert (found.verdict, found.cause) == ("named", cause), found.conclusion
    assert found.cures
    assert all(cure.rests for cure in found.cures)
    # The cure is tried on the simulator, which shares no code with the loop model.
    own = {"damping": "damping_ns_per_m", "stiffness": "stiffness_n_per_m", "delay": "delay_samples"}.get(cause)
    if own is None:
        return
    value = next(cure.value for cure in found.cures if cure.key == own)
    field = {"damping": "damper", "stiffness": "stiffness", "delay": "delay"}[cause]
    cured, _ = log_of(columns(replace(wrong, encoder=1e-8, **{field: value})))
    left = find_oscillation(cured).found
    assert not left.sustained or left.peak_to_peak_m < 1e-6


@pytest.mark.thorough
def test_a_delay_is_measured():
    found = found_of(replace(HEALTHY, delay=4.4, lag=2.0, stiffness=5000.0))
    assert found.law.lag == 2
    assert found.measured.delay_samples == pytest.approx(6.4, abs=0.15)


@pytest.mark.thorough
def test_a_resonance_that_nobody_declared_is_found():
    found = found_of(replace(HEALTHY, resonance=110.0, ratio=0.02, damper=40.0), replace(HEALTHY, damper=40.0))
    assert found.cause == "resonance", found.conclusion
    assert found.measured.resonance["frequency_hz"] == pytest.approx(110.0, rel=0.2)


@pytest.mark.thorough
def test_a_hand_that_let_go_is_missed():
    loop = replace(HEALTHY, stiffness=2500.0, damper=4.0, two_sided=1.0, delay=2.0)
    found = found_of(replace(loop, release=0.5, weight=0.8), loop)
    assert found.cause == "let-go", found.conclusion
    assert found.measured.hand is None


@pytest.mark.thorough
def test_missed_ticks_are_counted_and_named():
    case = case_of("ticks", 7, 0)
    found = diagnose(case.columns, device=case.declared)
    steps = np.diff(case.columns.time_s) / case.loop.period
    assert found.ticks.missed_share == pytest.approx(1 - (steps.size + 1) / (steps.sum() + 1), abs=1e-6)
    assert found.cause == "ticks", found.conclusion


@pytest.mark.thorough
def test_an_encoder_swings_a_loop_over_few_steps():
    loop = Buzzing(encoder=6e-5, stiffness=7000.0, damper=3.5, hand_mass=0.09, hand_damping=7.0, hand_stiffness=300.0)
    loop = replace(loop, mass=0.14, damping=0.75, delay=0.9)
    found = found_of(loop, loop)
    assert found.verdict == "cannot tell" or found.cause == "encoder", found.conclusion
    assert found.candidates[0] == "encoder"
    assert found.oscillation.steps < 10


@pytest.mark.parametrize("cause", ["stable press", "still", "free"])
def test_nothing_is_found_where_nothing_is_wrong(cause):
    time, position, force = logged(HEALTHY, 1.2)
    if cause == "still":
        position, force = np.zeros_like(position), np.zeros_like(force)
    elif cause == "free":
        force = np.zeros_like(force)
    found = diagnose(Columns(cause, time, position, force), device=declared_of(HEALTHY))
    assert found.verdict == "nothing wrong"
    assert found.cause is None


def test_an_oscillation_without_force_is_not_that_of_the_loop():
    time = np.arange(SAMPLES) * 1e-3
    position = 1e-3 * np.sin(2 * np.pi * 17 * time)
    assert diagnose(Columns("shaken", time, position, np.zeros(SAMPLES))).verdict == "not the loop"


def test_a_force_that_is_no_spring_is_not_modelled():
    random = np.random.default_rng(0)
    time, position, force = logged(replace(HEALTHY, delay=7.0), 1.5)
    found = diagnose(Columns("other", time, position, force * random.uniform(0.2, 2.0, force.size)))
    assert found.verdict == "cannot tell"
    assert found.decides


@settings(max_examples=25, deadline=None)
@given(
    stiffness=st.floats(200.0, 20000.0),
    damper=st.floats(0.0, 80.0),
    keep=st.sampled_from([0.0, 0.3, 0.8]),
    lag=st.integers(0, 4),
    limit=st.sampled_from([5.0, 50.0]),
)
def test_the_law_is_read_from_the_log(stiffness, damper, keep, lag, limit):
    loop = replace(HEALTHY, stiffness=stiffness, damper=damper, keep=keep, lag=float(lag), limit=limit)
    log, _ = log_of(columns(loop))
    law = find_law(log, limit)
    if law is None or law.samples < 100:
        return
    assert law.told
    assert law.stiffness_n_per_m == pytest.approx(stiffness, rel=1e-3)
    if damper > 1:
        assert law.lag == lag
        assert law.damping_ns_per_m == pytest.approx(damper, rel=1e-3)
        assert law.keep == pytest.approx(keep, abs=1e-3)


@settings(max_examples=15, deadline=None)
@given(
    hertz=st.floats(12.0, 200.0),
    steps=st.floats(1.0, 200.0),
    growth=st.sampled_from([0.0, 4.0]),
    seed=st.integers(0, 9),
)
def test_frequency_amplitude_and_growth_are_measured(hertz, steps, growth, seed):
    random = np.random.default_rng(seed)
    step, time = 1e-5, np.arange(SAMPLES) * 1e-3
    swing = steps * step / 2 * np.exp(growth * (time - time[-1])) * np.sin(2 * np.pi * hertz * time)
    position = step * np.round((2e-3 + 1e-3 * time + swing + 0.1 * step * random.standard_normal(SAMPLES)) / step)
    log, _ = log_of(Columns("sine", time, position, np.ones(SAMPLES)))
    found = find_oscillation(log).found
    if steps < 3:
        return
    assert found.sustained
    assert found.frequency_hz == pytest.approx(hertz, rel=0.03, abs=0.5)
    # That of the last turns, in which it grows.
    grown = 1 - np.exp(-1.5 * growth / hertz)
    assert found.peak_to_peak_m == pytest.approx(steps * step, rel=max(0.25, grown), abs=2 * step)


@settings(max_examples=10, deadline=None)
@given(stiffness=st.floats(2000.0, 30000.0), damper=st.floats(2.0, 60.0), delay=st.floats(0.01, 4.0))
def test_the_loop_model_grows_as_the_simulator_does(stiffness, damper, delay):
    loop = Buzzing(encoder=0.0, stiffness=stiffness, damper=damper, delay=delay, two_sided=1.0, limit=1e15, end=0.0)
    log, _ = log_of(columns(loop))
    growth = worst_mode(answer_of(loop), find_law(log, None)).growth_per_s
    position = log.position_m
    if 8 < growth < 60:
        peaks = find_peaks(position)[0][-12:]
        slope, _ = np.polyfit(log.time_s[peaks], np.log(position[peaks]), 1)
        assert slope == pytest.approx(growth, rel=0.05, abs=0.5)
    elif growth < -8:
        assert np.ptp(position[1100:]) < np.ptp(position[700:1000])


def test_a_limit_separates_rest_from_swing():
    loop = replace(HEALTHY, stiffness=20000.0)
    law = find_law(log_of(columns(loop))[0], None)
    answer, limit = answer_of(loop), limit_of(answer_of(loop), law, "stiffness")
    assert 0 < limit < 1
    assert worst_mode(answer, law, stiffness=0.98 * limit).stable
    assert not worst_mode(answer, law, stiffness=1.02 * limit).stable


def test_growth_over_all_ticks_is_that_of_the_eigenvalues():
    loop = replace(HEALTHY, stiffness=20000.0)
    law = find_law(log_of(columns(loop))[0], None)
    whole = growth_over(answer_of(loop), law, np.ones(10, dtype=bool))
    assert whole == pytest.approx(worst_mode(answer_of(loop), law).growth_per_s, rel=0.05)
    half = growth_over(answer_of(loop), law, np.arange(10) % 2 == 0)
    assert half > whole


def write(path, log, header="time_s,position_m,force_N"):
    rows = np.stack([log.time_s, log.position_m, log.force_n], axis=1)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")


@pytest.mark.thorough
def test_the_verb_tells_text_json_picture_and_page(tmp_path, capsys):
    log, page, picture = tmp_path / "log.csv", tmp_path / "page.html", tmp_path / "picture.png"
    write(log, columns(replace(HEALTHY, delay=7.0)))
    told = ["diagnose", str(log), "--stiffness", "1500", "--report", str(page), "--plot", str(picture), "--json"]
    assert main(told) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == "diagnose"
    assert document["cause"] == "delay"
    assert set(document["shares"]) <= {*CAUSES, "other"}
    assert any("1500" in note for note in document["notes"])
    text = page.read_text(encoding="utf-8")
    assert document["conclusion"].split(":")[0] in text
    assert "http" not in text.replace("http://www.w3.org", "")
    assert picture.stat().st_size > 10_000


@pytest.mark.thorough
def test_a_log_with_a_pause_is_read_and_one_without_force_refused(tmp_path, capsys):
    log = columns(replace(HEALTHY, delay=7.0))
    keep = (log.time_s < 0.8) | (log.time_s > 1.0)
    paused = Columns("paused", log.time_s[keep], log.position_m[keep], log.force_n[keep])
    found = diagnose(paused, device=declared_of(HEALTHY))
    assert found.cause == "delay"
    assert any("pause" in note for note in found.notes)
    path = tmp_path / "two.csv"
    np.savetxt(
        path, np.stack([log.time_s, log.position_m], axis=1), delimiter=",", header="time_s,position_m", comments=""
    )
    assert main(["diagnose", str(path)]) == 2
    assert "force: has no column" in capsys.readouterr().err


def test_a_force_that_drives_the_device_away_is_refused():
    log = columns(HEALTHY)
    flipped = Columns("flipped", log.time_s, log.position_m, -log.force_n)
    with pytest.raises(avc.InputError, match="--flip-force"):
        diagnose(flipped)
    assert diagnose(flipped, flip_force=True).verdict == "nothing wrong"


def test_a_coupling_that_did_not_run_is_noticed():
    problem = avc.load_problem("figure5")
    coupling = avc.Coupling.constant(problem, Gains(5.0, 2000.0), "mine")
    found = diagnose(columns(Buzzing(encoder=2e-5)), coupling=coupling)
    assert any("does not run the coupling" in note for note in found.notes)
