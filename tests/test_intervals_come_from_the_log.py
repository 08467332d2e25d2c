"""Intervals are as wide as log and sample time make them: nothing is added to what a device without friction tells."""

from dataclasses import replace

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

from avc_casadi.identification.fit import Block, Fit
from avc_casadi.identification.model import Estimate
from avc_casadi.identification.predictor import Observer
from avc_casadi.identification.terms import Structure
from avc_casadi.identification.uncertainty import spread_of


def test_simulator_turns_without_losing_an_impulse():
    """A mass alone moves by the sums of its held forces, however often it turns: what a log's error is measured by."""
    truth = Truth(mass=0.1, damping=0.0, encoder=0.0, delay=0.3)
    random = np.random.default_rng(2)
    wanted = multisine(random, 2.0, truth.period, 5.0, 200.0, 1.0)
    _, position, force = measured(truth, wanted, random)
    late = np.concatenate([force[:1], force[:-1]])
    # The older force acts for the first 0.3 of a sample.
    speed = np.concatenate([[0.0], np.cumsum(0.3 * late + 0.7 * force)])[:-1] * truth.period / truth.mass
    moved = (late * 0.3 * (1 - 0.15) + force * 0.7 * 0.35) * truth.period**2 / truth.mass
    exact = np.concatenate([[0.0], np.cumsum(speed * truth.period + moved)])[:-1]
    assert np.sum(np.diff(np.sign(speed)) != 0) > 30
    assert position == pytest.approx(exact, abs=1e-6 * np.ptp(exact))


def made(period, **values):
    """A fit at some values whose blocks tell everything alike: what chance adds is known."""
    terms = ("base", "coulomb") + (("resonance",) if "resonance.frequency_hz" in values else ())
    units = {"coulomb_friction_n": 2.0, "breakaway_excess_n": 2.0, "damping_ns_per_m": 1.0, "offset_n": 2.0}
    structure = Structure(terms, {}, units)
    known = {"mass_kg": 0.1, "damping_ns_per_m": 2.0, "delay_samples": 1.0, "offset_n": 0.0, **values}
    free = len(structure.free)
    signs = np.tile([1.0, -1.0], 20)
    blocks = tuple(Block(0, 100, 100.0, 1e-9 * sign * np.ones(free), np.eye(free)) for sign in signs)
    return Fit(structure, structure.start(known), Observer(8.0), (), blocks, 1e-6, 1.0, 0.02, 0.0, period, False)


def widths(fit):
    return dict(zip((one.name for one in fit.structure.free), beyond_the_clock(fit), strict=True))


def beyond_the_clock(fit):
    """Half widths less what a clock of 10 ppm makes of each number: mass and frequencies are logarithms."""
    size = [1.0 if one.kind == "log" else abs(q) for one, q in zip(fit.structure.free, fit.search, strict=True)]
    return spread_of(fit, ()).half_width - 1e-5 * np.array(size)


def rigid_part(fit):
    return [width for name, width in widths(fit).items() if not name.startswith("resonance")]


MODE = {"resonance.frequency_hz": 150.0, "resonance.damping_ratio": 0.05, "resonance.mass_ratio": 0.4}


def test_nothing_is_added_without_friction_or_where_the_motor_never_turns():
    assert max(rigid_part(made(1e-3, coulomb_friction_n=0.0, **MODE))) < 1e-9
    assert max(rigid_part(replace(made(1e-3, coulomb_friction_n=1.0, **MODE), turning=0.0))) < 1e-9


def test_what_friction_leaves_out_of_a_sample_falls_with_the_square_of_its_time():
    slow, fast = (widths(made(period, coulomb_friction_n=1.0, **MODE)) for period in (1e-3, 1e-4))
    assert 50 < slow["mass_kg"] / fast["mass_kg"] < 101
    rigid = widths(made(1e-3, coulomb_friction_n=1.0))
    assert 0 < rigid["mass_kg"] < 0.05 * slow["mass_kg"]
    assert slow["delay_samples"] < 5e-3


def test_digits_show_the_interval_however_narrow():
    half = 10.0 ** np.random.default_rng(3).uniform(-9, 0, 200)
    for each in half:
        one = Estimate("mass_kg", "kg", 0.1, 0.1 - 0.1 * each, 0.1 + 0.1 * each, 0.95, "")
        low, high = (float(f"{end:.{one.digits(3, 4)}g}") for end in (one.low, one.high))
        assert low < 0.1 < high
        assert high - low == pytest.approx(one.high - one.low, rel=0.01)
