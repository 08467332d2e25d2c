"""Pieces of a law beside SciPy's transfer functions and 30-digit numbers, at frequencies that are drawn."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from avc_casadi.model import law_pieces as pieces

PERIODS_S = st.floats(1e-4, 1e-2)
SHARES = st.floats(1e-3, 0.49)
"""Frequencies as a share of the sample rate."""
GAINS = st.floats(1e-3, 1e4) | st.floats(-1e4, -1e-3)


def ratio(numerator, denominator, z):
    """SciPy's value of polynomials in 1/z."""
    return signal.freqz(numerator, denominator, worN=[np.angle(z)])[1][0]


def same(law, z, expected):
    assert complex(law.transfer(np.array(z))) == pytest.approx(complex(expected), rel=1e-9)


def at(share):
    return np.exp(2j * np.pi * share)


@settings(max_examples=20)
@given(PERIODS_S, SHARES, GAINS, st.integers(1, 40))
def test_forces_are_their_formulas(period, share, gain, samples):
    z = at(share)
    window = pieces.Window(samples)
    ends = [1.0, *[0.0] * (samples - 1), -1.0]
    slope = ratio(ends, [samples * period], z)
    size = abs(gain)
    same(pieces.Spring(size).law(period), z, size)
    same(pieces.Damper(gain).law(period), z, gain * ratio([1, -1], [period], z))
    same(pieces.Integral(size).law(period), z, size * ratio([period], [1, -1], z))
    sum_of_window = complex(pieces.Damper(gain, window).law(period).transfer(np.array(z)))
    assert sum_of_window == pytest.approx(gain * slope, rel=1e-9, abs=1e-9 * abs(gain) / (samples * period))
    mass = complex(pieces.VirtualMass(gain, window).law(period).transfer(np.array(z)))
    largest = abs(gain) / (samples * period**2)
    assert mass == pytest.approx(gain * slope * ratio([1, -1], [period], z), rel=1e-9, abs=1e-9 * largest)


@settings(max_examples=20)
@given(PERIODS_S, SHARES, st.floats(1e-3, 0.45))
def test_low_passes_have_the_poles_of_their_continuous_ones(period, share, cutoff):
    z = at(share)
    mpmath.mp.dps = 30
    turn = 2 * mpmath.pi * mpmath.mpf(cutoff)
    for order, poles in ((1, [-1]), (2, [mpmath.expjpi(0.75), mpmath.expjpi(-0.75)])):
        expected = mpmath.mpf(1)
        for pole in poles:
            there = mpmath.exp(turn * pole)
            expected *= (1 - there) / (1 - there / mpmath.mpmathify(complex(z)))
        same(pieces.LowPass(cutoff / period, order).law(period), z, expected)
        velocity = pieces.SmoothedDifference(cutoff / period, order)
        same(velocity.growth(period), z, expected * (1 - 1 / mpmath.mpmathify(complex(z))))


@settings(max_examples=20)
@given(PERIODS_S, SHARES, st.floats(1e-2, 0.45), st.floats(0.01, 0.99), st.floats(0.05, 2.0))
def test_a_notch_is_tustins_prewarped_at_its_frequency(period, share, frequency, depth, width):
    z = at(share)
    warped = 2 / period * np.tan(np.pi * frequency)
    above, below = ([1, 2 * by * width * warped, warped**2] for by in (depth, 1.0))
    notch = pieces.Notch(frequency / period, depth, width).law(period)
    value = complex(notch.transfer(np.array(z)))
    assert value == pytest.approx(ratio(*signal.bilinear(above, below, 1 / period), z), rel=1e-9, abs=1e-9)
    same(notch, at(frequency), depth)


@settings(max_examples=20)
@given(PERIODS_S, st.floats(1e-2, 0.45), st.floats(1.0, 80.0))
def test_a_lead_has_its_phase_at_its_frequency_and_keeps_what_rests(period, frequency, phase):
    lead = pieces.Lead(frequency / period, phase).law(period)
    assert np.degrees(np.angle(lead.transfer(np.array(at(frequency))))) == pytest.approx(phase, rel=1e-9)
    same(lead, 1.0 + 0j, 1.0)


@settings(max_examples=20)
@given(
    st.lists(st.floats(-1, 1), min_size=1, max_size=4),
    st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=5),
    SHARES,
    st.floats(0.1, 10),
)
def test_a_transfer_function_is_its_polynomials(numerator, poles, share, leading):
    z = at(share)
    denominator = leading * np.poly(poles)
    law = pieces.Transfer(tuple(numerator), tuple(denominator.tolist())).law(1e-3)
    expected = np.polyval(numerator, z) / np.polyval(denominator, z)
    scale = np.abs(numerator).sum() / abs(np.polyval(denominator, z))
    assert complex(law.transfer(np.array(z))) == pytest.approx(complex(expected), rel=1e-9, abs=1e-9 * scale)


@settings(max_examples=20)
@given(PERIODS_S, SHARES)
def test_forces_add_and_filters_follow(period, share):
    z = at(share)
    forces = (pieces.Spring(300.0), pieces.Damper(2.0), pieces.Integral(900.0), pieces.VirtualMass(-1e-3))
    filters = (pieces.Notch(0.1 / period, 0.1, 0.5), pieces.LowPass(0.2 / period), pieces.Lead(0.1 / period, 30.0))
    summed = sum(complex(force.law(period).transfer(np.array(z))) for force in forces)
    expected = summed * np.prod([complex(item.law(period).transfer(np.array(z))) for item in filters])
    same(pieces.compiled(forces, filters, period), z, expected)
    same(pieces.compiled((), filters, period), z, 0.0)
