"""The impedance error that is told is that of a handle shaken before a plant and a law written here."""

import math

import casadi as ca
import numpy as np
import pytest
from exported import Exported
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import GUESSES, regulator
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.rendered import (
    NOTICED_N,
    SLOW_M_PER_S,
    contact_onset_m,
    creep,
    frequency_sweep,
    rebound,
    ripple,
)
from avc_casadi.simulation.runtime.observer import state_feedback_step

T, WALL, MASS, DAMPING = 1e-3, 20e3, 0.2, 1.0
BASE = {"mass_kg": MASS, "damping_ns_per_m": DAMPING, "sample_time_s": T, "max_force_n": 8.0}


def problem(wall=WALL, damper=0.0, **device):
    return avc.load_problem("spring").changed(
        device=BASE | device, environment={"stiffness_n_per_m": wall, "damping_ns_per_m": damper}
    )


def measured(force_of, depth, amplitude, hz, late=0.0):
    """Lead the handle along depth + amplitude sin(2 pi f t); return Z_h from the force that is held, as told."""
    each = round(1 / (hz * T))
    count = each * round(max(4 * hz, 8)) + 1000
    time = T * np.arange(count)
    x = depth * np.minimum(time / 0.25, 1) + amplitude * np.sin(2 * np.pi * hz * np.maximum(time - 0.25, 0))
    force = force_of(x)
    last = slice(count - each * round(max(2 * hz, 4)), count)
    wave = np.exp(-2j * np.pi * hz * time[last])
    s = 2j * np.pi * hz
    stiffness = ((force[last] - force[last].mean()) @ wave) / ((x[last] - x[last].mean()) @ wave)
    hold = (1 - np.exp(-s * T)) / (s * T) * np.exp(-s * T * late)
    return MASS * s + DAMPING + stiffness * hold / s


def relative(found, hz, wall=WALL, damper=0.0):
    s = 2j * np.pi * hz
    own = damper + wall / s
    wanted = MASS * s + DAMPING + own
    return abs(found - wanted) / max(abs(wanted), abs(own))


def told_and_measured(coupling, felt, force_of, hz, late=0.0, **wall):
    told = frequency_sweep(coupling, felt, [hz])
    return told.error[0], relative(measured(force_of, told.depth_m, told.amplitude_m, hz, late), hz, **wall)


@pytest.mark.parametrize("hz", [1.0, 10.0, 50.0])
def test_of_a_contact_damper_behind_a_coarse_encoder(hz):
    step, damper = 30e-6, 25.0
    coupling = Coupling.constant(problem(encoder_resolution_m=step, delay_samples=1), Gains(0.0, 1e12, damper), "mine")

    def force_of(x):
        z = np.round(x / step) * step
        before = np.concatenate([z[:1], z[:-1]])
        force = WALL * z + damper * (z - before) / T
        return np.where((z > 0) & (force > 0), force, 0.0)

    told, found = told_and_measured(coupling, WALL, force_of, hz, late=1.0)
    assert told == pytest.approx(found, rel=0.1, abs=1e-3)  # where the steps fall differs a little


@pytest.mark.parametrize("hz", [1.0, 10.0])
@pytest.mark.parametrize("opens", [False, True])
def test_of_a_law_with_a_dead_zone(hz, opens):
    step = 15e-6
    stated = problem(encoder_resolution_m=step)
    law = regulator(stated.device, stated.hands, WALL, GUESSES[2])
    law = law if opens else law.linear.model_copy(update={"dead_zone_m": law.dead_zone_m})
    coupling = Coupling.constant(stated, Gains(0.0, 1e12), "mine", Runtime(state_feedback=law))
    a, b, gain, weight = (np.array(part) for part in (law.state, law.force_m_per_n, law.innovation, law.feedback))

    def force_of(x):
        state, forces = np.zeros(len(b)), []
        smooth = high = low = 0.0
        for z in np.round(x / step) * step:
            error, closed = z - state[law.measures], 1.0
            if opens:
                smooth = z + law.smoothing * (smooth - z)
                high = min(max(smooth, smooth + law.kept * (high - smooth)), smooth + law.open_m)
                low = max(min(smooth, smooth + law.kept * (low - smooth)), smooth - law.open_m)
                closed -= np.clip((high - low - law.opens_m) / (law.open_m - law.opens_m), 0.0, 1.0)
            outside = np.sign(error) * max(abs(error) - law.dead_zone_m, 0.0)
            state = state + gain * (closed * outside + (1.0 - closed) * error)
            force = max(WALL * (weight @ state), 0.0)
            state = a @ state + b * force
            forces.append(force)
        return np.array(forces)

    told, found = told_and_measured(coupling, WALL, force_of, hz)
    assert told == pytest.approx(found, rel=0.05, abs=5e-3)
    without = Coupling.constant(problem(), Gains(0.0, 1e12), "mine", Runtime(state_feedback=law.linear))
    linear = frequency_sweep(without, WALL, [hz]).error[0]
    if opens:
        assert found == pytest.approx(linear, abs=0.01), "it takes nothing from a hand that moves"
    else:
        assert abs(found - linear) > 0.1 * found, "the dead zone has a part in it"


