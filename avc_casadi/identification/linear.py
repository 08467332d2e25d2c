"""The linear part of the loop over one sample, and its derivatives: the exact discretisation of the sampled plant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.terms import LOOP_RATIO, Structure
from avc_casadi.model.device import Device, Resonance
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import LinearPlant, Transition, transitions
from avc_casadi.model.sampled_plant import SampledPlant, device_plant, sampled_plant

# Step of the differences that give the slopes of a prediction, in search coordinates.
_STEP = 1e-5
# Of a delay, below which there is none.
_LEAST_DELAY = 1e-3

# The force of a fractional delay comes from two samples; a derivative keeps the same two.
TAPS = 2
# Intervals of a sample in which dry friction is evaluated behind an amplifier.
PARTS = 8


@dataclass(frozen=True, eq=False)
class LinearStep:
    """x(k+1) = A x(k) + sum over j of B[:, j] F(k - taps[j]) + g f: F along +x, f the mean of a force on the motor."""

    matrix: FloatArray
    force: FloatArray
    motor: FloatArray
    early: FloatArray
    taps: tuple[int, ...]
    measured: int
    names: tuple[str, ...]

    def flat(self) -> FloatArray:
        """Return all entries in one vector, columns first."""
        return np.concatenate(
            [self.matrix.ravel(order="F"), self.force.ravel(order="F"), self.motor, self.early.ravel()]
        )


def entries_of(states: int, cuts: int) -> int:
    """Return the number of entries of a step of n states, as `LinearStep.flat` lists them."""
    return states * (states + TAPS + 1) + cuts * (states + TAPS + 1)


def device_of(values: Mapping[str, float], structure: Structure, sample_time_s: float) -> Device:
    """Return the device for given parameter values."""
    delay = values["delay_samples"]
    frequency = values["resonance.frequency_hz"]
    bandwidth = values["amplifier_bandwidth_hz"]
    return Device(
        mass_kg=values["mass_kg"],
        damping_ns_per_m=values["damping_ns_per_m"] if values["damping_ns_per_m"] > 1e-9 else 0.0,
        sample_time_s=sample_time_s,
        delay_samples=delay if delay > _LEAST_DELAY else 0.0,
        amplifier_bandwidth_hz=None if math.isnan(bandwidth) else bandwidth,
        amplifier_order=structure.order,
        amplifier_damping_ratio=values[LOOP_RATIO],
        resonance=None
        if math.isnan(frequency)
        else Resonance(
            frequency_hz=frequency,
            damping_ratio=values["resonance.damping_ratio"],
            mass_ratio=values["resonance.mass_ratio"],
        ),
        encoder_at=structure.encoder_at,
    )


def linear_steps(
    several: Sequence[Mapping[str, float]],
    structure: Structure,
    sample_time_s: float,
    taps: tuple[int, ...],
    *,
    parts: int = PARTS,
    near: Mapping[str, float] | None = None,
) -> list[LinearStep]:
    """Discretise several devices, with dry friction evaluated at the instants of a nearby device, if given."""
    devices = [device_of(values, structure, sample_time_s) for values in several]
    springs = [values["stiffness_n_per_m"] if structure.present("stiffness_n_per_m") else None for values in several]
    sampled: dict[int, tuple[SampledPlant, int]] = {}
    for spring in dict.fromkeys(springs):
        mine = [place for place, one in enumerate(springs) if one == spring]
        made = sampled_plant([devices[place] for place in mine], None if spring is None else Hand(0.0, 0.0, spring))
        sampled |= {place: (made, row) for row, place in enumerate(mine)}
    plants = [
        device_plant(device, None if spring is None else Hand(0.0, 0.0, spring)).linear()
        for device, spring in zip(devices, springs, strict=True)
    ]
    late_s = [(device.delay_samples - int(device.delay_samples)) * sample_time_s for device in devices]
    cuts = [_cuts(one, near or one, sample_time_s, parts) for one in several]
    motor, early = _inside(plants, late_s, sample_time_s, cuts)
    found = []
    for place, plant in enumerate(plants):
        made, row = sampled[place]
        whole = int(made.whole_delay[row])
        columns = {whole: -made.new[row, 0], whole + 1: -made.old[row, 0]}
        force = np.stack([columns.get(tap, np.zeros(plant.states)) for tap in taps], axis=1)
        inside = np.zeros((len(early[place]), plant.states + len(taps) + 1))
        inside[:, : plant.states] = early[place][:, : plant.states]
        # Forces are positive against +x in the loop.
        for tap, column in ((whole + 1, plant.states), (whole, plant.states + 1)):
            if tap in taps:
                inside[:, plant.states + taps.index(tap)] = -early[place][:, column]
        inside[:, -1] = -early[place][:, -1]
        found.append(
            LinearStep(
                matrix=made.matrix[row, 0],
                force=force,
                motor=-motor[place],
                early=inside,
                taps=taps,
                measured=int(np.argmax(made.measured)),
                names=plant.names,
            )
        )
    return found


def _cuts(values: Mapping[str, float], near: Mapping[str, float], period: float, parts: int) -> list[float]:
    """Return the instants inside a sample at which dry friction is evaluated: when the newer force arrives, s.

    Behind an amplifier the velocity curves after that, most at first: evaluations are denser there, so that each
    interval has the same error. Instants beyond the sample lie in the next one; which do, and their order, is taken
    from the nearby device: a change of order would swap rows, and a difference would be no derivative.
    """

    def instants(of: Mapping[str, float]) -> FloatArray:
        """Return the instants in samples, not wrapped at the end of the sample."""
        late = of["delay_samples"] % 1.0
        if math.isnan(of["amplifier_bandwidth_hz"]):
            return np.array([late] if parts else [])
        turn = math.pi * of["amplifier_bandwidth_hz"] * period
        return np.asarray(late - np.log1p(np.arange(parts) / parts * math.expm1(-turn)) / turn)

    before = instants(near)
    places = instants(values) - np.floor(before)
    return [period * min(max(float(place), 0.0), 1.0) for place in places[np.argsort(before % 1.0)]]


def _inside(
    plants: Sequence[LinearPlant], late_s: Sequence[float], period: float, cuts: Sequence[Sequence[float]]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the effect of a motor force over a sample, and the motor's velocity at the cuts of the sample."""
    asked = {(place, True, period): 0 for place in range(len(plants))}
    for place, (mine, late) in enumerate(zip(cuts, late_s, strict=True)):
        for time in mine:
            wanted = ((True, time), (False, min(time, late)), (False, time - late))
            asked |= {(place, rubs, t): 0 for rubs, t in wanted if t > 0}
    rubbed = [replace(plant, force=plant.friction) for plant in plants]
    every = transitions([((rubbed if rubs else plants)[place], time) for place, rubs, time in asked])
    moves = dict(zip(asked, every, strict=True))
    early = []
    for place, (mine, late, plant) in enumerate(zip(cuts, late_s, plants, strict=True)):
        size = plant.states
        lines = np.zeros((len(mine), size + 3))
        for line, time in zip(lines, mine, strict=True):
            line[:size] = np.eye(size)[1]
            first = moves.get((place, False, min(time, late)))
            if first is not None:
                line[: size + 1] = _row(first, size)
            if time > late:
                second = _row(moves[place, False, time - late], size)
                line[: size + 2] = [*second[:size], 0.0, second[size]]
                if first is not None:
                    line[:size] = second[:size] @ first.matrix.reshape(size, size)
                    line[size] = second[:size] @ first.force.reshape(-1)
            if time > 0:
                line[size + 2] = _row(moves[place, True, time], size)[size]
        early.append(lines)
    return [moves[place, True, period].force.reshape(-1) for place in range(len(plants))], early


def _row(move: Transition, size: int) -> FloatArray:
    """Return the row of the motor's velocity by the state and a force."""
    return np.append(move.matrix.reshape(size, size)[1], move.force.reshape(-1)[1])


def taps_of(values: Mapping[str, float]) -> tuple[int, ...]:
    """Return the delays in samples of the forces that act within one sample."""
    whole = int(values["delay_samples"])
    return tuple(range(whole, whole + TAPS))


def beside(values: Mapping[str, float], structure: Structure) -> tuple[list[dict[str, float]], FloatArray]:
    """Return the values beside a point, one parameter moved in each, and the moves of the search coordinates."""
    several, moves = [], []
    for one in structure.free:
        value = values[one.name]
        q = structure.inward(one, value)
        move = _STEP * max(1.0, abs(q))
        if one.name == "delay_samples":
            # The same two forces act within a sample, where every entry is smooth.
            move = 2 * _LEAST_DELAY if value % 1.0 < 0.5 else -2 * _LEAST_DELAY
        moved = structure.outward(one, q + move)
        several.append({**values, one.name: moved})
        moves.append(structure.inward(one, moved) - q)
    return several, np.array(moves)
