"""One-step-ahead prediction of the position from the commanded force, with exact derivatives, in CasADi.

The linear part of the loop is that of the device; dry friction is a force on the motor that stops, holds and releases
it inside a sample. An observer of fixed gain keeps the prediction near the log: without gain the model runs free
(output error), with a larger gain an unmodelled disturbance is forgotten sooner. In a closed loop the prediction error
stays unbiased where the gain fits the disturbance.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.encoder import SLOWLY, encoder_step_m, last_went
from avc_casadi.identification.linear import PARTS, LinearStep, linear_derivatives, linear_step, taps_of
from avc_casadi.identification.record import Record
from avc_casadi.identification.run import Kind, prepare, run
from avc_casadi.identification.terms import DEAD_ZONE, FRICTION, LINEAR, OFFSET, PLAY, Structure, offset_of

_MOST_DOUBLINGS = 60
# Step of the central differences by backlash and dead zone, as a share of their search units.
_ASIDE = 1e-2
# Records of so many samples in all are worth compiling the model for.
_WORTH_PREPARING = 2000


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction of one record.

    Attributes:
        error_m: measured less predicted position, shape (samples,).
        slopes: derivative of the error by the coordinates of the search, shape (samples, free), or None.
    """

    error_m: FloatArray
    slopes: FloatArray | None


@dataclass(frozen=True, eq=False)
class Observer:
    """Observer of a random disturbance.

    Attributes:
        rate_per_s: bandwidth for a mass alone: the square root of the disturbance's acceleration over the noise.
    """

    rate_per_s: float

    def gain(self, step: LinearStep, mass_kg: float, period: float) -> tuple[FloatArray, float]:
        """Return the gain of the observer for a white disturbance at the motor, and the share of noise in the error."""
        # With velocities in metres per sample and forces as accelerations in metres per sample squared the equation is
        # balanced.
        scale = np.array([_scale(name, mass_kg, period) for name in step.names])
        matrix = step.matrix * scale[:, None] / scale
        push = step.motor * scale * mass_kg * self.rate_per_s**2
        row = np.zeros((1, scale.size))
        row[0, step.measured] = 1.0
        covariance = _steady_covariance(matrix, row, push)
        measured = covariance[:, step.measured]
        total = float(measured[step.measured]) + 1.0
        return np.asarray(measured / total / scale, dtype=np.float64), 1.0 / total


def _steady_covariance(matrix: FloatArray, row: FloatArray, push: FloatArray) -> FloatArray:
    """Return the steady covariance of a Kalman filter's prediction for noise of variance 1, by doubling.

    scipy's `solve_discrete_are` orders eigenvalues, which lie near the unit circle where the filter is slow: it failed
    in 115 of 2160 devices tried and lost digits in more; doubling did in none.
    """
    a, g, h = matrix.T, row.T @ row, np.outer(push, push)
    for _ in range(_MOST_DOUBLINGS):
        inner = np.linalg.inv(np.eye(a.shape[0]) + g @ h)
        more = a.T @ h @ inner @ a
        a, g, h = a @ inner @ a, g + a @ inner @ g @ a.T, h + more
        if np.abs(more).max() <= 1e-14 * np.abs(h).max():
            break
    return np.asarray(h, dtype=np.float64)


def _scale(name: str, mass_kg: float, period: float) -> float:
    if name.endswith("_m_per_s"):
        return period
    if name.startswith("actuator"):
        return period**2 / mass_kg * (period if name.endswith("_per_s") else 1.0)
    return 1.0