@pytest.mark.slow
def test_the_stiffest_wall_is_felt_by_a_hand_that_moves_and_one_twice_as_stiff_is_not():
    """The C that is exported, led by `measured` about half the force limit."""
    stated, press_n = problem(encoder_resolution_m=1e-5, delay_samples=1), BASE["max_force_n"] / 2

    def off(found):
        wall, runs = found.problem.environment.stiffness_n_per_m, Exported(found.coupling).forces
        lead = (lambda x: runs(np.round(x / 1e-5) * 1e-5), press_n / wall, press_n / wall / 2)
        return wall, max(relative(measured(*lead, hz, 1.0), hz, wall) for hz in (1.0, 3.0, 10.0))

    wall, error = off(avc.recommend(stated, hands=16, stiffest=True))
    assert error < 0.25
    assert off(avc.recommend(stated.changed(environment={"stiffness_n_per_m": 2 * wall}), hands=16))[1] > 0.25


@pytest.mark.slow
def test_a_device_without_mass_has_no_stiffest_wall():
    assert avc.recommend("hard/massless", hands=3, stiffest=True).coupling is None


def test_what_is_rendered_is_felt_beside_the_mass_and_the_damping_of_the_device():
    """Of a wall as soft as the device's own damper is at 50 Hz."""
    hz, wall = 50.0, 400.0
    told = frequency_sweep(Coupling.constant(problem(wall), Gains(0.0, 1e12), "mine"), wall, [hz])
    s = 2j * np.pi * hz
    felt = measured(lambda x: wall * x, told.depth_m, told.amplitude_m, hz) - MASS * s - DAMPING
    assert told.stiffness_n_per_m[0] == pytest.approx(abs(felt * s), rel=0.01)


