"""Trials of a stated law beside devices in small steps: what rests, swings and hunts."""

import json

import numpy as np
import pytest
from plain_device import moved, pressed, turns
from quick import first

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.files.problem_file import load_any
from avc_casadi.simulation.population.law_trial import try_law

DEVICE = {
    "mass_kg": 0.12,
    "damping_ns_per_m": 0.8,
    "delay_samples": 1,
    "coulomb_friction_n": 0.1,
    "encoder_resolution_m": 2e-5,
    "max_force_n": 8.0,
}
SOUND = {"stiffness_n_per_m": 900.0, "damping_ns_per_m": 4.0}
ONE_HAND = {"mass_kg": [0.1, 0.1], "damping_ns_per_m": [5.0, 5.0], "stiffness_n_per_m": [400.0, 400.0]}
WALL = {"environment": {"stiffness_n_per_m": 1000.0, "damping_ns_per_m": 0.0}}


def stated(law, *, device=None, **tables):
    return load_any({"device": DEVICE | (device or {}), "law": law, "hands": ONE_HAND, **tables})


@pytest.mark.slow
def test_a_sound_law_rests_and_one_beyond_its_limit_swings():
    sound = try_law(stated(SOUND), 12)
    assert sound.rests
    assert sound.declared.at_rest == 12
    assert sound.declared.swings is None
    assert sound.declared.hunts is None
    assert sound.declared.released
    assert sound.least_friction is None
    assert sound.declared.stiffness_n_per_m == pytest.approx(900.0, rel=0.02)
    problem = stated({**SOUND, "stiffness_n_per_m": 9e3}, device={"coulomb_friction_n": 0.0})
    assert not avc.certify_law(problem).held.stable
    found = try_law(problem, 4)
    assert not found.rests
    places = moved(problem, pressed(4.25, 1e-3), (0.1, 5.0, 400.0))[-1000:]
    count, size = turns(places)
    assert found.declared.swings.frequency_hz == pytest.approx(count / 2, rel=0.1)
    assert found.declared.swings.peak_to_peak_m == pytest.approx(size, rel=0.3)


@pytest.mark.parametrize(("force_n", "rests"), first([(0.3, False), (0.04, True)]))
def test_compensation_above_the_friction_swings_and_below_it_rests(force_n, rests):
    law = {**SOUND, "friction_compensation": {"force_n": force_n, "velocity_m_per_s": 0.02}}
    problem = stated(law, device={"delay_samples": 2})
    found = try_law(problem, 8)
    assert found.rests == rests
    assert found.least_friction.friction_n == pytest.approx(0.05)
    ends = []
    for friction in (0.1, 0.05):
        places = moved(problem, np.zeros(4250), friction_n=friction, speed=0.1)[-1000:]
        ends.append(np.ptp(places) < 1e-5)
    assert all(ends) == rests
    assert (found.declared.released, found.least_friction.released) == tuple(ends)
    known = stated(law, device={"range": {"coulomb_friction_n": [0.08, 0.12]}})
    assert try_law(known, 2).least_friction.friction_n == 0.08


@pytest.mark.slow
def test_an_integral_in_a_wall_hunts_as_a_device_in_small_steps():
    problem = stated({**SOUND, "integral_n_per_m_s": 5000.0}, **WALL)
    found = try_law(problem, 2).declared.hunts
    places = moved(problem, pressed(20.0, 1e-3), (0.1, 5.0, 400.0))[-15000:]
    count, size = turns(places)
    assert count > 4
    assert found.frequency_hz == pytest.approx(count / 2 / 15, rel=0.4)
    assert found.peak_to_peak_m == pytest.approx(size, rel=0.1)
    assert try_law(stated(SOUND, **WALL), 2).declared.hunts is None


@pytest.mark.slow
def test_the_answer_says_what_swings_and_hunts(tmp_path, capsys):
    file = tmp_path / "own.toml"
    file.write_text(
        "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\ncoulomb_friction_n = 0.1\n"
        "[environment]\nstiffness_n_per_m = 1000.0\ndamping_ns_per_m = 0.0\n"
        "[law]\nstiffness_n_per_m = 900.0\ndamping_ns_per_m = 4.0\nintegral_n_per_m_s = 5000.0\n"
        "friction_compensation = { force_n = 0.3, velocity_m_per_s = 0.02 }\n",
        encoding="utf-8",
    )
    assert main(["trial", str(file), "--hands", "20", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "trial"
    assert found["declared"]["hunts"]["frequency_hz"] > 0
    assert found["least_friction"]["friction_n"] == pytest.approx(0.05)
    assert main(["trial", str(file), "--hands", "20"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "Hunts" in said
    assert "Released does not come to rest" in said
    assert "friction compensation 300 mN from 20.0 mm/s" in said
    assert "Relay compensates 300 mN" in said
    assert main(["simulate", str(file)]) in (0, 1)
    assert "Law k 900 N/m" in " ".join(capsys.readouterr().out.split())
    assert main(["simulate", str(file), "--against", "none"]) == 2


def test_a_problem_without_a_law_is_refused():
    problem = stated(SOUND).changed(law=None)
    with pytest.raises(avc.InputError, match=r"allowed: a table \[law\]"):
        try_law(problem)
