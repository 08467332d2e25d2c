"""numpy, 50-digit mpmath and CasADi evaluate the same equations to 1e-12, over eight decades of each parameter."""

import casadi as ca
import numpy as np
import pytest
from quick import first
from reference_optimum import mpmath_numbers

from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import (
    SampleAngle,
    backward_difference,
    coupling_gains,
    coupling_impedance,
    hold,
    loop_at,
    tustin,
)
from avc_casadi.paper.numbers import NUMPY, ComplexExpr, casadi_numbers

DIGITS = mpmath_numbers(50)
NUMBERS_MP = DIGITS.complex(0, 0).context
AGREE = 1e-12
SLOW, NEAR_NYQUIST = (0.01, 1e-4), (0.999 * 500.0, 1e-3)


def drawn(rng, model, delay):
    """A problem with all parameters over eight decades, and gains as wide."""

    def decades():
        return float(10 ** rng.uniform(-4, 4))

    frequency, sample_time = [SLOW, NEAR_NYQUIST, (float(10 ** rng.uniform(-2, 2.69)), 1e-3)][rng.integers(3)]
    b, k = decades(), 1e3 * decades()
    share = float(rng.uniform(0.1, 1.0))
    problem = Problem.model_validate(
        {
            "device": {
                "mass_kg": decades(),
                "damping_ns_per_m": decades(),
                "sample_time_s": sample_time,
                "delay_samples": delay,
            },
            "environment": {"damping_ns_per_m": b, "stiffness_n_per_m": k},
            "boundaries": {
                "upper": {"damping_ns_per_m": 1.1 * b, "stiffness_n_per_m": 1.1 * k},
                "lower": {"damping_ns_per_m": share * b, "stiffness_n_per_m": share * k},
            },
            "stability": {"model": model},
        }
    )
    return problem, frequency, (decades(), 1e3 * decades(), decades())


def values(problem, frequency, gains, numbers):
    """Every complex quantity of the loop."""
    loop = loop_at(problem, frequency, numbers)
    coupling = coupling_impedance(loop.angle, gains[0], gains[1])
    rendered = loop.rendered(gains[0], gains[1])
    return {
        "s_t": tustin(loop.angle),
        "s_b": backward_difference(loop.angle),
        "Z_d": loop.device,
        "H": loop.hold,
        "Z_e": loop.environment,
        "Z_ds": loop.desired,
        "Z_e - Z_ds": loop.desired_gap,
        "Z_avc": coupling,
        "Z_eavc": rendered,
        "Z_h_ds": loop.target,
        "Z_h": loop.without_coupling,
        "Z_h_avc": loop.perceived(*gains),
    }


def terms(loop, gains):
    """Sizes against which a sum of terms of either sign can be accurate."""
    size = {"Z_h_ds": loop.desired, "Z_h": loop.environment, "Z_h_avc": loop.rendered(*gains[:2]) + gains[2]}
    return {name: abs(loop.device) + abs(loop.hold * value) for name, value in size.items()}


def casadi_values(problem, frequency, gains):
    symbols = ca.SX.sym("x", 4)
    parts = values(problem, symbols[0], (symbols[1], symbols[2], symbols[3]), casadi_numbers())
    outputs = [part for value in parts.values() for part in (ComplexExpr.of(value).real, ComplexExpr.of(value).imag)]
    numbers = ca.Function("all", [symbols], [ca.vertcat(*outputs)])([frequency, *gains])
    pairs = np.array(numbers).reshape(-1, 2)
    return {name: NUMBERS_MP.mpc(*map(float, pair)) for name, pair in zip(parts, pairs, strict=True)}


@pytest.mark.parametrize("model", first(["paper", "sampled-data"]))
@pytest.mark.parametrize("delay", first([0, 1, 20]))
def test_every_quantity_agrees(model, delay):
    rng = np.random.default_rng(delay + 100 * (model == "paper"))
    for _ in range(40):
        problem, frequency, gains = drawn(rng, model, delay)
        exact_gains = tuple(NUMBERS_MP.mpf(gain) for gain in gains)
        truth = values(problem, NUMBERS_MP.mpf(frequency), exact_gains, DIGITS)
        sizes = terms(loop_at(problem, NUMBERS_MP.mpf(frequency), DIGITS), exact_gains)
        in_numpy = values(problem, frequency, gains, NUMPY)
        in_casadi = casadi_values(problem, frequency, gains)
        for name, value in truth.items():
            allowed = AGREE * sizes.get(name, abs(value))
            assert abs(NUMBERS_MP.mpc(complex(in_numpy[name])) - value) <= allowed, (name, "numpy", problem, frequency)
            assert abs(in_casadi[name] - value) <= allowed, (name, "casadi", problem, frequency)


def z_of(frequency, sample_time):
    return NUMBERS_MP.exp(2j * NUMBERS_MP.pi * NUMBERS_MP.mpf(frequency) * NUMBERS_MP.mpf(sample_time))


@pytest.mark.parametrize(("frequency", "sample_time"), [SLOW, NEAR_NYQUIST, (7.3, 1e-3), (120.0, 2e-3)])
def test_half_angle_forms_are_the_definitions_in_z(frequency, sample_time):
    """Against z = exp(j omega T), written plainly with 50 digits."""
    z, t = z_of(frequency, sample_time), NUMBERS_MP.mpf(sample_time)
    angle = SampleAngle.at(DIGITS, NUMBERS_MP.mpf(frequency), t)
    half = NUMBERS_MP.mpf(1) / 2
    expected = [
        (tustin(angle), 2 * (z - 1) / (t * (z + 1))),
        (backward_difference(angle), (z - 1) / (t * z)),
        (hold(angle, "paper", 0), (z + 1) / (2 * z)),
        (hold(angle, "paper", 3), (z + 1) / (2 * z) * z**-3),
        (hold(angle, "sampled-data", 0), 1 / z),
        (hold(angle, "sampled-data", 2), z**-3),
        (coupling_impedance(angle, 5, 300), 5 + 300 * t * z / (z - 1)),
        (coupling_impedance(angle, half, 0), NUMBERS_MP.mpc(half)),
    ]
    for value, definition in expected:
        assert abs(value - definition) <= NUMBERS_MP.mpf(10) ** -40 * abs(definition)


@pytest.mark.parametrize("numbers", [NUMPY, DIGITS, casadi_numbers()], ids=["numpy", "mpmath", "casadi"])
def test_gains_come_back_from_the_impedance(numbers):
    """(17) inverts (7)."""
    angle = SampleAngle.at(numbers, numbers.number(3.0), numbers.number(1e-3))
    b, k = coupling_gains(angle, coupling_impedance(angle, numbers.number(12.5), numbers.number(4.0e4)))
    assert float(k) == pytest.approx(4.0e4, rel=1e-14)
    assert float(b) == pytest.approx(12.5, rel=1e-13)
