"""Hardware in the loop: a frictionless hand presses a stiff wall that the firmware renders on the emulated core."""

import functools

import numpy as np
import pytest
from hardware_bench import coupling, require, with_gains

import avc_casadi as avc
from avc_casadi import Problem
from avc_casadi.coupling import Coupling
from avc_casadi.model.effects import AdaptationEffect, EncoderEffect, EstimatorEffect, HandEffect, WallEffect
from avc_hardware import FirmwareInTheLoop, FirmwareLacksError, LoopResult, check_runs_on, tried_in_the_loop
from avc_hardware.link import messages as m
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import InContactError
from avc_hardware.link.table import lookup

# Stable as the scenes say it: no faster than this in the last half second.
REST_M_PER_S = 5e-3
SLEW_PER_S = 20.0


@pytest.fixture(autouse=True)
def _emulator() -> None:
    require("unicorn")


@functools.cache
def wall() -> Problem:
    """The wall of figure 5 with a contact damper, a hand, no friction; the device's 2 um encoder and 12-bit output."""
    problem = avc.load_problem("damped")
    effects = (
        HandEffect(),
        WallEffect(),
        EncoderEffect(),
        EstimatorEffect(),
        AdaptationEffect(hold_s=0.2, slew_per_s=SLEW_PER_S),
    )
    return problem.changed(scene={"effects": effects})


@functools.cache
def scheduled() -> Coupling:
    return Coupling.from_schedule(wall(), avc.solve(wall(), "schedule"))


def constant(b: float, k: float, b_p: float) -> Coupling:
    return with_gains(wall(), b, k, b_p)


def rest_speed(loop: FirmwareInTheLoop) -> float:
    return float(np.abs(loop.trace.velocity_m_per_s[-500:]).max())


@pytest.mark.slow
def test_stiff_wall_is_stable_with_the_schedule() -> None:
    loop = FirmwareInTheLoop(wall())
    loop.push(scheduled())
    trace = loop.run(3.0)
    assert rest_speed(loop) < REST_M_PER_S
    stiffness = np.mean(trace.force_n[-500:]) / np.mean(trace.position_m[-500:])
    assert stiffness == pytest.approx(wall().environment.stiffness_n_per_m, rel=0.08)
    status = loop.status()
    assert (status.overruns, status.faults) == (0, 0)


@pytest.mark.slow
def test_stiff_wall_is_unstable_without_a_coupling() -> None:
    loop = FirmwareInTheLoop(wall())
    loop.push(constant(1e4, 1e8, 0.0))
    loop.run(3.0)
    assert rest_speed(loop) > 10 * REST_M_PER_S


@pytest.mark.slow
def test_stiff_wall_is_stable_with_gains_streamed_live() -> None:
    """The table underneath would not hold it; the streamed gains do, and after them the table does not."""
    loop = FirmwareInTheLoop(wall())
    under = constant(1e4, 1e8, 0.0)
    loop.push(under)
    loop.run(1e-3)
    sent = 0
    session, ticks = loop.connection.session, round(3 / 50 / 1e-3)
    rows = scheduled().table.single()
    lookup_hz = np.float32(1.0)
    while len(loop.trace.position_m) < 2500:
        b, k, b_p = map(float, lookup(rows, lookup_hz))
        payload = m.set_gains(int(under.id, 16), sent, ticks, b, k, b_p)
        taken = loop.connection.run(session.ask(Kind.SET_GAINS, payload, m.GainsTaken))
        lookup_hz = np.float32(taken.lookup_hz)
        sent += 1
        loop.run(0.015)
    assert sent > 100
    assert rest_speed(loop) < REST_M_PER_S
    loop.run(1.5)
    assert rest_speed(loop) > 10 * REST_M_PER_S


@pytest.mark.slow
def test_firmware_feels_like_the_scene() -> None:
    """The scene knows neither single precision nor the output's 24 mN steps; what the hand feels is the same."""
    loop = FirmwareInTheLoop(wall())
    loop.push(scheduled())
    trace = loop.run(wall().scene.duration_s)
    scene = avc.simulate(wall(), scheduled())
    difference = np.abs(np.array(trace.position_m) - scene.position_m)
    # A step of the encoder or of the output that falls the other way is felt for some samples, and dies out.
    assert np.sqrt(np.mean(difference**2)) < 5e-6
    assert difference.max() < 5e-5
    assert difference[scene.position_m < 0][:100].max() < 1e-9  # before the wall, the same plant
    assert np.mean(trace.force_n[-500:]) == pytest.approx(scene.force_n[-500:].mean(), rel=0.01)


@pytest.mark.slow
def test_table_pushed_in_contact_does_not_come_into_force() -> None:
    """The hand does not let go: the push is taken back, and the forces are those without it."""
    pushed, plain = (FirmwareInTheLoop(wall()) for _ in range(2))
    for loop in (pushed, plain):
        loop.push(scheduled())
        loop.run(1.5)
    with pytest.raises(InContactError):
        pushed.push(constant(100.0, 3e4, 60.0))
    plain.run(5.0)
    assert pushed.trace.force_n[:6000] == plain.trace.force_n[:6000]
    hellos = [loop.connection.run(loop.connection.session.hello()) for loop in (pushed, plain)]
    assert hellos[0].table_id == hellos[1].table_id


@pytest.mark.slow
def test_a_slow_loop_has_constant_gains_and_none_that_follow_the_frequency() -> None:
    """62.5 ticks a second, which feed the watchdog in time."""
    slow = avc.load_problem("soft").changed(device={"sample_time_s": 0.016}, frequency={"stop_hz": 20.0})
    problem = slow.changed(environment={"stiffness_n_per_m": 30.0, "damping_ns_per_m": 0.0})
    found = tried_in_the_loop(with_gains(problem, 0.0, 300.0))
    assert found.at_rest
    assert found.push.device.sample_time_s == 0.016
    with pytest.raises(FirmwareLacksError, match="its estimator"):
        check_runs_on(coupling(5, sample_time_s=4e-3))


@functools.cache
def tuned(name: str, sample_time_s: float = 1e-3) -> Coupling:
    problem = avc.load_problem(name).changed(device={"sample_time_s": sample_time_s})
    return Coupling.from_schedule(problem, avc.solve(problem, "static-tuned"))


def in_series(coupling: Coupling) -> float:
    k, k_e = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    return k * k_e / (k + k_e)


@functools.cache
def tried(name: str, sample_time_s: float = 1e-3) -> LoopResult:
    return tried_in_the_loop(tuned(name, sample_time_s))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "time_s"), [("ve3", 1e-3), ("soft", 1e-3), ("ve3", 0.25e-3)])
def test_coupling_of_any_wall_and_rate_is_at_rest_with_its_own_wall(name: str, time_s: float) -> None:
    found, coupling = tried(name, time_s), tuned(name, time_s)
    assert found.push.device.sample_time_s == time_s
    assert found.at_rest
    assert found.apparent_stiffness_n_per_m == pytest.approx(in_series(coupling), rel=0.02)
    assert found.status.mode == "table"
    assert found.push.device.coupling_id == coupling.id
    assert (found.status.overruns, found.status.faults, found.status.saturated) == (0, 0, 0)
    assert 0 < found.peak_force_n < 50
    assert found.document()["at_rest"] is True
