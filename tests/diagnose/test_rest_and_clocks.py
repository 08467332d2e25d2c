"""Swings that come to rest, dead zones, and laws on a clock of their own, in logs of a simulator of plain steps."""

from dataclasses import replace

import numpy as np
import pytest
from held_device import held_log
from quick import first

from avc_casadi.diagnose.causes import diagnose
from avc_casadi.diagnose.clock import clock_of
from avc_casadi.identification.log import Columns
from avc_casadi.model.device import Device

STEP = 2 * np.pi / 16384
KEYS = {
    "mass": "mass_kg", "damping": "damping_ns_per_m", "friction": "coulomb_friction_n", "period": "sample_time_s",
    "delay": "delay_samples", "limit": "max_force_n", "step": "encoder_resolution_m",
}  # fmt: skip
SMALL = {"mass": 4e-6, "damping": 1e-6, "friction": 2e-4, "period": 1e-3, "delay": 0, "limit": 0.1, "step": STEP}
WHEEL = {"mass": 0.02, "damping": 0.02, "friction": 0.01, "period": 1e-3, "delay": 1, "limit": 5.0, "step": STEP}


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def device_of(loop):
    return Device.model_validate(
        {"motion": "rotary", "handle_radius_m": 0.1} | {KEYS[name]: value for name, value in loop.items()}
    )


def outside(position, half_width):
    return position - np.clip(position, -half_width, half_width)


def game(hertz, phase, k, half_width, log_period):
    """Return a law that is new at its own ticks, a step late, and held between them."""
    state = {"next": phase / hertz, "waiting": 0.0, "force": 0.0}

    def law(tick, seen, _):
        if tick * log_period >= state["next"] - 1e-12:
            state.update(next=state["next"] + 1 / hertz, force=state["waiting"])
            state["waiting"] = -k * outside(seen, half_width)
        return state["force"]

    return law


@pytest.mark.parametrize(
    ("half_width", "b", "start"), [(0.0, 0.0, 0.06), (np.radians(1), 0.0, 0.12), slow(np.radians(1), 2e-5, 0.12)]
)
def test_a_swing_that_comes_to_rest_is_told_with_its_frequency_and_the_time_of_rest(half_width, b, start):
    def law(_, seen, speed):
        return -0.04 * outside(seen, half_width) - b * speed

    log = held_log(law, **SMALL, ticks=1500, start=start, rotary=True)
    found = diagnose(log, device=device_of(SMALL))
    moved = np.flatnonzero(np.abs(log.position_m - log.position_m[-1]) > 1.5 * STEP)
    rises = np.flatnonzero((log.position_m[1:] > 0) & (log.position_m[:-1] <= 0))
    assert found.verdict == "nothing wrong", found.conclusion
    rest_s = found.data()["oscillation"]["rest_from_s"]
    assert rest_s == pytest.approx(1e-3 * (moved[-1] + 1), abs=5e-3)
    if not half_width:
        assert found.swing.frequency_hz == pytest.approx(1e3 / np.diff(rises).mean(), rel=0.03)
    assert f"stands still from {rest_s:.3g} s" in found.conclusion


def test_a_swing_that_grows_until_the_force_is_cut_does_not_come_to_rest_by_itself():
    def law(tick, seen, _):
        return -8.0 * seen if tick < 700 else 0.0

    loop = WHEEL | {"delay": 8, "friction": 0.06}
    log = held_log(law, **loop, ticks=3000, start=0.1, rotary=True)
    assert np.ptp(log.position_m[-300:]) < STEP
    assert diagnose(log, device=device_of(loop | {"delay": 1})).verdict != "nothing wrong"


@pytest.mark.parametrize("hertz", first([60.0, 72.3, 144.0, 400.0, 30.7]))
@pytest.mark.parametrize("log_hz", first([500.0, 1000.0, 2000.0]))
def test_rate_and_phase_of_a_law_are_told_by_where_its_force_changes(hertz, log_hz):
    samples, period = round(1.5 * log_hz), log_hz / hertz
    position = np.sin(2 * np.pi * 2.3 * np.arange(samples) / log_hz)
    ticks = np.ceil((0.37 + np.arange(int((samples - 1) / period - 0.37) + 1)) * period - 1e-9).astype(int)
    held = position[np.maximum(ticks[np.searchsorted(ticks, np.arange(samples), side="right") - 1], 0)]
    held[: ticks[0]] = 0.0
    clock = clock_of(position, held)
    assert clock.period == pytest.approx(period, rel=2e-3)
    rows = clock.rows(samples)
    assert np.array_equal(rows, ticks)


