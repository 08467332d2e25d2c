"""A row without a number is no measurement, and the rest of the log tells as much as before."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_device import Buzzing, logged
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi.diagnose.causes import diagnose
from avc_casadi.diagnose.law import find_law
from avc_casadi.diagnose.oscillation import find_oscillation, log_of
from avc_casadi.identification.log import Columns, faults_of


@given(st.integers(0, 10**6))
@settings(max_examples=20)
def test_a_loop_that_buzzes_or_taps_is_no_counter_that_wraps(seed):
    random = np.random.default_rng(seed)
    loop = Buzzing(
        stiffness=float(random.uniform(300, 12000)),
        damper=float(random.uniform(0, 30)),
        delay=float(random.uniform(0, 3)),
        encoder=float(10 ** random.uniform(-6, -4)),
    )
    time, position, force = logged(loop, 3.0)
    assert not faults_of(Columns("log", time, position, force), swing=True)


@pytest.mark.thorough
def test_a_row_without_a_number_does_not_change_a_diagnosis():
    time, position, force = logged(Buzzing(stiffness=6000.0, delay=4.0))
    holed = position.copy()
    holed[700] = np.nan
    mended = Columns("log", time, holed, force).complete()
    assert "1 sample" in mended.told[0]
    whole, found = (diagnose(one) for one in (Columns("log", time, position, force), mended))
    assert found.cause == whole.cause


def with_holes(log, rows, **lost):
    """Return a log with its positions, or other columns too, not a number at some rows, as a reader leaves them out."""
    columns = {name: getattr(log, name).copy() for name in ("time_s", "position_m", "force_n")}
    for name in ("position_m", *lost):
        columns[name][rows] = np.nan
    return replace(log, **columns).complete()


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
