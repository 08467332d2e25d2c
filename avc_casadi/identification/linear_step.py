"""The linear part of a sample: the exact discretisation of a device, and the motor's velocity inside the sample.

A *cut* is an instant inside a sample at which the velocity of the motor is evaluated for dry friction. The *mobility*
up to it is the velocity that a constant force on the motor has given it by then, (m/s)/N.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.terms import LOOP_RATIO, ModelStructure
from avc_casadi.model.device import Device, Resonance
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import LinearPlant, Transition, device_plant, sampled_plant, transitions
from avc_casadi.model.quantity import LEAST_DELAY_SAMPLES

TAPS = 2
"""The force of a fractional delay comes from two samples; a derivative keeps the same two."""
PARTS = 8
"""Intervals of a sample in which dry friction is evaluated behind an amplifier."""
MOTOR_POSITION = 0
"""Index of the motor's position in the state of a device ..."""
MOTOR_VELOCITY = 1
"""... and of its velocity."""
_LEAST_DAMPING_NS_PER_M = 1e-9
"""A search that ends at the bound of the damping leaves less than this, which is none."""
_SEARCH_MOVE = 1e-5
"""Move of a search coordinate for a slope, as a share of the coordinate or of 1."""


@dataclass(frozen=True, eq=False)
class LinearStep:
    """x(k+1) = A x(k) + sum over j of B[:, j] F(k - taps[j]) + g f: F along +x, f the mean of a force on the motor.

    `matrix` A has the shape (states, states), `force` B (states, taps), and `motor` g (states,). A row of `cut_rows`,
    shape (cuts, states + taps + 1), gives the velocity of the motor at a cut by the state, the forces F, and f, whose
    entry is the mobility.
    """

    matrix: FloatArray
    force: FloatArray
    motor: FloatArray
    cut_rows: FloatArray
    taps: tuple[int, ...]
    output: int
    names: tuple[str, ...]

    def flat(self) -> FloatArray:
        """Return all entries in one vector, columns first."""
        return np.concatenate(
            [self.matrix.ravel(order="F"), self.force.ravel(order="F"), self.motor, self.cut_rows.ravel()]
        )


def entries_of(states: int, cuts: int) -> int:
    """Return the number of entries of a step of n states, as `LinearStep.flat` lists them."""
    return states * (states + TAPS + 1) + cuts * (states + TAPS + 1)


def device_of(values: Mapping[str, float], structure: ModelStructure, sample_time_s: float) -> Device:
    """Return the device of given parameter values, without its dry friction; not a number leaves a part out."""
    delay = values["delay_samples"]
    damping = values["damping_ns_per_m"]
    frequency = values["resonance.frequency_hz"]
    bandwidth = values["amplifier_bandwidth_hz"]
    return Device(
        mass_kg=values["mass_kg"],
        damping_ns_per_m=damping if damping > _LEAST_DAMPING_NS_PER_M else 0.0,
        sample_time_s=sample_time_s,
        delay_samples=delay if delay > LEAST_DELAY_SAMPLES else 0.0,
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
    models: Sequence[Mapping[str, float]],
    structure: ModelStructure,
    sample_time_s: float,
    taps: tuple[int, ...],
    *,
    parts: int = PARTS,
    reference: Mapping[str, float] | None = None,
) -> list[LinearStep]:
    """Discretise several devices, given by the values of their parameters.

    Dry friction is evaluated at the cuts of a nearby reference, if given, in so many parts of a sample.
    """
    devices = [device_of(values, structure, sample_time_s) for values in models]
    has_spring = structure.present("stiffness_n_per_m")
    stiffnesses = [values["stiffness_n_per_m"] if has_spring else None for values in models]
    sampled = _sampled(devices, stiffnesses)
    plants = [
        device_plant(device, _spring(stiffness)).linear()
        for device, stiffness in zip(devices, stiffnesses, strict=True)
    ]
    late_s = [(device.delay_samples - int(device.delay_samples)) * sample_time_s for device in devices]
    cuts_s = [_cuts(values, reference or values, sample_time_s, parts) for values in models]
    motor, cut_rows = _inside(plants, late_s, sample_time_s, cuts_s)
    return [
        LinearStep(
            matrix=device.matrix,
            force=_force_columns(device, taps),
            motor=-motor[index],
            cut_rows=_rows_by_taps(cut_rows[index], device, taps),
            taps=taps,
            output=device.output,
            names=plants[index].names,
        )
        for index, device in enumerate(sampled)
    ]


