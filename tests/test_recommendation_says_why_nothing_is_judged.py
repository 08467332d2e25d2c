"""Where nothing can be recommended, the reason is the true one, and what may be a slip of a unit stands before it."""

import math

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli import main

DEVICE = {"mass_kg": 0.2, "damping_ns_per_m": 1.0, "delay_samples": 1}


def asked(device, **wall):
    return avc.Problem(
        device=DEVICE | device, environment=wall, stability={"model": "sampled-data", "scope": "hands"}, name="asked"
    )


def lines(problem):
    return str(avc.recommend(problem, hands=50, workers=1)).splitlines()


def decays(damper, mass=0.2, drag=1.0, period=1e-3, seconds=2.0):
    """A released device on a damper, its force a sample late and held: exact steps of the mass, written out."""
    kept = math.exp(-drag * period / mass)
    lasts = (1 - kept) / drag
    position, speed, before, acts = 0.0, 0.1, 0.0, 0.0
    swung = []
    for _ in range(int(seconds / period)):
        force = damper * (position - before) / period
        before = position
        position += mass * lasts * speed - acts * (period - mass * lasts) / drag
        speed = kept * speed - lasts * acts
        acts = force
        swung.append(abs(speed))
    return np.max(swung[-100:]) < 1e-3


def test_more_delay_than_is_judged_is_the_reason_and_slips_stand_first():
    page = lines(asked({"delay_samples": 40}, stiffness_n_per_m=2.0, damping_ns_per_m=0.3))
    values, none = (next(i for i, line in enumerate(page) if word in line) for word in ("Values", "Coupling"))
    assert values < none
    assert "linear stability is computed up to 32 samples of delay, not 40" in " ".join(" ".join(page).split())


def test_a_damper_that_is_too_strong_is_told_with_the_largest_that_is_stable():
    reason = avc.recommend(asked({}, stiffness_n_per_m=0.0, damping_ns_per_m=500.0)).reason
    most = float(reason.split("above ")[1].split(" ")[0])
    assert decays(0.98 * most)
    assert not decays(1.02 * most)


@pytest.mark.parametrize("delay", [1, 40])
def test_check_leads_on_where_something_may_be_deployable(delay, capsys, tmp_path):
    file = tmp_path / "p.toml"
    device = f"mass_kg = 0.1\ndamping_ns_per_m = 0.5\ndelay_samples = {delay}"
    file.write_text(f"[device]\n{device}\n[environment]\nstiffness_n_per_m = 600.0\ndamping_ns_per_m = 0.0\n")
    assert main(["check", str(file)]) == 0
    page = capsys.readouterr().out
    assert ("next: avc recommend" in page) == (delay == 1)
    assert ("deploys nothing" in page) == (delay == 40)


@pytest.mark.thorough
def test_a_damper_just_below_is_recommended_and_told_without_limits_of_springs():
    found = avc.recommend(asked({}, stiffness_n_per_m=0.0, damping_ns_per_m=100.0), hands=50, workers=1)
    assert found.coupling is not None
    assert not found.document()["what_would_help"]
    assert "Linear limit" not in str(found)


@pytest.mark.thorough
def test_what_is_only_linearly_stable_is_no_help_where_hands_refute_it():
    engine = {"tool_mass_kg": 0.05, "step_s": 0.004, "integrator": "explicit", "exchange": "held-force"}
    device = {"mass_kg": 0.2, "damping_ns_per_m": 1.0, "delay_samples": 1, "max_force_n": 8.0}
    problem = avc.Problem(device=device, simulation=engine | {"stiffness_n_per_m": 2000.0}, name="asked")
    found = avc.recommend(problem)
    assert found.coupling is None
    assert found.stiffest.stiffness_n_per_m > 2000
    assert "The same K" not in str(found)
