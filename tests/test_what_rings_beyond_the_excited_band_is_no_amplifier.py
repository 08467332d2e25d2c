"""A resonance that the force does not excite looks like an amplifier's lag: neither is told, and the delay holds."""

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.identification.identify import identify
from avc_casadi.identification.record import Record


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("seed", "resonance", "share", "friction"), [(1, 250.0, 0.2, 0.1), (2, 180.0, 0.3, 0.05), (3, 180.0, 0.3, 0.0)]
)
def test_a_delay_is_not_taken_apart(seed, resonance, share, friction):
    # Told as an amplifier of 190 to 370 Hz, the delay was missed by 0.4 to 0.8 samples.
    truth = Truth(
        mass=0.06,
        damping=0.3,
        coulomb=friction,
        delay=1.5,
        encoder=1e-6,
        spring=30.0,
        resonance=resonance,
        ratio=0.03,
        share=share,
    )
    random = np.random.default_rng(seed)
    wanted = multisine(random, 10.0, truth.period, 0.5, 80.0, 1.0)
    _, position, force = measured(truth, wanted, random)
    found = identify([Record("log", truth.period, position, force)])
    assert "amplifier" not in found.terms
    for key, value in {"delay_samples": 1.5, "mass_kg": 0.06, "damping_ns_per_m": 0.3}.items():
        assert found.estimates[key].low <= value <= found.estimates[key].high
    assert found.estimates["delay_samples"].value == pytest.approx(1.5, abs=0.02)


@pytest.mark.thorough
def test_an_amplifier_is_told_where_the_force_reaches_it():
    truth = Truth(mass=0.06, damping=0.3, coulomb=0.1, delay=1.5, encoder=2e-6, spring=30.0, bandwidth=250.0)
    random = np.random.default_rng(4)
    wanted = multisine(random, 10.0, truth.period, 0.5, 300.0, 1.0)
    _, position, force = measured(truth, wanted, random)
    found = identify([Record("log", truth.period, position, force)])
    assert found.estimates["amplifier_bandwidth_hz"].value == pytest.approx(250.0, rel=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize(("friction", "told"), [(0.02, False), (0.05, True)])
def test_friction_tells_them_apart(friction, told):
    # Without friction a resonance does as well; the model stayed without both, and damping was up to 4 per cent off.
    truth = Truth(
        mass=0.3,
        damping=1.0,
        coulomb=friction,
        delay=3.0,
        bandwidth=240.0,
        encoder=1e-6,
        spring=47.0,
        period=5e-4,
    )
    random = np.random.default_rng(12)
    wanted = multisine(random, 10.0, truth.period, 1.0, 120.0, 4.0)
    _, position, force = measured(truth, wanted, random)
    found = identify([Record("log", truth.period, position, force)])
    assert ("amplifier" in found.terms) == told
    true = {"mass_kg": 0.3, "damping_ns_per_m": 1.0, "delay_samples": 3.0}
    true |= {"coulomb_friction_n": friction, "amplifier_bandwidth_hz": 240.0} if told else {}
    # Where they are not told, the intervals end at what the better of them found.
    slack = 1.0 if told else 1.0 + 1e-4
    for key, value in true.items():
        assert found.estimates[key].low / slack <= value <= found.estimates[key].high * slack
        assert not told or found.estimates[key].value == pytest.approx(value, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "bandwidth", "resonance"), [(5, 300.0, 140.0), (6, 0.0, 120.0)])
def test_what_it_would_change_is_not_known_better_than_that(seed, bandwidth, resonance):
    # Seen behind it, the mass comes out 4 to 6 per cent too small: a log of up to 80 Hz does not show where it rings.
    truth = Truth(
        mass=0.08,
        damping=0.8,
        coulomb=0.25,
        delay=0.6,
        bandwidth=bandwidth,
        encoder=1e-5,
        spring=30.0,
        resonance=resonance,
        ratio=0.015,
        share=0.35,
        at_handle=1.0,
    )
    random = np.random.default_rng(seed)
    wanted = multisine(random, 20.0, truth.period, 0.5, 80.0, 2.0)
    _, position, force = measured(truth, wanted, random)
    found = identify([Record("log", truth.period, position, force)])
    lag = 1 / (2 * np.pi * bandwidth * truth.period) if bandwidth else 0.0
    for key, value in {"mass_kg": 0.08, "delay_samples": 0.6 + lag, "damping_ns_per_m": 0.8}.items():
        assert found.estimates[key].low <= value <= found.estimates[key].high
    assert any("bears one out beyond what it excites" in one.why for one in found.refused)


@pytest.mark.thorough
def test_what_rings_far_beyond_the_excited_band_leaves_no_interval_wide():
    """Ticks that jitter by 20 us look like a mode at many times the sample rate, of which nothing at all is told."""
    truth = Truth(mass=0.15, damping=1.0, coulomb=0.2, delay=0.7, encoder=0.0, spring=300.0, damper=2.0)
    random = np.random.default_rng(1)
    wanted = multisine(random, 12.0, truth.period, 0.5, 40.0, 3.0)
    _, position, force = measured(truth, wanted, random)
    late = 2e-5 * random.standard_normal(position.size) + 1e-5 * np.abs(position) / np.abs(position).max()
    position = position + np.gradient(position, truth.period) * late
    found = identify([Record("log", truth.period, 2e-5 * np.round(position / 2e-5), force)])
    mass, friction = (found.estimates[key] for key in ("mass_kg", "coulomb_friction_n"))
    assert mass.value == pytest.approx(0.15, rel=1e-4)
    # It was 1e-5 to 1e5 kg.
    assert mass.high - mass.low < 1e-3 * 0.15
    assert friction.low <= 0.2 <= friction.high
