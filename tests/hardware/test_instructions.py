"""Instructions of a control tick: counted one by one, the same in two emulators, and within the budget."""

import functools
import math
import statistics

import pytest
from hardware_bench import coupling, dense_believer, require
from tick_profile import TickCount, tick_instructions

from avc_casadi.model.runtime import Runtime

MADE = coupling(200, seed=3, largest=(300.0, 1e5, 50.0), runtime=Runtime(guard="passivity-controller"))
TICKS = 40
# Constant gains with a guard, and an observer of three states before them; gains that follow the frequency, with
# everything but the estimator: typical, and where the look-up jumps through the table; then everything. Some 70 of each
# for the faults that are watched for (encoder, speed, energy, overruns, enable line).
STEADY_BUDGET, OBSERVED_BUDGET, TYPICAL_BUDGET, REST_BUDGET, TICK_BUDGET = 300, 600, 600, 680, 2350


def motion(tick: int) -> int:
    """Counts: taps that grow faster, from the rest in which the table was pushed."""
    time = tick * 1e-3
    return round(200 * math.sin(2 * math.pi * (10 + 40 * time) * time))


@functools.cache
def in_unicorn() -> list[TickCount]:
    return list(tick_instructions(MADE, counts=motion, ticks=TICKS))


@pytest.mark.thorough
def test_tick_keeps_its_budget() -> None:
    require("unicorn")
    ticks = in_unicorn()
    rest = [tick.total - tick.functions["avc_estimate_step"] for tick in ticks]
    assert statistics.median(rest) <= TYPICAL_BUDGET
    assert max(rest) <= REST_BUDGET
    assert max(tick.total for tick in ticks) <= TICK_BUDGET


def test_an_observer_keeps_the_budget_of_what_adapts() -> None:
    require("unicorn")
    runtime = Runtime(guard="passivity-controller", state_feedback=dense_believer(3))
    made = coupling(1, largest=(0.0, 1e5, 0.0), runtime=runtime)
    assert max(tick.total for tick in tick_instructions(made, counts=motion, ticks=TICKS)) <= OBSERVED_BUDGET
