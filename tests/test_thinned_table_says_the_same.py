"""What a coupling runs is its schedule within a thousandth of each gain, in the table, the scene and the file."""

import numpy as np
import pytest
from schedule_problems import figure5

from avc_casadi import load_problem, solve
from avc_casadi.coupling import Coupling
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.files.coupling_file import read_coupling, write_coupling
from avc_casadi.model.gains import GainTable
from avc_casadi.model.runtime import Runtime

STATED = 1e-3


def farthest(schedule, table):
    """Largest relative distance of a gain of the schedule from the table, linear in ln(frequency) between its rows."""
    frequency = np.log(table.rows[:, 0])
    columns = schedule.damping_ns_per_m, schedule.stiffness_n_per_m, schedule.contact_damping_ns_per_m
    worst = 0.0
    for gain, kept in zip(columns, table.rows[:, 1:].T, strict=True):
        found = np.interp(np.log(schedule.frequency_hz), frequency, kept)
        size = np.where(gain == 0, max(gain.max(), 1.0), gain)
        worst = max(worst, float(np.max(np.abs(found - gain) / size)))
    return worst


@pytest.fixture(scope="module")
def made():
    problem = figure5(points=150, stability={"model": "sampled-data", "scope": "band"})
    return problem, solve(problem, "schedule")


def test_rows_left_out_are_said_by_the_others_within_a_thousandth(made):
    problem, schedule = made
    coupling = Coupling.of(problem, schedule)
    assert len(coupling.table) < schedule.rows
    assert 0 < farthest(schedule, coupling.table) <= STATED
    # Any single further row that is left out would be missed by more.
    for row in range(1, len(coupling.table) - 1):
        assert farthest(schedule, GainTable(np.delete(coupling.table.rows, row, axis=0))) > STATED


def test_the_file_holds_the_rows_that_run(made, tmp_path):
    coupling = Coupling.of(*made, Runtime())
    write_coupling(coupling, tmp_path / "coupling.json")
    assert read_coupling(tmp_path / "coupling.json").table == coupling.table


@pytest.mark.thorough
def test_the_scene_reads_the_rows_that_run():
    problem = load_problem("scenes/adaptive-press-delayed").changed(scene={"duration_s": 0.3})
    schedule = solve(problem, "schedule")
    table = Coupling.of(problem, schedule).table
    assert len(table) < schedule.rows
    runs = [simulate(problem, gains).position_m for gains in (schedule, table, GainTable.of(schedule))]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
