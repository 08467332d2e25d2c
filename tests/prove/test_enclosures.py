"""What a proof of rest stands on: enclosures contain the exact values, and the law is that of the loop."""

import math

import mpmath as mp
import numpy as np
import pytest
from hardware_bench import believer
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

import avc_casadi as avc
from avc_casadi.claims.prove.disc import Disc, Moving, hold, rotation
from avc_casadi.claims.prove.held_device import HAND, SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.multiplier import verify
from avc_casadi.claims.prove.rest import prove_rest
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed, frozen_law
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import sampled_plant

BOX = {"mass_kg": (0.05, 0.3), "damping_ns_per_m": (3.0, 20.0), "stiffness_n_per_m": (200.0, 800.0)}
DEVICES = {
    "rigid": {},
    "late": {"delay_samples": 2},
    "later by a part": {"delay_samples": 0.7},
    "amplifier": {"amplifier_bandwidth_hz": 400.0},
    "current loop": {"amplifier_bandwidth_hz": 700.0, "amplifier_order": 2, "delay_samples": 1},
    "loop known to a range": {
        "amplifier_bandwidth_hz": 300.0,
        "amplifier_order": 2,
        "amplifier_damping_ratio": 0.5,
        "range": {"amplifier_bandwidth_hz": (280.0, 330.0), "amplifier_damping_ratio": (0.4, 0.8)},
    },
    "resonance": {"resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}},
    "handle": {
        "resonance": {"frequency_hz": 90.0, "damping_ratio": 0.1, "mass_ratio": 0.3},
        "encoder_at": "handle",
        "amplifier_bandwidth_hz": 1000.0,
        "delay_samples": 1.25,
    },
    "ranges": {
        "resonance": {"frequency_hz": 90.0, "damping_ratio": 0.1, "mass_ratio": 0.3},
        "delay_samples": 0.5,
        "range": {"mass_kg": (0.09, 0.12), "delay_samples": (0.2, 0.8), "resonance": {"frequency_hz": (80.0, 99.0)}},
    },
}
number = st.floats(-3, 3)
complexes = st.builds(complex, number, number)


def device_of(keys):
    return Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 2.0, **keys})


def sampled(device, hand, omega):
    """P by discretisation in the time domain."""
    plant = sampled_plant(device, Hand(*(np.array([value]) for value in hand)))
    matrix, push = (part[0, 0] for part in plant.with_forces_under_way())
    measured = np.zeros(len(push))
    measured[: len(plant.output_row)] = plant.output_row
    found = np.linalg.solve(np.exp(1j * omega) * np.eye(len(push)) - matrix, push)
    return -measured @ found


@given(complexes, complexes, st.floats(0, 1), st.floats(0, 1), st.floats(0, math.tau), st.floats(0, math.tau))
def test_discs_hold_what_their_points_make(one, other, r, s, here, there):
    a = Disc(np.array([one]), np.array([r]))
    b = Disc(np.array([other]), np.array([s]))
    x, y = one + r * np.exp(1j * here), other + s * np.exp(1j * there)
    for disc, value in ((a + b, x + y), (a - b, x - y), (a * b, x * y), (2.5 - a * 1.5, 2.5 - x * 1.5)):
        assert abs(disc.centre[0] - value) <= disc.radius[0] * (1 + 1e-12) + 1e-15
        assert abs(value) <= disc.largest[0] + 1e-15
        assert value.real >= disc.real_low[0] - 1e-15
    inverse = a.reciprocal()
    if np.isfinite(inverse.radius[0]):
        assert abs(inverse.centre[0] - 1 / x) <= inverse.radius[0] * (1 + 1e-9)
    else:
        assert r >= 0.89 * abs(one) or abs(one) < 1e-290  # the reciprocal of such a number may be no number


@given(st.floats(0, math.pi), st.floats(0, 0.3), st.floats(0, 1))
def test_turns_and_holds_are_enclosed_with_their_rates(low, width, share):
    angle = Moving.variable(0, np.array([low]), np.array([low + width]))
    x = mp.mpf(low) + mp.mpf(share) * (mp.mpf(low + width) - mp.mpf(low))
    with mp.workdps(40):
        j = mp.mpc(0, 1)

        def mean(v):
            return (1 - mp.exp(-j * v)) / (j * v) if v else mp.mpf(1)

        exact = {rotation: lambda v: mp.exp(-j * v), hold: mean}
        for function, truth in exact.items():
            found = function(angle)
            rate = mp.diff(truth, x + mp.mpf("1e-12"), h=mp.mpf("1e-10"))
            for disc, value in ((found.value, truth(x)), (found.slopes[0], rate)):
                assert abs(complex(disc.centre[0]) - value) <= disc.radius[0] + 1e-11


