"""A row without a number, or a position that jumps away for one sample, is no measurement; what moves is."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_device import Buzzing, logged
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_device import Truth, measured, multisine

from avc_casadi.diagnose.causes import diagnose
from avc_casadi.diagnose.law import find_law
from avc_casadi.diagnose.oscillation import find_oscillation, log_of
from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Columns, Record, records_of
from avc_casadi.identification.repair import filled, left_out

DEVICE = Truth(mass=0.12, damping=0.8, coulomb=0.2, delay=1.0, encoder=10e-6, spring=50.0)


def measured_log(seed=3, **changed):
    random = np.random.default_rng(seed)
    truth = replace(DEVICE, **changed)
    time, position, force = measured(truth, multisine(random, 10.0, truth.period, 0.5, 200.0, 1.0), random)
    return Columns("log", time, position, force)


@pytest.mark.thorough
def test_one_position_that_jumps_away_does_not_lean_what_is_found():
    log = measured_log()
    position = log.position_m.copy()
    position[4321] += 5e-3
    position[7000] -= 0.4e-3
    records, faults, told = records_of(replace(log, position_m=position))
    assert not faults
    assert "2 samples" in told[0]
    found, whole = identify(records), identify([Record("log", 1e-3, log.position_m, log.force_n)])
    for key in ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "delay_samples"):
        one, other = found.estimates[key], whole.estimates[key]
        assert abs(one.value - other.value) <= other.high - other.low + one.high - one.low


@pytest.mark.thorough
@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_no_sample_of_what_moves_is_left_out(seed):
    random = np.random.default_rng(seed)
    log = measured_log(
        seed,
        encoder=float(10 ** random.uniform(-6, -4)),
        resonance=float(random.choice([0.0, 80.0, 300.0])),
        ratio=0.01,
        share=0.3,
        coulomb=float(random.choice([0.0, 0.5, 2.0])),
    )
    assert left_out(log) is log


@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_no_sample_of_a_loop_that_buzzes_or_taps_is_left_out(seed):
    random = np.random.default_rng(seed)
    loop = Buzzing(
        stiffness=float(random.uniform(300, 12000)),
        damper=float(random.uniform(0, 30)),
        delay=float(random.uniform(0, 3)),
        encoder=float(10 ** random.uniform(-6, -4)),
    )
    time, position, force = logged(loop, 3.0)
    log = Columns("log", time, position, force)
    assert left_out(log) is log


@pytest.mark.thorough
def test_a_row_without_a_number_does_not_change_a_diagnosis():
    time, position, force = logged(Buzzing(stiffness=6000.0, delay=4.0))
    holed = position.copy()
    holed[700] = np.nan
    mended = filled(Columns("log", time, holed, force))
    assert "1 sample" in mended.told[0]
    whole, found = (diagnose(one) for one in (Columns("log", time, position, force), mended))
    assert found.cause == whole.cause
    assert found.conclusion == whole.conclusion


def with_holes(log, rows, **lost):
    """Return a log with its positions, or other columns too, not a number at some rows, as a reader fills them in."""
    columns = {name: getattr(log, name).copy() for name in ("time_s", "position_m", "force_n")}
    for name in ("position_m", *lost):
        columns[name][rows] = np.nan
    return filled(replace(log, **columns))


HOLES = [337, 338, 900, 1501]


@pytest.mark.parametrize("lost", [{}, {"force_n": True}, {"time_s": True, "force_n": True}])
def test_what_is_read_beside_rows_without_a_number_is_what_the_whole_log_tells(lost):
    """The law and two rates are exact in these logs, and none is with a row of a wrong position."""
    time = 1e-3 * np.arange(2000)
    moved = 1e-3 * np.sin(31 * time) + 4e-4 * np.sin(57 * time + 1)
    plain = 3000 * moved + 12 * np.diff(moved, prepend=moved[0]) / 1e-3
    slow = 3000 * moved[np.arange(2000) // 10 * 10] + 12 * np.diff(moved, prepend=moved[0]) / 1e-3

    def grid(force):
        return log_of(with_holes(Columns("log", time, moved, -force), HOLES, **lost))[0]

    def law_of(log):
        return find_law(log, find_oscillation(log, None), None, 0.0)

    law = law_of(grid(plain))
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((3000, 12), rel=1e-6)
    assert law.misfit < 1e-6
    frames = law_of(grid(slow)).frames
    assert (frames.slow, frames.ticks) == ("spring", 10)


def test_a_row_without_a_position_keeps_its_force_and_is_no_tick_that_was_missed():
    time = 1e-3 * np.arange(2000)
    moved = 1e-3 * np.sin(31 * time)
    log, _ = log_of(with_holes(Columns("log", time, moved, -3000 * moved), HOLES))
    assert np.array_equal(log.force_n, 3000 * moved)
    assert log.ticks.missed_share == 0
    assert np.flatnonzero(~log.ran).tolist() == HOLES