@dataclass(frozen=True, eq=False)
class _Sampled:
    """x(k+1) = A x(k) + B_new u(k-n) + B_old u(k-n-1) of one device, u positive against +x, and the measured state."""

    matrix: FloatArray
    new: FloatArray
    old: FloatArray
    whole_delay: int
    output: int


def _sampled(devices: Sequence[Device], stiffnesses: Sequence[float | None]) -> list[_Sampled]:
    """Discretise devices on their springs to ground, those on equal springs at once."""
    sampled: dict[int, _Sampled] = {}
    for stiffness in dict.fromkeys(stiffnesses):
        places = [place for place, of_device in enumerate(stiffnesses) if of_device == stiffness]
        plant = sampled_plant([devices[place] for place in places], _spring(stiffness))
        output = int(np.argmax(plant.output_row))
        for row, place in enumerate(places):
            whole_delay = int(plant.whole_delay[row])
            sampled[place] = _Sampled(plant.matrix[row, 0], plant.new[row, 0], plant.old[row, 0], whole_delay, output)
    return [sampled[place] for place in range(len(devices))]


def _spring(stiffness_n_per_m: float | None) -> Hand | None:
    """Return a spring to ground as the hand that it is; None for none."""
    return None if stiffness_n_per_m is None else Hand(0.0, 0.0, stiffness_n_per_m)


def _force_columns(device: _Sampled, taps: tuple[int, ...]) -> FloatArray:
    """Return the effect of the force of each tap on the state, shape (states, taps); F is positive along +x."""
    columns = {device.whole_delay: -device.new, device.whole_delay + 1: -device.old}
    nothing = np.zeros(len(device.matrix))
    return np.stack([columns.get(tap, nothing) for tap in taps], axis=1)


def _rows_by_taps(rows: FloatArray, device: _Sampled, taps: tuple[int, ...]) -> FloatArray:
    """Return rows by the state, the older and the newer force, and the friction as rows by the state, taps, friction.

    Forces are positive against +x in the loop, and along +x here.
    """
    states = len(device.matrix)
    older_column = states
    newer_column = states + 1
    friction_column = states + 2
    by_taps = np.zeros((len(rows), states + len(taps) + 1))
    by_taps[:, :states] = rows[:, :states]
    for tap, column in ((device.whole_delay + 1, older_column), (device.whole_delay, newer_column)):
        if tap in taps:
            by_taps[:, states + taps.index(tap)] = -rows[:, column]
    by_taps[:, -1] = -rows[:, friction_column]
    return by_taps


def _cuts(values: Mapping[str, float], reference: Mapping[str, float], period_s: float, parts: int) -> list[float]:
    """Return the instants inside a sample at which dry friction is evaluated: when the newer force arrives, s.

    Behind an amplifier the velocity curves after that, most at first: evaluations are denser there, so that each
    interval has the same error. Instants beyond the sample lie in the next one; which do, and their order, is taken
    from the nearby reference: a change of order would swap rows, and a difference would be no derivative.
    """

    def instants(model: Mapping[str, float]) -> FloatArray:
        """Return the instants in samples, not wrapped at the end of the sample."""
        late = model["delay_samples"] % 1.0
        if math.isnan(model["amplifier_bandwidth_hz"]):
            return np.array([late] if parts else [])
        turn = math.pi * model["amplifier_bandwidth_hz"] * period_s
        return np.asarray(late - np.log1p(np.arange(parts) / parts * math.expm1(-turn)) / turn)

    reference_instants = instants(reference)
    wrapped = instants(values) - np.floor(reference_instants)
    order = np.argsort(reference_instants % 1.0)
    return [period_s * min(max(float(instant), 0.0), 1.0) for instant in wrapped[order]]


@dataclass(frozen=True)
class _Span:
    """A time over which a plant moves under a constant force: that of the loop, or dry friction on the motor."""

    plant: int
    by_friction: bool
    time_s: float