@pytest.mark.parametrize("name", first(DEVICES, 3))
def test_the_folded_spectrum_is_the_discretisation(name):
    """At points and over cells, with the terms that are left out."""
    device = device_of(DEVICES[name])
    found = SampledPlantBox(device, BOX)
    random = np.random.default_rng(3)
    ends = np.array(list(found.ranges.values()))
    for _ in range(12):
        centre = random.uniform(ends[:, 0], ends[:, 1])
        omega = random.uniform(0.0, np.pi)
        half = np.append(1.0, ends[:, 1] - ends[:, 0]) * 10.0 ** random.uniform(-6, -2.5)
        at = np.append(omega, centre)
        low, high = np.maximum(at - half, 0.0), np.minimum(at + half, np.append(np.pi, ends[:, 1]))
        cell = [Moving.variable(place, low[[place]], high[[place]]) for place in range(len(at))]
        above, below, around = found.over(cell[0], tuple(cell[1:]))
        enclosed = above * (1 / below) + around
        left = found.tail(high[[0]])[0]
        inside = random.uniform(low, high)
        numbers = dict(zip(found.names, inside[1:], strict=True))
        own = {key.removeprefix("device."): value for key, value in numbers.items() if key.startswith("device.")}
        exact = sampled(changed(device, own), [numbers[key] for key in HAND], inside[0])
        assert abs(enclosed.value.centre[0] - exact) <= enclosed.value.radius[0] + left
        assert abs(found.at(inside[:1], inside[None, 1:])[0, 0] - exact) <= left + 1e-12


@pytest.mark.parametrize("omega", [0.02, 0.5, 3.0])
@pytest.mark.parametrize("hand_damping", [3.0, 100.0, 1500.0])
def test_what_the_folded_spectrum_leaves_out_is_bounded_however_strongly_a_hand_damps(hand_damping, omega):
    """The whole spectrum by discretisation, less its first terms written out: Y = 1/(m s^2 + d s + k)."""
    device, hand = device_of({}), (0.05, hand_damping, 500.0)
    box = SampledPlantBox(device, {name: (value, value) for name, value in zip(HAND, hand, strict=True)})
    s = 1j * (omega + math.tau * np.arange(-box.terms, box.terms + 1)) / device.sample_time_s
    mass, damping = device.mass_kg + hand[0], device.damping_ns_per_m + hand_damping
    held = (1 - np.exp(-1j * omega)) / (s * device.sample_time_s)
    included = np.sum(held / (mass * s**2 + damping * s + hand[2]))
    left_out = abs(sampled(device, hand, omega) - included)
    assert 0 < left_out <= box.tail(np.array([omega]))[0]


def changed(device, values):
    whole = device.model_dump(exclude={"range"})
    for key, value in values.items():
        if key.startswith("resonance."):
            whole["resonance"][key.removeprefix("resonance.")] = value
        else:
            whole[key] = value
    return Device.model_validate(whole)


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_the_law_is_that_of_the_loop_in_contact(seed):
    """1 + P C1 - C2 vanishes at the eigenvalues of the loop that the scene and the certificate know."""
    random = np.random.default_rng(seed)
    device = device_of({"delay_samples": float(random.choice([0, 1, 0.4]))})
    wall = {"damping_ns_per_m": float(random.choice([0.0, 5.0])), "stiffness_n_per_m": random.uniform(1e3, 1e5)}
    problem = avc.load_problem("figure5").changed(device=device, environment=wall)
    gains = Gains(random.uniform(0, 50), random.uniform(1e3, 1e6), random.uniform(0, 90))
    observer = believer(int(random.integers(0, 100))) if random.random() < 0.5 else None
    law = ContactLaw.of(problem, *vars(gains).values(), observer)
    hand = Hand(*(np.array([value]) for value in (0.1, 6.0, 400.0)))
    frozen = frozen_law(problem, *vars(gains).values()).pick(0)
    plants = Body.of(sampled_plant(device, hand)).flat()
    values = np.linalg.eigvals(closed(plants, frozen.behind(observer)).maps[0])
    for value in values:
        if abs(value) < 0.3:
            continue
        above, force, below = (np.polyval([float(part) for part in one], value - 1) for one in law.transfer)
        plant = sampled(device, (0.1, 6.0, 400.0), -1j * np.log(value))
        terms = np.array([below, plant * above, -force])
        assert abs(terms.sum()) < 1e-5 * np.abs(terms).max()


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_poles_of_the_law_are_decided_exactly(share):
    """An observer whose slowest pole is put on either side of the unit circle."""
    observer = believer(3)
    matrix, gain = np.array(observer.state), np.array(observer.innovation)
    keep = np.eye(len(gain))
    keep[:, observer.measures] -= gain
    radius = np.abs(np.linalg.eigvals(keep @ matrix)).max()
    moved = tuple(tuple(row) for row in (matrix * share / radius).tolist())
    law = ContactLaw(1e-3, 0.0, 1e8, 0.0, 0.0, 5e3, type(observer)(**{**vars(observer), "state": moved}))
    assert law.stable == (share < 1)


def test_a_multiplier_that_fails_for_one_hand_of_the_box_is_found_out():
    """It holds for the middle of the box, which is not enough."""
    problem = avc.load_problem("figure5").changed(environment={"stiffness_n_per_m": 1e5, "damping_ns_per_m": 0.0})
    law = ContactLaw.of(problem, np.inf, np.inf, 98.0)
    middle = {name: (0.5 * (low + high),) * 2 for name, (low, high) in BOX.items()}
    found = prove_rest(law, "clip-last", problem.device, middle)
    assert found.outcome == "proved"
    result = verify(law, SampledPlantBox(problem.device, BOX), found.multiplier)
    assert not result.holds
    assert result.fails_at is not None
    omega, *hand = result.fails_at
    step = np.exp(1j * omega) - 1
    above, _, below = (np.polyval([float(part) for part in one], step) for one in law.transfer)
    loop = sampled(problem.device, hand, omega) * above / below
    assert (found.multiplier.at(omega) * (1 + loop)).real < 0