@pytest.mark.parametrize(
    ("hertz", "log_hz", "k", "half_width", "phase"),
    [(60.0, 1000.0, 6.0, 0.0, 0.3), slow(60.0, 2000.0, 6.0, 0.05, 0.8), slow(75.0, 1000.0, 8.0, 0.0, 0.1),
     slow(60.0, 1000.0, 6.0, 0.05, 0.5), slow(62.5, 1000.0, 6.0, 0.05, 0.5), slow(144.0, 1000.0, 25.0, 0.0, 0.6),
     slow(400.0, 1000.0, 30.0, 0.0, 0.2)],
)  # fmt: skip
def test_a_law_at_a_rate_that_is_no_part_of_the_logs_is_fitted_at_its_own_ticks(hertz, log_hz, k, half_width, phase):
    loop = WHEEL | {"period": 1 / log_hz}
    law = game(hertz, phase, k, half_width, 1 / log_hz)
    log = held_log(law, **loop, ticks=round(2 * log_hz), start=0.15, rotary=True)
    found = diagnose(log, device=device_of(loop))
    assert found.log.period_s == pytest.approx(1 / hertz, rel=1e-3)
    assert (found.law.stiffness_n_per_m, found.law.lag) == (pytest.approx(k, rel=1e-3), pytest.approx(1.0))
    if half_width:
        assert found.law.dead_zone_m == pytest.approx((-half_width, half_width), rel=0.02)
    # At 400 Hz a step costs no more than the damper that is missing.
    assert found.cause == "rate" if hertz < 300 else found.cause in {"rate", "stiffness", "delay"}, found.conclusion


def compensated(size, width, filter_s, *, relay=False):
    """Return a spring and damper with friction that is compensated behind a filter of the velocity."""
    keep, state = np.exp(-1e-3 / filter_s) if filter_s else 0.0, [0.0]

    def law(_, seen, speed):
        state[0] = keep * state[0] + (1 - keep) * speed
        sign = np.sign(state[0]) if relay else np.tanh(state[0] / width)
        return -20 * seen - 0.3 * state[0] + size * sign

    return law


RUBS = WHEEL | {"mass": 0.03, "friction": 0.4, "delay": 2, "limit": 8.0}


@pytest.mark.slow
@pytest.mark.parametrize(("size", "width", "filter_s"), [(0.6, 0.02, 3e-3)])
def test_friction_compensated_behind_a_filter_is_named_and_the_interval_of_the_delay_holds_it(size, width, filter_s):
    log = held_log(compensated(size, width, filter_s), **RUBS, ticks=3000, start=0.15, rotary=True)
    found = diagnose(log, device=device_of(RUBS))
    assert found.cause == "relay", found.conclusion
    assert -found.law.switch.force_n == pytest.approx(size, rel=0.05)
    if filter_s:
        assert -1e-3 / np.log(found.law.switch.keep) == pytest.approx(filter_s, rel=0.2)
    measured = found.data()["measured"]
    assert abs(measured["delay_samples"] - 2) <= measured["delay_error_samples"]


@pytest.mark.parametrize("size", [0.6, 0.3])
def test_a_reversed_motor_beside_compensated_friction_is_named(size):
    law = compensated(size, 0.02, 0.0)
    log = held_log(law, **RUBS, ticks=1500, start=0.15, rotary=True, given_by=lambda force: -force)
    found = diagnose(log, device=device_of(RUBS))
    assert found.cause == "sign", found.conclusion


@pytest.mark.parametrize("force_n", [0.0, -1.5])
def test_a_device_that_stands_still_over_the_whole_log_is_said_to(force_n):
    log = Columns("still", 1e-3 * np.arange(900), np.full(900, 0.0123), np.full(900, force_n))
    found = diagnose(log)
    assert found.verdict == "cannot tell"
    assert "stands still over the whole log" in found.conclusion


def test_a_dead_zone_is_seen_of_a_device_that_rests_after_two_swings():
    friction = WHEEL | {"friction": 0.5, "delay": 1}

    def law(_, seen, __):
        return -20.0 * outside(seen, 0.01)

    log = held_log(law, **friction, ticks=1800, start=0.14, rotary=True)
    found = diagnose(log, device=device_of(friction))
    assert found.verdict == "nothing wrong", found.conclusion
    low, high = found.law.dead_zone_m
    assert high - low == pytest.approx(0.02, rel=0.05)


@pytest.mark.slow
def test_rows_that_a_log_has_lost_leave_the_delay_where_it_is():
    def law(_, seen, speed):
        return -30.0 * seen - 0.1 * speed

    loop = WHEEL | {"delay": 6}
    log = held_log(law, **loop, ticks=1800, start=0.05, rotary=True)
    meant = device_of(loop | {"delay": 1})
    kept = np.random.default_rng(4).random(log.time_s.size) > 0.04
    lost = replace(log, time_s=log.time_s[kept], position_m=log.position_m[kept], force_n=log.force_n[kept])
    whole, with_gaps = (diagnose(each, device=meant) for each in (log, lost))
    assert whole.cause == with_gaps.cause == "delay"
    assert with_gaps.data()["measured"]["delay_samples"] == pytest.approx(6, abs=0.5)
