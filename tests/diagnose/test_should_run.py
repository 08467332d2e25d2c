"""A log is compared with the coupling that should have run: coupling and wall in series, written out."""

import json

import numpy as np
import pytest
from quick import first

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.diagnose.law import find_law
from avc_casadi.diagnose.oscillation import find_oscillation, log_of
from avc_casadi.diagnose.should_run import WhyNotCompared, compared_with
from avc_casadi.identification.log import Columns
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.model.runtime import Runtime

T = 1e-3
DIRECT, SOFT, STIFF = Gains(0.0, 1e8, 5.0), Gains(0.37, 1070.0), Gains(8.0, 9000.0)
WALLS = {"rigid": (3000.0, 20.0), "soft": (400.0, 0.0)}


def coupling(gains, wall, runtime=None):
    stiffness, damping = WALLS[wall]
    problem = avc.load_problem("soft").changed(
        device={"sample_time_s": T, "max_force_n": None},
        environment={"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping},
        boundaries={
            bound: {"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping} for bound in ("upper", "lower")
        },
    )
    return Coupling.constant(problem, gains, "x", runtime)


def log(gains, wall, hz=9.0, hold=1):
    """A device that swings down inside of the wall, and the force of coupling and wall, one between them."""
    (k_e, b_e), k, b = WALLS[wall], gains.stiffness_n_per_m, gains.damping_ns_per_m
    time_s = np.arange(3000) * T
    x = np.round((4e-3 + 1e-3 * np.exp(-time_s) * np.sin(2 * np.pi * hz * time_s)) / 1e-6) * 1e-6
    forces, y, tick = [], x[0] * k / (k + k_e), hold * T
    read = x[::hold]
    for now, before in zip(read, [read[0], *read[:-1]], strict=True):
        y_before, y = y, (k * now + b * (now - before + y) / tick + b_e * y / tick) / (k + k_e + (b + b_e) / tick)
        forces.append(k_e * y + b_e * (y - y_before) / tick + gains.contact_damping_ns_per_m * (now - before) / tick)
    return Columns("log.csv", time_s, x, -np.repeat(forces, hold)[: len(x)])


def comparison(columns, made):
    grid, _ = log_of(columns)
    swing = find_oscillation(grid, None)
    return compared_with(made, find_law(grid, swing, None, 0.0), swing, grid)


@pytest.mark.parametrize("wall", first(WALLS))
@pytest.mark.parametrize("gains", first([DIRECT, SOFT, STIFF]), ids=["direct", "soft", "stiff"])
@pytest.mark.parametrize("hz", first([3.0, 20.0]))
def test_the_log_of_a_coupling_runs_it(gains, wall, hz):
    found = comparison(log(gains, wall, hz), coupling(gains, wall))
    assert found.why_not is None
    assert found.runs


@pytest.mark.parametrize(
    ("gains", "wall", "hold"),
    first(
        [
            (Gains(0.0, 1e8, 5.0), "soft", 1),
            (Gains(0.0, 1e8, 25.0), "rigid", 1),
            (Gains(0.0, 1e8, 5.0), "rigid", 2),
            (SOFT, "rigid", 1),
        ]
    ),
    ids=["another wall", "another damper", "half the rate", "another spring"],
)
def test_the_log_of_another_coupling_does_not(gains, wall, hold):
    found = comparison(log(gains, wall, hold=hold), coupling(DIRECT, "rigid"))
    assert found.why_not is None
    assert found.runs is False


@pytest.mark.slow
def test_what_is_no_spring_and_damper_is_not_compared():
    made = coupling(DIRECT, "rigid")
    rows = np.array([[1.0, 1.0, 1e3, 0.0], [10.0, 2.0, 2e3, 0.0]])
    follows = Coupling(made.problem, made.schedule, GainTable(rows))
    reasons = [
        comparison(log(DIRECT, "rigid"), subject).why_not
        for subject in (follows, coupling(DIRECT, "rigid", Runtime(guard="energy-tank")))
    ]
    assert reasons == [WhyNotCompared.TABLE, WhyNotCompared.RUNTIME]
    columns = log(DIRECT, "rigid")
    noise = np.random.default_rng(0).normal(size=len(columns.time_s))
    nonsense = Columns("log.csv", columns.time_s, columns.position_m, noise)
    assert comparison(nonsense, made).why_not is WhyNotCompared.LOG


@pytest.mark.parametrize("gains", first([DIRECT, SOFT]), ids=["direct", "soft"])
def test_diagnose_says_whether_the_log_runs_the_coupling(gains, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    avc.write_coupling(coupling(DIRECT, "rigid"), "c.json")
    columns = log(gains, "rigid")
    table = np.stack([columns.time_s, columns.position_m, columns.force_n], axis=1)
    np.savetxt("log.csv", table, delimiter=",", header="time_s,position_m,force_n", comments="")
    main(["diagnose", "log.csv", "--coupling", "c.json"])
    said = " ".join(capsys.readouterr().out.split())
    assert ("the log does not run coupling" in said) == (gains is SOFT)
    assert ("the force is that of coupling" in said) == (gains is DIRECT)
    main(["diagnose", "log.csv", "--coupling", "c.json", "--json"])
    compared = json.loads(capsys.readouterr().out)["compared"]
    assert compared["runs"] is (gains is DIRECT)
    assert compared["stiffness_n_per_m"] == pytest.approx(3000.0, rel=1e-3)
    assert compared["damping_ns_per_m"] == pytest.approx(25.0, rel=1e-3)
