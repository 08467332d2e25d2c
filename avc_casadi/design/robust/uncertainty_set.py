"""Uncertainty set of a robust design: every hand, released, and perturbed devices."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.passivity.rendered_impedance import Handle, below_quarter_rate
from avc_casadi.design.robust.goal import (
    BAND_HZ,
    DECAY_PER_S,
    RANGED_DECAY_PER_S,
    VARIED_DECAY_PER_S,
    largest_by_speed,
)
from avc_casadi.design.robust.lqg import dead_zone_m
from avc_casadi.loops.loop import Body
from avc_casadi.loops.spectrum import eigenvalues, largest_radius
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES, Laws, Rendering, frozen_rendering, observed_wall
from avc_casadi.model.corners import LINEAR_KEYS, device_set, device_with
from avc_casadi.model.gains import Gains, spring_before
from avc_casadi.model.hands import FINGERTIP, Hand, hand_corners, no_hand, stylus_corners
from avc_casadi.model.problem import Hands
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi.loops.wall import Rendering
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback


# Assumed model mismatch where no range is declared: mass, resonance, delay in samples.
_MASS, _RESONANCE, _DELAY_SAMPLES = (0.9, 1.1), (0.9, 1.1), 0.25
# Number of loops kept of other devices, the worst ones with the initial law.
_KEPT = 28
# The same for each kind of other hands, and at each sector gain for the nominal device.
_KEPT_BESIDE, _KEPT_NOMINAL = 4, 2
# Devices within the declared ranges, beside their corners.
_DRAWS = 24
# From the frequencies felt as stiffness to the end of the band.
_SLOW_HZ, _FAST_HZ, _SLOW, _FAST = 0.2, 20.0, 40, 120


@dataclass(frozen=True)
class Loops:
    """Plants in contact.

    Attributes:
        nominal: the nominal device with every corner of the hands and the middle one.
        beside: the nominal device with stylus grips, and with fingertips.
        varied: the hands with perturbed devices.
        ranged: the hands with devices within the declared ranges; None without ranges.
        free: the released device, at every declared corner and within.
        frequency_hz: of evaluation, shape (f,).
        response: measured position over force, nominal, shape (hands, f), m/N.
        sample_time_s: T.
        metres_per_unit: hand displacement for a unit of the position.
        dead_zone_m: half width of the dead zone of the innovation.
        handle: of the nominal device, over the band of the hand.
    """

    nominal: Body
    beside: tuple[Body, ...]
    varied: Body
    ranged: Body | None
    free: Body
    frequency_hz: FloatArray
    response: ComplexArray
    sample_time_s: float
    metres_per_unit: float
    dead_zone_m: float
    handle: Handle

    @classmethod
    def of(cls, problem: Problem) -> Loops:
        """Return the loops of a device as declared, with its ranges, and the hands."""
        device, hands = problem.device, problem.hands
        t = device.sample_time_s
        held = _with_middle(hands)
        nominal = Body.of(sampled_plant(device, held)).flat()
        beside = tuple(
            Body.of(sampled_plant(device, one.at_handle(device.metres_per_unit))).flat()
            for one in (stylus_corners(), hand_corners(FINGERTIP))
        )
        declared = _declared(device)
        varied = Body.of(sampled_plant([*declared, *assumed_devices(device)], held)).flat()
        ranged = Body.of(sampled_plant(declared, held)).flat() if len(declared) > 1 else None
        free = Body.of(sampled_plant(declared, no_hand())).flat()
        fast = np.geomspace(1.05 * _FAST_HZ, 0.499 / t, _FAST) if 0.4 / t > _FAST_HZ else np.zeros(0)
        slow = np.geomspace(_SLOW_HZ, min(_FAST_HZ, 0.45 / t), _SLOW)
        frequency = np.concatenate([slow, fast])
        z = np.exp(2j * np.pi * frequency * t)
        pencil = z[None, :, None, None] * np.eye(nominal.size) - nominal.a[:, None]
        response = np.linalg.solve(pencil, np.broadcast_to(nominal.b[:, None, :, None], (*pencil.shape[:3], 1)))
        seen = (response[..., 0] @ nominal.measured).astype(np.complex128)
        handle = Handle.of(problem, below_quarter_rate(device, BAND_HZ))
        dead_zone = dead_zone_m(device)
        return cls(nominal, beside, varied, ranged, free, frequency, seen, t, device.metres_per_unit, dead_zone, handle)

    def hardest(self, law: StateFeedback, rendering: Rendering) -> Loops:
        """Return the critical loops, of most missing decay with a law; similar laws have the same ones."""
        t = self.sample_time_s
        beside = tuple(_worst(plants, law, rendering, {1.0: 0.0}, t, _KEPT_BESIDE) for plants in self.beside)
        varied = _worst(self.varied, law, rendering, VARIED_DECAY_PER_S, t, _KEPT)
        ranged = self.ranged
        if ranged is not None:
            ranged = _worst(ranged, law, rendering, RANGED_DECAY_PER_S, t, _KEPT)
        nominal = _slowest(self.nominal, law, rendering, t)
        return replace(self, nominal=nominal, varied=varied, ranged=ranged, beside=beside)

    def and_of(self, others: Loops) -> Loops:
        """Return the union with other loops kept of the same set."""
        pairs = zip(self.beside, others.beside, strict=True)
        return replace(
            self,
            nominal=_together(self.nominal, others.nominal),
            varied=_together(self.varied, others.varied),
            ranged=None if self.ranged is None or others.ranged is None else _together(self.ranged, others.ranged),
            beside=tuple(_together(*pair) for pair in pairs),
        )


def _together(plants: Body, others: Body) -> Body:
    """Return the union of plants, all with the same measured output."""
    a, b = np.concatenate([plants.a, others.a]), np.concatenate([plants.b, others.b])
    _, first = np.unique(a.reshape(len(a), -1), axis=0, return_index=True)
    return replace(plants, a=a, b=b).axes(np.sort(first))


def _worst(
    plants: Body, law: StateFeedback, rendering: Rendering, decay_per_s: dict[float, float], t: float, kept: int
) -> Body:
    if len(plants.a) <= kept:
        return plants
    radius = largest_radius(observed_wall(plants, Laws.of(law), rendering, tuple(decay_per_s))[0])
    missing = (np.log(radius) / t + np.array(list(decay_per_s.values()))[:, None]).max(axis=0)
    worst = np.sort(np.argsort(-missing, kind="stable")[:kept])
    return plants.axes(worst)


def _slowest(plants: Body, law: StateFeedback, rendering: Rendering, t: float) -> Body:
    """Return the plants whose fast or slow poles decay most slowly at some sector gain."""
    every = eigenvalues(observed_wall(plants, Laws.of(law), rendering, tuple(DECAY_PER_S))[0])
    kept = np.zeros(len(plants.a), dtype=np.bool_)
    for largest in largest_by_speed(every, t):
        kept[np.argsort(-largest, axis=-1, kind="stable")[:, :_KEPT_NOMINAL]] = True
    return plants.axes(kept)


def assumed_devices(device: Device) -> list[Device]:
    """Return the device and its perturbed variants, for values without a declared range.

    Variants beyond the admissible values of a device are left out.
    """
    known = device.range
    masses: tuple[float, ...] = (1.0,) if known.mass_kg is not None else _MASS
    modes: tuple[float, ...] = (1.0,)
    if device.resonance is not None and (known.resonance is None or known.resonance.frequency_hz is None):
        modes = _RESONANCE
    late = (0.0,) if known.delay_samples is not None else (0.0, _DELAY_SAMPLES)
    assumed = []
    for mass, mode, delay in product(masses, modes, late):
        values = {"mass_kg": device.mass_kg * mass, "delay_samples": device.delay_samples + delay}
        if device.resonance is not None:
            values["resonance.frequency_hz"] = device.resonance.frequency_hz * mode
        with suppress(ValueError):
            assumed.append(device_with(device, values))
    return assumed


def _declared(device: Device) -> list[Device]:
    """Return devices throughout the declared ranges; interior ones differ from those of a certificate."""
    return device_set(device, LINEAR_KEYS, draws=_DRAWS, seed=1)


def _with_middle(hands: Hands) -> Hand:
    """Return the corners of the hands and the middle one: geometric mean, arithmetic for the stiffness."""
    corners = hand_corners(Hands(**{**vars(hands), "let_go": False}))
    (m0, m1), (b0, b1), (k0, k1) = hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m
    middle = ((m0 * m1) ** 0.5, (b0 * b1) ** 0.5, (k0 + k1) / 2)
    return Hand(*(np.append(value, one) for value, one in zip(vars(corners).values(), middle, strict=True)))


def why_no_law(problem: Problem) -> str:
    """Return why a device and wall have no law; empty where they may have one."""
    device = problem.device
    faults = []
    if not problem.environment.stiffness_n_per_m > 0:
        faults.append("the wall has no stiffness to be rendered (environment.stiffness_n_per_m)")
    if not device.mass_kg > 0:
        faults.append("the device has no mass (device.mass_kg), so that nothing is there when it is released")
    if device.delay_samples > MAX_DELAY_SAMPLES / 4:
        faults.append(f"the delay of {device.delay_samples:g} samples is above {MAX_DELAY_SAMPLES // 4}")
    return "; ".join(faults)


def softened(problem: Problem, stiffness_n_per_m: float) -> tuple[Gains, Rendering]:
    """Return the spring in series that gives the wall a static stiffness, and both as rendered."""
    gains = Gains(0.0, spring_before(problem, stiffness_n_per_m))
    return gains, frozen_rendering(problem, 0.0, gains.stiffness_n_per_m)