class Predictor:
    """Predicts the records of one device with models of it.

    Args:
        records: of the device, all with one sample time.
        origin_m: position taken as 0.
        logs: names of all logs that the model knows; by default those of the records.
        play_taken_up: power of time by which backlash is taken up during a reversal.
        parts: intervals of a sample in which dry friction is evaluated behind an amplifier.

    Attributes:
        records: of the device.
        logs: the log of each record, from 0.
        sample_time_s: T.
    """

    def __init__(
        self,
        records: Sequence[Record],
        origin_m: float,
        logs: Sequence[str] = (),
        play_taken_up: float = SLOWLY,
        parts: int = PARTS,
    ) -> None:
        self.records = tuple(records)
        self._origin_m, self._play_taken_up, self._parts = origin_m, play_taken_up, parts
        self.sample_time_s = records[0].sample_time_s
        names = list(logs or dict.fromkeys(record.whole for record in records))
        self.logs = tuple(names.index(record.whole) for record in records)
        self._positions = [np.ascontiguousarray(record.position_m - origin_m) for record in records]

    @cached_property
    def last_went(self) -> list[FloatArray] | None:
        """Direction of the last motion of each record; None where no record can show backlash."""
        step_m = encoder_step_m(self.records) or 0.0
        found = [last_went(record.position_m, step_m, self._play_taken_up) for record in self.records]
        if all(way is None for way in found):
            return None
        return [np.zeros(at.size) if way is None else way for way, at in zip(found, self._positions, strict=True)]

    def of(self, records: Sequence[Record], play_taken_up: float = SLOWLY, parts: int = PARTS) -> Predictor:
        """Return a predictor of other records of the same logs, or with other backlash or intervals of a sample.

        Args:
            records: of the same logs.
            play_taken_up: power of time.
            parts: intervals of a sample.
        """
        names = tuple(dict.fromkeys(record.whole for record in self.records))
        return Predictor(records, self._origin_m, names, play_taken_up, parts)

    def prepare(self, structures: Iterable[Structure]) -> None:
        """Start compiling the predictions with some structures, where the records are worth it.

        Args:
            structures: in the order of their use.
        """
        if sum(at.size for at in self._positions) >= _WORTH_PREPARING:
            prepare(list(dict.fromkeys(map(self._kind, structures))))

    def _kind(self, structure: Structure) -> Kind:
        rings, lags = (structure.present(name) for name in ("resonance.frequency_hz", "amplifier_bandwidth_hz"))
        return Kind(
            2 + 2 * rings + lags * structure.amplifier_order,
            self._parts if lags else 1,
            structure.present("breakaway_excess_n"),
        )

    def predict(
        self, structure: Structure, search: FloatArray, observer: Observer, *, slopes: bool = True
    ) -> list[Prediction]:
        """Predict every record.

        Args:
            structure: terms of the model.
            search: coordinates of its free parameters.
            observer: of the disturbance.
            slopes: whether to return derivatives; the observer's gain counts as constant in them.
        """
        values = structure.values(search)
        taps = taps_of(values)
        outward = structure.slopes(search)
        free = structure.free
        linear = [index for index, one in enumerate(free) if one.name in LINEAR]
        rough = {one.name: index for index, one in enumerate(free) if one.part == "friction"}
        found = []
        models: dict[float, tuple[LinearStep, FloatArray, FloatArray]] = {}
        behind = self.last_went if structure.present(PLAY) else None
        ways = behind or [np.zeros(1)] * len(self.records)
        aside = [(index, one.name) for index, one in enumerate(free) if one.name in {PLAY, DEAD_ZONE}] if slopes else []
        for record, measured, way, log in zip(self.records, self._positions, ways, self.logs, strict=True):
            position = measured if behind is None else measured + values[PLAY] / 2 * way
            if record.added_mass_kg not in models:
                whole = {**values, "mass_kg": values["mass_kg"] + record.added_mass_kg}
                step = linear_step(whole, structure, self.sample_time_s, taps, parts=self._parts)
                gain, _ = observer.gain(step, whole["mass_kg"], self.sample_time_s)
                by_linear = (
                    linear_derivatives(whole, structure, self.sample_time_s, taps, self._parts)
                    if slopes and linear
                    else np.zeros((step.flat().size, 0))
                )
                models[record.added_mass_kg] = (step, gain, by_linear)
            step, gain, by_linear = models[record.added_mass_kg]
            row = np.zeros(len(step.names))
            row[step.measured] = 1.0
            # The constant force of the record's own log takes the place of the common one.
            own = {**dict(zip(FRICTION, FRICTION, strict=True)), OFFSET: offset_of(log)}
            friction = np.array([values.get(own[name], values[name]) for name in FRICTION])
            numbers = np.concatenate([step.flat(), friction, gain, row])
            acting = [*linear, *(rough[own[name]] for name in FRICTION if own[name] in rough)] if slopes else []
            directions = np.zeros((len(acting), numbers.size))
            if slopes:
                directions[: len(linear), : len(by_linear)] = by_linear.T
                places = [len(by_linear) + at for at, name in enumerate(FRICTION) if own[name] in rough]
                directions[range(len(linear), len(acting)), places] = 1.0
            state, inputs = _begun(step, _driven(record, values[DEAD_ZONE]), position, taps)
            kind = self._kind(structure)
            out = run(state, inputs, numbers, directions, kind)
            by = None
            if slopes:
                by = np.zeros((len(out), len(free)))
                by[:, acting] = out[:, 1:] * outward[acting]
                for index, name in aside:
                    ends = []
                    for move in (-_ASIDE * outward[index], _ASIDE * outward[index]):
                        zone, at = (
                            (values[DEAD_ZONE] + move, position)
                            if name == DEAD_ZONE
                            else (values[DEAD_ZONE], position + move / 2 * way)
                        )
                        ends.append(run(*_begun(step, _driven(record, zone), at, taps), numbers, directions[:0], kind))
                    by[:, index] = (ends[1][:, 0] - ends[0][:, 0]) / (2 * _ASIDE)
            found.append(Prediction(out[:, 0].copy(), by))
        return found


def _driven(record: Record, dead_zone_n: float) -> Record:
    """Return the record with the forces that an amplifier with a dead zone makes of the commands."""
    if dead_zone_n == 0:
        return record
    beyond = np.maximum(np.abs(record.force_n) - dead_zone_n, 0.0)
    return replace(record, force_n=np.sign(record.force_n) * beyond)


def _begun(
    step: LinearStep, record: Record, position: FloatArray, taps: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return the initial state of a record, at rest or in uniform motion, and the inputs of its samples."""
    size, period = position.size, record.sample_time_s
    inputs = np.empty((size, len(taps) + 2))
    for at, tap in enumerate(taps):
        inputs[:tap, at] = record.force_n[0]
        inputs[tap:, at] = record.force_n[: size - tap]
    inputs[:, -2] = position
    inputs[:, -1] = record.begins_s + np.arange(size) * period
    few = min(size, 40)
    slope, start = np.polyfit(np.arange(few) * period, position[:few], 1)
    state = np.zeros(len(step.names))
    for index, name in enumerate(step.names):
        if name.endswith("_position_m"):
            state[index] = start
        elif name.endswith("_velocity_m_per_s"):
            state[index] = slope
        elif name == "actuator_force_n":
            state[index] = -record.force_n[0]
    return state, inputs
