"""Hardware in the loop: a frictionless hand presses a stiff wall that the firmware renders on the emulated core."""

import dataclasses
import functools

import numpy as np
import pytest
from hardware_bench import require, scratch

import avc_casadi as avc
from avc_casadi import InputError, Problem, UnsupportedError
from avc_casadi.coupling import GainSchedule, Status
from avc_casadi.problem import (
    AdaptationEffect,
    CoulombFrictionEffect,
    EncoderEffect,
    EstimatorEffect,
    HandEffect,
    WallEffect,
)
from avc_hardware import _messages as m
from avc_hardware import gain_table
from avc_hardware._in_the_loop import FirmwareInTheLoop
from avc_hardware._messages import Kind
from avc_hardware._reference import lookup
from avc_hardware._runtime_program import RuntimeFigures
from avc_hardware.firmware_build import build_image

# Stable as the scenes say it: no faster than this in the last half second.
REST_M_PER_S = 5e-3
OUTPUT_STEP_N = 50.0 / 2047
# One step of the encoder in one tick, as force of wall and contact damper: what the loop rattles with at rest.
COUNT_N = 2e-6 * (1e5 + 150.0 / 1e-3)


@pytest.fixture(autouse=True)
def _emulator() -> None:
    require("unicorn")


@functools.cache
def wall() -> Problem:
    """The wall of figure 5 with a contact damper, a hand, no friction; the device's 2 um encoder and 12-bit output."""
    problem = avc.load_problem("damped")
    figures = RuntimeFigures()
    effects = (
        HandEffect(),
        WallEffect(),
        EncoderEffect(),
        EstimatorEffect(),
        AdaptationEffect(hold_s=figures.hold_s, slew_per_s=figures.slew_per_s),
    )
    return problem.changed(scene={"effects": effects})


@functools.cache
def schedule_gains() -> GainSchedule:
    return avc.solve(wall(), "schedule")


def constant(b: float, k: float, b_p: float) -> GainSchedule:
    rows = schedule_gains().rows
    return dataclasses.replace(
        schedule_gains(),
        damping_ns_per_m=np.full(rows, b),
        stiffness_n_per_m=np.full(rows, k),
        contact_damping_ns_per_m=np.full(rows, b_p),
        status=(Status.SOLVED,) * rows,
    )


def rest_speed(loop: FirmwareInTheLoop) -> float:
    return float(np.abs(loop.trace.velocity_m_per_s[-500:]).max())


def test_stiff_wall_is_stable_with_the_schedule() -> None:
    loop = FirmwareInTheLoop(wall())
    loop.push(schedule_gains())
    trace = loop.run(3.0)
    assert rest_speed(loop) < REST_M_PER_S
    stiffness = np.mean(trace.force_n[-500:]) / np.mean(trace.position_m[-500:])
    assert stiffness == pytest.approx(wall().environment.stiffness_n_per_m, rel=0.08)
    status = loop.status()
    assert (status.overruns, status.not_finite, status.frames_bad) == (0, 0, 0)


def test_stiff_wall_is_unstable_without_a_coupling() -> None:
    loop = FirmwareInTheLoop(wall())
    loop.push(constant(1e4, 1e8, 0.0))
    loop.run(3.0)
    assert rest_speed(loop) > 10 * REST_M_PER_S


def test_stiff_wall_is_stable_with_gains_streamed_live() -> None:
    """The table underneath would not hold it; the streamed gains do, and after them the table does not."""
    loop = FirmwareInTheLoop(wall())
    loop.push(constant(1e4, 1e8, 0.0))
    loop.run(1e-3)
    sent = 0
    session, ticks = loop.connection.session, round(3 / 50 / 1e-3)
    rows = gain_table(schedule_gains()).rows
    lookup_hz = np.float32(1.0)
    while len(loop.trace.position_m) < 2500:
        b, k, b_p = map(float, lookup(rows, lookup_hz))
        taken = loop.connection.run(session.ask(Kind.SET_GAINS, m.set_gains(sent, ticks, b, k, b_p), m.GainsTaken))
        lookup_hz = np.float32(taken.lookup_hz)
        sent += 1
        loop.run(0.015)
    assert sent > 100
    assert rest_speed(loop) < REST_M_PER_S
    loop.run(1.5)
    assert rest_speed(loop) > 10 * REST_M_PER_S


