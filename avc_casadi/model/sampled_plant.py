"""The declared device in discrete time: motor, handle, hand and amplifier, discretised exactly."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.model.plant import DEVICE, GROUND, HANDLE, Mechanics, Plant, Transition, transitions

if TYPE_CHECKING:
    from avc_casadi.model.device import Device


@dataclass(frozen=True)
class Mode:
    """A resonance between motor and handle; its values may be arrays over hands."""

    frequency_hz: float | FloatArray
    damping_ratio: float | FloatArray
    mass_ratio: float


def device_plant(device: Device, hand: Mechanics | None = None, mode: Mode | None = None) -> Plant:
    """Return motor, handle and amplifier of a device, and the hand that holds it, as a continuous plant."""
    plant = Plant()
    plant.add_mass(DEVICE, device.mass_kg)
    plant.join(DEVICE, GROUND, 0.0, device.damping_ns_per_m)
    split = device.resonance if mode is None else mode
    if split is not None:
        plant.split(split.frequency_hz, split.damping_ratio, split.mass_ratio)
    if hand is not None:
        hand.mechanics(plant)
    if device.amplifier_bandwidth_hz is not None:
        plant.actuator_rate_per_s = 2 * math.pi * device.amplifier_bandwidth_hz
        plant.actuator_order = device.amplifier_order
        plant.actuator_damping_ratio = device.amplifier_damping_ratio
    return plant


@dataclass(frozen=True)
class SampledPlant:
    """x(k+1) = A x(k) + B_new u(k-n) + B_old u(k-n-1): u is the commanded force, positive against +x."""

    names: tuple[str, ...]
    matrix: FloatArray
    new: FloatArray
    old: FloatArray
    whole_delay: IndexArray
    measured: FloatArray
    held: FloatArray
    sample_time_s: float

    @property
    def forces_under_way(self) -> int:
        """Number d of pending forces of the device with the longest delay."""
        fractional = np.any(self.old != 0, axis=(1, 2))
        return int(np.max(self.whole_delay + fractional))

    def with_forces_under_way(self) -> tuple[FloatArray, FloatArray]:
        """Return A and B of the state [x, u(k-1), ..., u(k-d)] and the force u(k)."""
        devices, hands, s = self.new.shape
        d = self.forces_under_way
        whole = np.zeros((devices, hands, s + d, s + d + 1))
        whole[..., :s, :s] = self.matrix
        for device, n in enumerate(self.whole_delay):
            # Columns of u(k), u(k-1), ..., u(k-d).
            columns = [s + d, *range(s, s + d)]
            whole[device, :, :s, columns[n]] = self.new[device]
            if n < d:
                whole[device, :, :s, columns[n + 1]] = self.old[device]
        if d:
            whole[..., s, s + d] = 1.0
            whole[..., np.arange(s + 1, s + d), np.arange(s, s + d - 1)] = 1.0
        return whole[..., : s + d], whole[..., s + d]


def sampled_plant(
    devices: Device | Sequence[Device],
    hand: Mechanics | Sequence[Mechanics] | None = None,
    mode: Mode | None = None,
) -> SampledPlant:
    """Discretise devices with a hand exactly."""
    some = devices if isinstance(devices, Sequence) else (devices,)
    first = some[0]
    hands = hand if isinstance(hand, Sequence) else [hand] * len(some)
    plants = [device_plant(device, one, mode) for device, one in zip(some, hands, strict=True)]
    grip = plants[0].grip
    linear, steps_s = [plant.linear() for plant in plants], [_steps_s(device) for device in some]
    names = linear[0].names
    moves = transitions([(plant, step) for plant, steps in zip(linear, steps_s, strict=True) for step in steps])
    places = np.cumsum([0, *map(len, steps_s)])
    parts = [_sampled(moves[begin:end]) for begin, end in itertools.pairwise(places)]
    matrix, new, old = (np.stack(part) for part in zip(*parts, strict=True))
    sensed = HANDLE if first.encoder_at == "handle" and first.resonance is not None else DEVICE
    return SampledPlant(
        names=names,
        matrix=matrix,
        new=new,
        old=old,
        whole_delay=np.array([int(device.delay_samples) for device in some]),
        measured=_row(names, sensed),
        held=_row(names, grip),
        sample_time_s=first.sample_time_s,
    )


def _steps_s(device: Device) -> tuple[float, ...]:
    """Return the sample, and where the delay is not whole, the parts before and after a new force arrives."""
    period, late = device.sample_time_s, device.delay_samples - int(device.delay_samples)
    return (period, late * period, (1 - late) * period) if late else (period,)


def _sampled(moves: Sequence[Transition]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A, B_new, B_old of one device with all hands, from its transitions over `_steps_s`."""
    whole, n = moves[0], moves[0].force.shape[-1]
    new, old = whole.force, np.zeros_like(whole.force)
    if len(moves) > 1:
        _, before, after = moves
        new, old = after.force, (after.matrix @ before.force[..., None])[..., 0]
    return whole.matrix.reshape(-1, n, n), new.reshape(-1, n), old.reshape(-1, n)


def _row(names: tuple[str, ...], body: str) -> FloatArray:
    return np.array([float(name == f"{body}_position_m") for name in names])
