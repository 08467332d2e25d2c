"""Laws whose force a sign switches, with little or no spring and damper, and laws of a spring or a damper alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from held_device import held_log
from scipy.integrate import quad

from avc_casadi.diagnose.causes import diagnose
from avc_casadi.diagnose.law import Switch, find_law
from avc_casadi.diagnose.law_regression import regress
from avc_casadi.diagnose.oscillation import find_oscillation, log_of
from avc_casadi.model.device import Device

HANDLE = {"mass": 0.2, "damping": 0.5, "friction": 0.0, "limit": 20.0, "start": 2e-3}
STEP = 2e-5


def pressed(law, *, delay=1, rest_m=0.0, step=STEP, ticks=3000, noise=0.0):
    """Return the log of a handle that a hand of 150 N/m holds, without a mass."""
    hand = lambda _, x, v: 150.0 * (rest_m - x) - 4.0 * v  # noqa: E731
    return held_log(law, **HANDLE, delay=delay, step=step, ticks=ticks, noise=noise, outside=hand)


def device_of(step=STEP, noise=0.0):
    return Device(
        mass_kg=0.2, damping_ns_per_m=0.5, delay_samples=1, max_force_n=20.0,
        encoder_resolution_m=step, position_noise_rms_m=noise,
    )  # fmt: skip


def on_one_side(_, seen, __):
    return 5.0 if seen <= 0 else 0.0


def on_one_side_without_the_edge(_, seen, __):
    return 5.0 if seen < 0 else 0.0


def to_both_sides(_, seen, __):
    return -2.5 * np.sign(seen)


def beside_a_small_damper(_, seen, speed):
    return -0.1 * speed - 2.5 * np.sign(seen)


def against_the_speed(keep):
    state = [0.0]

    def law(_, __, speed):
        state[0] = keep * state[0] + (1 - keep) * speed
        return -3.0 * np.sign(state[0])

    return law


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "rest_m", "step"),
    [
        (on_one_side, -2 / 150, 2e-4),
        (on_one_side_without_the_edge, -2 / 150, STEP),
        (to_both_sides, 0.0, STEP),
        (beside_a_small_damper, 0.0, STEP),
    ],
)
def test_a_relay_without_a_spring_is_named(law, rest_m, step):
    found = diagnose(pressed(law, rest_m=rest_m, step=step), device=device_of(step))
    assert found.cause == "relay", found.conclusion
    assert found.law.switch.force_n == pytest.approx(2.5, rel=0.01)
    # A step that is a tenth of the swing hides when the force turns.
    assert found.data()["measured"]["delay_samples"] == pytest.approx(1.0, abs=0.1 if step < 1e-4 else 0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("force_noise_n", "noise_m"), [(0.1, 0.0), (0.0, 2e-5)])
def test_noise_of_the_force_or_of_the_position_leaves_a_relay_named(force_noise_n, noise_m):
    log = pressed(on_one_side, rest_m=-2 / 150, noise=noise_m)
    noise_n = force_noise_n * np.random.default_rng(1).standard_normal(log.force_n.size)
    found = diagnose(replace(log, force_n=log.force_n + noise_n), device=device_of(noise=noise_m))
    assert found.cause == "relay", found.conclusion
    assert found.law.damping_error_ns_per_m < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("keep", [0.0, 0.8])
def test_a_force_that_the_sign_of_the_speed_switches_late_is_named(keep):
    found = diagnose(pressed(against_the_speed(keep), delay=3), device=device_of())
    assert found.cause == "relay", found.conclusion
    assert found.law.switch.by == "speed"
    assert found.law.switch.keep == pytest.approx(keep, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "b", "delay", "cause"),
    [(0.0, 90.0, 4, "delay"), (0.0, 250.0, 1, "damping"), (4000.0, 0.0, 1, "stiffness"), (800.0, 0.0, 6, "delay")],
)
def test_a_spring_or_a_damper_alone_is_named_as_before(k, b, delay, cause):
    found = diagnose(pressed(lambda _, seen, speed: -k * seen - b * speed, delay=delay), device=device_of())
    assert found.cause == cause, found.conclusion


def test_a_damper_whose_force_is_of_one_step_at_a_time_is_its_law():
    """Each step of the encoder gives the largest force of the log, which a limit would give too."""
    log, _ = log_of(pressed(lambda _, __, speed: -10.0 * speed))
    law = find_law(log, find_oscillation(log, 20.0), 20.0, 0.0)
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((0.0, 10.0))


@pytest.mark.parametrize("step", [1e-5, 1e-4])
@pytest.mark.parametrize("seed", range(3))
def test_a_factor_of_0_has_a_finite_error_that_reaches_it(step, seed):
    """A rest that neither factor makes is none of an error of the positions, however large that would have to be."""
    random = np.random.default_rng(seed)
    position = step * np.round(1.4e-3 * np.sin(0.08 * np.arange(1, 2001)) / step)
    change = np.diff(position, prepend=0.0)
    force = 2.5 * np.sign(position) + 0.1 * random.standard_normal(position.size)
    fit = regress(force, position, change, [np.sign(position)], step**2 / 12)
    assert np.isfinite(fit.errors).all()
    assert fit.factors[:2].tolist() == [0.0, 0.0]
    # Least squares of the full columns lie within twice what is told: two standard deviations are 95 %.
    columns = np.stack([position, change, np.ones(position.size), np.sign(position)], axis=1)
    plain = np.linalg.lstsq(columns, force, rcond=None)[0][:2]
    assert (np.abs(plain) < 2 * fit.errors).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("noise_m", [0.3e-3, 0.5e-3, 0.7e-3])
def test_a_spring_that_noise_of_the_positions_makes_seem_softer_lies_within_its_error(noise_m, seed):
    """Noise of variance s^2 on a motion of variance S divides the factor by 1 + s^2/S, up to a half here."""
    motion = math.sqrt(2) * 1e-3 * np.sin(0.05 * np.arange(4000))
    readings = motion + noise_m * np.random.default_rng(seed).standard_normal(motion.size)
    fit = regress(-1000.0 * motion, readings, np.diff(readings, prepend=readings[0]), [], noise_m**2)
    assert fit.factors[0] == pytest.approx(-1000.0 / (1 + (noise_m / 1e-3) ** 2), rel=0.05)
    assert abs(fit.factors[0] + 1000.0) < fit.errors[0]


@pytest.mark.parametrize("half_band", [0.0, 0.4e-3])
def test_the_gain_of_a_switch_is_the_first_harmonic_of_its_force(half_band):
    amplitude, force = 1e-3, 2.5

    def harmonic(turn):
        seen = amplitude * math.sin(turn)
        return force * math.copysign(1.0, seen) * (abs(seen) > half_band) * math.sin(turn) / math.pi

    rise = math.asin(half_band / amplitude)
    edges = [rise, math.pi - rise, math.pi, math.pi + rise, 2 * math.pi - rise]
    whole = quad(harmonic, 0.0, 2 * math.pi, points=edges)[0] / amplitude
    switch = Switch(-force, "position", (1e-3 - half_band, 1e-3 + half_band))
    assert switch.gain_n_per_m(amplitude) == pytest.approx(whole, rel=1e-6)
    assert switch.gain_n_per_m(0.9 * half_band) == 0.0