def _inside(
    plants: Sequence[LinearPlant], late_s: Sequence[float], period_s: float, cuts_s: Sequence[Sequence[float]]
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the effect of a force on the motor over a sample, and rows of the motor's velocity at the cuts.

    The effect has the shape (states,) for each plant, the rows (cuts, states + 3): by the state, the older and the
    newer force of the loop, which arrives `late_s` after the sample begins, and the force on the motor.
    """
    samples = [_Span(plant, True, period_s) for plant in range(len(plants))]
    spans = dict.fromkeys(samples)
    for plant, (instants, late) in enumerate(zip(cuts_s, late_s, strict=True)):
        for time in instants:
            to_cut = (
                _Span(plant, True, time),
                _Span(plant, False, min(time, late)),
                _Span(plant, False, time - late),
            )
            spans |= dict.fromkeys(span for span in to_cut if span.time_s > 0)
    plants_under_friction = [replace(plant, force=plant.friction) for plant in plants]
    moved_plants = [(plants_under_friction if span.by_friction else plants)[span.plant] for span in spans]
    times = [span.time_s for span in spans]
    moves = dict(zip(spans, transitions(list(zip(moved_plants, times, strict=True))), strict=True))
    rows = []
    for plant, (instants, late) in enumerate(zip(cuts_s, late_s, strict=True)):
        states = plants[plant].states
        of_cuts = [_cut_row(moves, plant, states, time, late) for time in instants]
        rows.append(np.array(of_cuts).reshape(-1, states + 3))
    return [moves[span].force.reshape(-1) for span in samples], rows


def _cut_row(moves: Mapping[_Span, Transition], plant: int, states: int, time: float, late: float) -> FloatArray:
    """Return the motor's velocity at a cut of a sample as a row over the state, old, new force and friction.

    `time` and `late` are shares of the sample: of the cut, and of the arrival of the newer force.
    """
    row = np.zeros(states + 3)
    row[:states] = np.eye(states)[MOTOR_VELOCITY]
    under_older = moves.get(_Span(plant, False, min(time, late)))
    if under_older is not None:
        row[: states + 1] = _velocity_row(under_older, states)
    if time > late:
        under_newer = _velocity_row(moves[_Span(plant, False, time - late)], states)
        row[: states + 2] = [*under_newer[:states], 0.0, under_newer[states]]
        if under_older is not None:
            row[:states] = under_newer[:states] @ under_older.matrix.reshape(states, states)
            row[states] = under_newer[:states] @ under_older.force.reshape(-1)
    if time > 0:
        row[states + 2] = _velocity_row(moves[_Span(plant, True, time)], states)[states]
    return row


def _velocity_row(move: Transition, states: int) -> FloatArray:
    """Return the row of the motor's velocity by the state and a force, shape (states + 1,)."""
    by_state = move.matrix.reshape(states, states)[MOTOR_VELOCITY]
    by_force = move.force.reshape(-1)[MOTOR_VELOCITY]
    return np.append(by_state, by_force)


def taps_of(values: Mapping[str, float]) -> tuple[int, ...]:
    """Return the delays in samples of the forces that act within one sample."""
    whole = int(values["delay_samples"])
    return tuple(range(whole, whole + TAPS))


def perturbed(values: Mapping[str, float], structure: ModelStructure) -> tuple[list[dict[str, float]], FloatArray]:
    """Return the values near a point, one free parameter moved in each, and the moves of the search coordinates."""
    models, moves = [], []
    for parameter in structure.free:
        value = values[parameter.name]
        q = structure.inward(parameter, value)
        move = _SEARCH_MOVE * max(1.0, abs(q))
        if parameter.name == "delay_samples":
            # The same two forces act within a sample, where every entry is smooth.
            move = 2 * LEAST_DELAY_SAMPLES if value % 1.0 < 0.5 else -2 * LEAST_DELAY_SAMPLES
        if q + move > structure.inward(parameter, parameter.highest):
            move = -move  # beyond its bounds there is no device
        moved_value = structure.outward(parameter, q + move)
        models.append({**values, parameter.name: moved_value})
        moves.append(structure.inward(parameter, moved_value) - q)
    return models, np.array(moves)
