"""Commissioning: an accepted pulse moves every declared device by more than the encoder needs, and none a dead one."""

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_commissioning_names_what_is_wired_wrongly import bench

from avc_casadi import InputError
from avc_casadi.model.device import Device
from avc_hardware import DeviceFault, Wiring, commission
from avc_hardware.link.commission import LEAST_COUNTS, Moved, pulse_plan

# By the formula without viscous damping its pulse of 0.8 N would last 27 ms and be seen as two counts.
DAMPED = Device(mass_kg=0.1, damping_ns_per_m=60.0, coulomb_friction_n=0.05, encoder_resolution_m=5e-5, max_force_n=8.0)


def decades(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(math.log(low), math.log(high)).map(math.exp)


masses, dampings, frictions, steps = decades(0.01, 5), decades(1e-3, 300), decades(1e-3, 3), decades(1e-6, 2e-4)


def held(device: Moved, v: float, force_n: float, left_s: float) -> tuple[float, float]:
    """Way and speed after a time of constant force: the exact solution from one stop to the next."""
    way = 0.0
    while left_s > 0:
        if v == 0 and abs(force_n) <= device.friction_n:
            break
        net = force_n - math.copysign(device.friction_n, v or force_n)
        if device.damping_ns_per_m == 0:
            stop = -v * device.mass_kg / net if net * v < 0 else math.inf
            time = min(stop, left_s)
            way += (v + net / device.mass_kg * time / 2) * time
            v += net / device.mass_kg * time
        else:
            decay_s, end = device.mass_kg / device.damping_ns_per_m, net / device.damping_ns_per_m
            stop = decay_s * math.log1p(-v / end) if end * v < 0 else math.inf
            time = min(stop, left_s)
            gone = -math.expm1(-time / decay_s)
            way += end * time + (v - end) * decay_s * gone
            v += (end - v) * gone
        v = 0.0 if time == stop else v
        left_s -= time
    return way, v


def furthest_m(device: Moved, force_n: float, ticks: int, sample_time_s: float) -> float:
    """The furthest that a pulse held from tick to tick moves a device, by its sign."""
    x = v = most = 0.0
    for tick in range(ticks):
        way, v = held(device, v, force_n * math.sin(2 * math.pi * tick / ticks), sample_time_s)
        x += way
        most = max(most, x, key=abs)
    return most


@pytest.mark.thorough
@given(masses, dampings, frictions, decades(1.05, 20), decades(0.02, 1))
@settings(max_examples=40)
def test_the_way_of_a_pulse_is_that_of_its_equation_of_motion(
    mass: float, damping: float, friction: float, over: float, seconds: float
) -> None:
    device = Moved(mass, damping, friction)
    simulated = furthest_m(device, over * friction, 1500, seconds / 1500)
    assert device.way_m(over * friction, seconds) == pytest.approx(simulated, rel=0.02, abs=1e-9)


@pytest.mark.thorough
@given(
    masses, st.one_of(st.just(0.0), dampings), st.one_of(st.just(0.0), frictions), steps, decades(1.0, 30), st.data()
)
@settings(max_examples=60)
def test_no_sound_motor_is_called_dead_for_a_pulse_that_was_accepted(
    mass: float, damping: float, friction: float, step_m: float, over: float, data: st.DataObject
) -> None:
    """The device is anywhere within the ranges that were declared, whose upper ends hold it back most."""
    most = Moved(mass, damping, friction)
    force = over * most.least_n(step_m)
    told = SimpleNamespace(metres_per_count=step_m, sample_time_s=data.draw(st.sampled_from([0.25e-3, 1e-3, 3e-3])))
    plan = pulse_plan(most, cast("Any", told), force)
    share = st.floats(0.3, 1.0)
    own = Moved(mass * data.draw(share), damping * data.draw(share), friction * data.draw(share))
    assert furthest_m(own, force, plan.ticks, plan.sample_time_s) > LEAST_COUNTS * step_m


@pytest.mark.thorough
def test_a_heavily_damped_device_is_commissioned_and_a_dead_motor_found() -> None:
    sound = commission(DAMPED, bench(Wiring.RIGHT, DAMPED))
    assert sound.found == 0
    assert sound.pulse_m > 10 * DAMPED.encoder_resolution_m
    assert commission(DAMPED, bench(Wiring.MOTOR_DEAD, DAMPED)).found == DeviceFault.MOTOR_DEAD


@pytest.mark.thorough
def test_a_pulse_that_damping_leaves_no_way_is_refused_with_one_that_is_enough() -> None:
    thick = DAMPED.model_copy(update={"damping_ns_per_m": 900.0, "coulomb_friction_n": 0.0})
    with pytest.raises(InputError, match=r"and a damping of 900 N\.s/m; allowed: 1\.4\d N or more"):
        commission(thick, bench(Wiring.RIGHT, thick), force_n=1.0)
    assert commission(thick, bench(Wiring.RIGHT, thick)).found == 0
