"""Weights by information beat even ones, judged by a simulator that shares no code with the project."""

import dataclasses

import numpy as np
import pytest
from hardware_bench import require
from measured_device import Truth, measured
from scipy.signal import butter, lfilter

from avc_casadi.identification.excitation.design import plan_excitation
from avc_casadi.identification.excitation.information import Centring, Room, best_power, information
from avc_casadi.identification.excitation.plan import forecast
from avc_casadi.identification.excitation.signal import FULL, Signal, crest_factor, low_crest_phases, schroeder_phases
from avc_casadi.model.device import Device

PERIOD = 1e-3
DEVICES = (
    {"mass_kg": 0.1, "damping_ns_per_m": 2.0, "coulomb_friction_n": 0.2, "delay_samples": 1},
    {"mass_kg": 0.05, "damping_ns_per_m": 0.5, "coulomb_friction_n": 0.0, "delay_samples": 2},
    {"mass_kg": 0.3, "damping_ns_per_m": 4.0, "coulomb_friction_n": 0.5, "delay_samples": 0.5},
)


def of(values):
    return Device(encoder_resolution_m=2e-5, max_force_n=8.0, **values)


def log_det(plan, device):
    """Log determinant of the information a parameter, by differences of simulated records without the slowest part."""
    wanted = plan.signal.units(plan.ticks) / FULL * plan.max_force_n
    fast = butter(2, 20 / np.pi * PERIOD, "high")
    at = {"mass": device.mass_kg, "damping": device.damping_ns_per_m, "delay": device.delay_samples}
    steps = {"mass": 1e-3 * device.mass_kg, "damping": 1e-3 * device.damping_ns_per_m, "delay": 0.02}
    units = {"mass": device.mass_kg, "damping": device.damping_ns_per_m, "delay": 1.0}
    if device.coulomb_friction_n:
        at["coulomb"] = units["coulomb"] = device.coulomb_friction_n
        steps["coulomb"] = 1e-3 * device.coulomb_friction_n

    def record(**values):
        truth = Truth(
            **(at | values), encoder=1e-12, period=PERIOD, spring=plan.spring_n_per_m, damper=plan.damper_ns_per_m
        )
        return lfilter(*fast, measured(truth, wanted, np.random.default_rng(0))[1])

    slopes = np.array(
        [
            (record(**{key: at[key] + step}) - record(**{key: at[key] - step})) / (2 * step) * units[key]
            for key, step in steps.items()
        ]
    )
    return np.linalg.slogdet(slopes @ slopes.T * 12 / plan.metres_per_count**2)[1] / len(slopes)


def flat(plan):
    """The same tones, equally strong, with phases as carefully chosen, at the same peak force."""
    frequency = np.array(plan.signal.step) / 2**32 / PERIOD
    phase = low_crest_phases(frequency, np.ones(frequency.size), np.arange(4000) * PERIOD)
    made = Signal.of(frequency, np.full(frequency.size, 0.02), phase, PERIOD)
    return at_peak(plan, made, peak(plan))


def at_peak(plan, signal, wanted):
    by = wanted / peak(dataclasses.replace(plan, signal=signal))
    return dataclasses.replace(
        plan, signal=dataclasses.replace(signal, amplitude=tuple(round(by * one) for one in signal.amplitude))
    )


def peak(plan):
    return np.abs(plan.signal.units(plan.ticks)).max()


@pytest.mark.thorough
@pytest.mark.parametrize("values", DEVICES[::2], ids=lambda values: f"{values['mass_kg']} kg")
def test_same_peak_force_tells_more(values):
    require("gcc")
    device = of(values)
    plan = plan_excitation(device, seconds=4.0, force_n=2.0, speed_m_per_s=5.0, travel_m=0.5).plan
    even = flat(plan)
    assert peak(even) == pytest.approx(peak(plan), rel=0.01)
    assert log_det(plan, device) > log_det(even, device) + 0.5


@pytest.mark.thorough
@pytest.mark.parametrize("values", DEVICES[:2], ids=lambda values: f"{values['mass_kg']} kg")
def test_within_the_same_speed_and_travel_it_tells_more(values):
    require("gcc")
    device = of(values)
    made = plan_excitation(device, seconds=4.0)
    plan, even = made.plan, flat(made.plan)
    loud = forecast(even, [device])
    over = max(loud.speed_m_per_s.max() / plan.max_speed_m_per_s, loud.travel_m.max() / plan.max_travel_m)
    assert over > 1  # at the same peak force it would break a limit
    kept = at_peak(plan, even.signal, 0.95 * peak(even) / over)
    reached = forecast(kept, [device])
    assert reached.speed_m_per_s.max() <= plan.max_speed_m_per_s
    assert log_det(plan, device) > log_det(kept, device)


def test_no_power_within_the_room_tells_more():
    """Without friction the criterion is concave: towards no other power that the limits allow does it rise."""
    device, centring = of(DEVICES[1]), Centring(5.0, 0.5)
    frequency = np.geomspace(0.5, 200.0, 40)
    room = Room(1.0, 0.1, 0.01)
    best = best_power([device], frequency, centring, room, 4000)
    s = 2j * np.pi * frequency
    hold = np.sinc(frequency * PERIOD) * np.exp(-s * PERIOD * 2.5)
    alone = 1 / (0.05 * s**2 + 0.5 * s)
    moves = np.abs(hold * alone / (1 + (5.0 + 0.5 * s) * hold * alone))
    limits = np.array([np.ones(40), moves**2 / 0.01**2, (moves * np.abs(s)) ** 2 / 0.1**2])
    most = 1 / limits.max(axis=0)
    floor = 0.25 / (limits * most).sum(axis=1).max() * most
    assert (limits @ best).max() == pytest.approx(1.0, abs=2e-3)
    assert best.max() <= 0.1 * best.sum() * (1 + 1e-3)
    assert np.all(best >= floor * (1 - 1e-3))

    def value(power):
        return np.linalg.slogdet(information(device, frequency, power, centring, 4000))[1]

    random = np.random.default_rng(0)
    reached, tried = value(best), 0
    for _ in range(400):
        other = most * np.exp(random.choice([0.2, 1.0]) * random.standard_normal(40))
        other = np.maximum(other / (limits @ other).max(), floor)
        other = (other - floor) * 0.9 + floor
        if (limits @ other).max() <= 1 and other.max() <= 0.1 * other.sum():
            tried += 1
            assert all(value(best + share * (other - best)) <= reached + 1e-4 for share in (0.01, 0.1, 1.0))
    assert tried > 50


def test_phases_are_better_than_those_of_schroeder_and_of_chance():
    frequency, time = np.unique(np.round(np.geomspace(2, 1200, 48))) / 4, np.arange(4000) * PERIOD
    power = np.linspace(1.0, 3.0, frequency.size)

    def crest(phase):
        return crest_factor(np.sin(np.outer(time, 2 * np.pi * frequency) + phase) @ np.sqrt(power))

    random = np.random.default_rng(1)
    chance = min(crest(random.uniform(0, 2 * np.pi, frequency.size)) for _ in range(100))
    assert crest(low_crest_phases(frequency, power, time)) < min(chance, crest(schroeder_phases(power))) - 0.2