def test_firmware_feels_like_the_scene() -> None:
    """The scene knows neither single precision nor the output's 24 mN steps; what the hand feels is the same."""
    loop = FirmwareInTheLoop(wall())
    loop.push(schedule_gains())
    trace = loop.run(wall().scene.duration_s)
    scene = avc.simulate(wall(), schedule_gains())
    difference = np.abs(np.array(trace.position_m) - scene.position_m)
    # A step of the encoder or of the output that falls the other way is felt for some samples, and dies out.
    assert np.sqrt(np.mean(difference**2)) < 5e-6
    assert difference.max() < 5e-5
    assert difference[scene.position_m < 0][:100].max() < 1e-9  # before the wall, the same plant
    assert np.mean(trace.force_n[-500:]) == pytest.approx(scene.force_n[-500:].mean(), rel=0.01)


def test_table_pushed_in_contact_comes_into_force_without_a_jump() -> None:
    """Two runs that differ only in the push; at the swap the same state meets the old and the new gains."""
    softer = constant(100.0, 3e4, 60.0)

    def run(push: bool) -> tuple[FirmwareInTheLoop, list[float]]:
        loop = FirmwareInTheLoop(wall())
        loop.push(schedule_gains())
        loop.run(1.5)
        if push:
            loop.push(softer)
        loop.run(3.0 - len(loop.trace.position_m) * 1e-3)
        return loop, loop.trace.force_n

    changed, force = run(push=True)
    _, unchanged = run(push=False)
    first = next(tick for tick, pair in enumerate(zip(force, unchanged, strict=False)) if pair[0] != pair[1])
    assert first > 1500
    slew = RuntimeFigures().slew_per_s * 1e-3
    # Force follows each gain at most in proportion: b, k, and b_p at rest, and what the output rounds.
    assert abs(force[first] - unchanged[first]) <= 2 * slew * unchanged[first] + OUTPUT_STEP_N
    assert np.abs(np.diff(force[first:])).max() < 2 * COUNT_N
    assert min(force[first:]) > 0
    assert rest_speed(changed) < REST_M_PER_S
    stiffness = np.mean(force[-500:]) / np.mean(changed.trace.position_m[-500:])
    assert stiffness == pytest.approx(1 / (1 / 1e5 + 1 / 3e4), rel=0.05)


def test_loop_is_the_same_in_every_run() -> None:
    traces = []
    for _ in range(2):
        loop = FirmwareInTheLoop(wall())
        loop.push(schedule_gains())
        traces.append(loop.run(0.5))
    assert traces[0] == traces[1]


def test_loop_in_qemu_is_stable_and_the_same_in_every_run() -> None:
    """Another emulator and no steps of the output: the hand feels the same, and QEMU repeats itself to the last bit."""
    require("qemu-system-arm", "arm-none-eabi-gcc")
    image = build_image("bench-m4f", scratch())
    traces = []
    for _ in range(2):
        loop = FirmwareInTheLoop(wall(), qemu=(image, "bench-m4f"))
        try:
            loop.push(schedule_gains())
            loop.run(2.0)
            assert loop.status().overruns == 0
        finally:
            loop.stop()
        traces.append(loop.trace)
        assert rest_speed(loop) < REST_M_PER_S
    assert traces[0] == traces[1]
    other = FirmwareInTheLoop(wall())
    other.push(schedule_gains())
    difference = np.array(other.run(2.0).position_m[:1990]) - np.array(traces[0].position_m[:1990])
    assert np.sqrt(np.mean(difference**2)) < 5e-6


def test_lost_heartbeat_takes_the_force_away_and_comes_back_safe() -> None:
    loop = FirmwareInTheLoop(wall())
    loop.push(schedule_gains())
    loop.run(1.5)
    assert loop.status().contact
    loop.connection.heartbeat(0.2)
    before = len(loop.trace.force_n)
    loop.run(0.15)
    assert loop.status().mode == "table"
    loop.run(0.3)
    status = loop.status()
    assert status.mode != "table"
    assert status.heartbeats_missed == 1
    ramp = np.array(loop.trace.force_n[before:])
    assert ramp[-50:].max() <= OUTPUT_STEP_N
    assert np.abs(np.diff(ramp)).max() < 2 * COUNT_N  # no jump on the way to nothing
    loop.connection.heartbeat(0.0)
    loop.run(0.05)
    assert loop.status().mode == "safe"  # still inside the wall: no force comes back there


def test_bench_refuses_what_it_does_not_have() -> None:
    with pytest.raises(UnsupportedError, match="coulomb-friction"):
        FirmwareInTheLoop(avc.load_problem("damped").model_copy(update={"scene": friction()}))
    other = wall().changed(device={"sample_time_s": 5e-4})
    with pytest.raises(InputError, match="the firmware's"):
        FirmwareInTheLoop(other)


def friction() -> object:
    return wall().scene.model_copy(update={"effects": (HandEffect(), WallEffect(), CoulombFrictionEffect())})