def test_of_a_damper_that_never_pulls():
    damper = 15.0
    coupling = Coupling.constant(problem(wall=0.0, damper=damper), Gains(0.0, 1e12), "mine")

    def force_of(x):
        before = np.concatenate([x[:1], x[:-1]])
        return np.maximum(damper * (x - before) / T, 0.0)

    told, found = told_and_measured(coupling, 0.0, force_of, 1.0, wall=0.0, damper=damper)
    assert told == pytest.approx(found, rel=0.03)
    assert told > 0.3, "half of the cycle is lost"


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("damping", [0.5, 30.0])
def test_a_contact_damper_that_pushes_early_is_told(damping, soft):
    """Cut at 0, k x + b v begins at -b v/k, with k of wall and coupling together."""
    problem = avc.load_problem("spring").changed(
        environment={"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 0.0}, device={"sample_time_s": 1e-4}
    )
    coupling = Coupling.constant(problem, Gains(0.0, 6000.0 if soft else 1e8, damping), "x")
    felt = 1500.0 if soft else 2000.0
    for speed, depth in contact_onset_m(coupling).items():
        # A sample late at most, and the force grows from 0 to what is noticed.
        assert depth == pytest.approx((NOTICED_N - damping * speed) / felt, abs=2e-4 * speed + 2e-5)


def damper(step, period, damping, **device):
    wall = {"stiffness_n_per_m": 0.0, "damping_ns_per_m": damping}
    problem = avc.load_problem("figure5").changed(
        device={"encoder_resolution_m": step, "sample_time_s": period, "delay_samples": 0, "coulomb_friction_n": 0.0}
        | {"mass_kg": 0.06, "max_force_n": 3.3}
        | device,
        environment=wall,
        boundaries={"upper": wall, "lower": wall},
        frequency={"stop_hz": 0.4 / period},
    )
    return Coupling.constant(problem, Gains(0.0, near_rigid_n_per_m(problem.device)), "none")


@pytest.mark.slow
@settings(max_examples=12)
@given(step=st.floats(1e-5, 2e-4), period=st.sampled_from([5e-4, 1e-3, 2e-3]), damping=st.floats(0.5, 8.0))
def test_ripple_of_a_damper_is_that_of_its_pulses(step, period, damping):
    found = ripple(damper(step, period, damping)).force_n
    for speed in SLOW_M_PER_S:
        # So many whole steps in a sample, and one more for a part of the samples.
        shares = np.modf(np.linspace(1.0, 1.1, 2001) * speed * period / step)[0]
        expected = damping * step / period * math.sqrt(np.mean(shares * (1 - shares)))
        assert found[speed] == pytest.approx(expected, rel=0.1, abs=0.05 * damping * step / period)


def test_hands_feel_the_pulses_of_a_coarse_encoder_and_none_of_a_fine_one():
    coarse, fine = (ripple(damper(step, 1e-3, 5.0)) for step in (55e-6, 0.2e-6))
    assert coarse.quiet < coarse.hands
    assert coarse.force_n[0.02] == pytest.approx(0.13, abs=0.01)
    assert fine.quiet == fine.hands


# What a hand holds is the handle, beyond a spring.

RATIO, TURN = 0.4, 2 * math.pi * 80.0
RESONANCE = {"frequency_hz": 80.0, "damping_ratio": 0.05, "mass_ratio": RATIO}
REDUCED, SUBSTEPS = MASS * RATIO * (1 - RATIO), 40


def flexible(coupling, start, speed=0.0, handle=None, samples=700, phase=0.0):
    """Return motor, handle, speed of the handle and the pull of the spring between them, before each substep."""
    device, law, h, path = coupling.problem.device, Exported(coupling), T / SUBSTEPS, []
    (x, v), (y, w), step = (start, speed), (start, speed), device.encoder_resolution_m
    queue = [0.0] * int(device.delay_samples)
    for sample in range(samples):
        queue.append(law.step((round(x / step - phase) + phase) * step if step else x))
        force = queue.pop(0)
        for place in range(sample * SUBSTEPS, (sample + 1) * SUBSTEPS):
            if handle is not None:
                y, w = handle[place], (handle[place + 1] - handle[place]) / h
            pull = REDUCED * (TURN**2 * (y - x) + 0.1 * TURN * (w - v))
            path.append((x, y, w, pull))
            v += h / (MASS * (1 - RATIO)) * (pull - force - DAMPING * v)
            x += h * v
            if handle is None:
                w -= h / (MASS * RATIO) * pull
                y += h * w
    return np.array(path).T


@pytest.mark.parametrize("hz", first([10.0, 50.0]))
def test_a_flexible_device_is_shaken_at_its_handle(hz):
    coupling = Coupling.constant(problem(2e3, resonance=RESONANCE, max_force_n=1e3), Gains(0.0, 1e9, 4.0), "mine")
    told, samples = frequency_sweep(coupling, 2e3, [hz]), 2000
    time = T / SUBSTEPS * np.arange(samples * SUBSTEPS + 1)
    depth = 5 / 2e3 + 5 / (REDUCED * TURN**2)
    assert (told.depth_m, told.amplitude_m) == pytest.approx((depth, depth / 2))
    handle = depth * np.minimum(time / 0.25, 1) + depth / 2 * np.sin(2 * np.pi * hz * np.maximum(time - 0.25, 0))
    pull, last = flexible(coupling, 0.0, handle=handle, samples=samples)[3], slice(-1000 * SUBSTEPS - 1, -1)
    wave = np.exp(-2j * np.pi * hz * time[last])
    s = 2j * np.pi * hz
    felt = (pull[-1000 * SUBSTEPS :] @ wave) / (handle[last] @ wave) / s + MASS * RATIO * s
    assert told.error[0] == pytest.approx(relative(felt, hz, 2e3), rel=0.02)


@pytest.mark.parametrize(("step", "delay", "damper"), first([(0.0, 0, 4.0), (2e-4, 1, 8.0)]))
def test_a_flexible_device_rebounds_at_its_handle(step, delay, damper):
    """Over the speed at which it would reach the face: where a damper pushes before that it comes more slowly."""
    device = {"resonance": RESONANCE, "max_force_n": 40.0, "encoder_resolution_m": step, "delay_samples": delay}
    coupling = Coupling.constant(problem(2e3, **device), Gains(0.0, 1e9, damper), "mine")
    for speed, share in rebound(coupling).items():
        found = []
        for phase in np.arange(12 if step else 1) / 12:
            motor, _, handle, _ = flexible(coupling, -0.03, speed + 0.03 * DAMPING / MASS, phase=phase)
            found.append(-handle[np.flatnonzero(motor > 0)[-1] + 1 :].min() / speed)
        assert share == pytest.approx(max(found), rel=0.03)


@pytest.mark.parametrize(("share", "plays"), first([(0.5, 1.0), (5.0, 0.0)]))
def test_a_hand_that_creeps_feels_the_play_that_is_told_and_a_faster_one_does_not(share, plays):
    """In, back and in again at a share of the speed from which the dead zone opens, beside the law without one."""
    step = 20e-6
    stated = problem(encoder_resolution_m=step)
    law = regulator(stated.device, stated.hands, WALL, GUESSES[2])
    told = creep(Coupling.constant(stated, Gains(0.0, 1e12), "mine", Runtime(state_feedback=law)))
    leg = round(3 * told.play_m / (share * told.speed_m_per_s) / T)
    way = np.linspace(3e-3, 3e-3 + 3 * told.play_m, leg)
    x = np.concatenate([way, way[::-1], way])
    run = state_feedback_step(law)

    def play(rendered):
        """How much deeper the law believes the device on its way back than on its way in."""
        state, force, ahead, numbers = np.zeros(len(run.states)), 0.0, [], ca.DM(rendered.numbers())
        for place, counted in zip(x, np.round(x / step) * step, strict=True):
            state, seen = run.function(state, [counted, force], numbers)
            force = WALL * max(float(seen), 0.0)
            ahead.append(float(seen) - place)
        back, again = (np.median(ahead[place * leg + leg // 2 : (place + 1) * leg]) for place in (1, 2))
        return back - again

    assert (play(law) - play(law.linear)) / told.play_m == pytest.approx(plays, abs=0.15)
    assert told.play_n == pytest.approx(told.play_m * WALL, rel=1e-6)
