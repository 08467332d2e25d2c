"""One-step-ahead prediction of the position from the commanded force, with its slopes.

The linear part of the loop is that of the device; dry friction is a force on the motor that stops, holds and releases
it inside a sample. An observer of fixed gain keeps the prediction near the log: without gain the model runs free
(output error), with a larger gain an unmodelled disturbance is forgotten sooner.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.linear import PARTS, LinearStep, beside, linear_steps, taps_of
from avc_casadi.identification.log import Record
from avc_casadi.identification.run import run
from avc_casadi.identification.terms import FRICTION, OFFSET, Structure, is_force, offset_of

_MOST_DOUBLINGS = 60
_BEGINNING = 40


@dataclass(frozen=True, eq=False)
class Prediction:
    """Measured less predicted position of a record, shape (samples,), and its slopes, shape (samples, free)."""

    error_m: FloatArray
    slopes: FloatArray


@dataclass(frozen=True, eq=False)
class Observer:
    """Observer of a random disturbance; its rate is its bandwidth for a mass alone."""

    rate_per_s: float

    def gain(self, step: LinearStep, mass_kg: float, period: float) -> FloatArray:
        """Return the gain of the observer for a white disturbance at the motor."""
        # With velocities in metres per sample and forces as accelerations in metres per sample squared the equation is
        # balanced.
        scale = np.array([_scale(name, mass_kg, period) for name in step.names])
        matrix = step.matrix * scale[:, None] / scale
        push = step.motor * scale * mass_kg * self.rate_per_s**2
        row = np.zeros((1, scale.size))
        row[0, step.measured] = 1.0
        # Doubling: `solve_discrete_are` fails where eigenvalues lie near the unit circle, as of a slow observer.
        a, g, h = matrix.T, row.T @ row, np.outer(push, push)
        for _ in range(_MOST_DOUBLINGS):
            inner = np.linalg.inv(np.eye(a.shape[0]) + g @ h)
            more = a.T @ h @ inner @ a
            a, g, h = a @ inner @ a, g + a @ inner @ g @ a.T, h + more
            if np.abs(more).max() <= 1e-14 * np.abs(h).max():
                break
        measured = h[:, step.measured]
        return np.asarray(measured / (measured[step.measured] + 1.0) / scale, dtype=np.float64)


def _scale(name: str, mass_kg: float, period: float) -> float:
    if name.startswith("actuator"):
        return period**2 / mass_kg * (period if name.endswith("_per_s") else 1.0)
    return period if name.endswith("_m_per_s") else 1.0


class Predictor:
    """Predicts the records of one device, all with one sample time, with models of it."""

    def __init__(self, records: Sequence[Record], whole: Predictor | None = None) -> None:
        self.records = tuple(records)
        self.sample_time_s = records[0].sample_time_s
        # Of pieces, logs and origin are those of the whole.
        self.names: tuple[str, ...] = whole.names if whole else tuple(dict.fromkeys(one.whole for one in records))
        self.origin_m: float = whole.origin_m if whole else float(records[0].position_m[0])
        self._logs = [self.names.index(record.whole) for record in records]

    def predict(
        self, structure: Structure, search: FloatArray, observer: Observer, *, slopes: bool = True
    ) -> list[Prediction]:
        """Predict every record; the observer's gain counts as constant in the derivatives."""
        values = structure.values(search)
        several, moves = beside(values, structure) if slopes else ([], np.zeros(0))
        taps = taps_of(values)
        cuts = PARTS if structure.present("amplifier_bandwidth_hz") else 1
        step, linear = self._models(structure, [values, *several], taps, observer)
        found = []
        for record, log in zip(self.records, self._logs, strict=True):
            # Where each log has a constant force of its own, that takes the place of the common one.
            keys = [FRICTION, offset_of(log) if structure.offsets > 1 else OFFSET]
            forces = [[each.get(key, 0.0) for key in keys] for each in (values, *several)]
            numbers = np.insert(linear, [step.flat().size], np.array(forces), axis=1)
            out = run(*self._begun(step, record, taps), numbers, cuts)
            by = (out[:, 1:] - out[:, :1]) / moves
            found.append(Prediction(out[:, 0].copy(), by))
        return found

    def _models(
        self, structure: Structure, several: Sequence[Mapping[str, float]], taps: tuple[int, ...], observer: Observer
    ) -> tuple[LinearStep, FloatArray]:
        """Return the first step, and of every model the entries, gain and row that `run` takes around its forces."""
        linear = [0, *(at for at, name in enumerate(structure.names, 1) if at < len(several) and not is_force(name))]
        made = linear_steps([several[at] for at in linear], structure, self.sample_time_s, taps, near=several[0])
        by_place = dict(zip(linear, made, strict=True))
        steps = [by_place.get(at, made[0]) for at in range(len(several))]
        step = steps[0]
        gain = observer.gain(step, several[0]["mass_kg"], self.sample_time_s)
        row = np.eye(len(step.names))[step.measured]
        return step, np.array([np.concatenate([one.flat(), gain, row]) for one in steps])

    def _begun(self, step: LinearStep, record: Record, taps: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return the initial state of a record, at rest or in uniform motion, and the inputs of its samples."""
        position = record.position_m - self.origin_m
        size = position.size
        inputs = np.empty((size, len(taps) + 1))
        for at, tap in enumerate(taps):
            inputs[:tap, at] = record.force_n[0]
            inputs[tap:, at] = record.force_n[: size - tap]
        inputs[:, -1] = position
        few = min(size, _BEGINNING)
        slope, start = np.polyfit(np.arange(few) * self.sample_time_s, position[:few], 1)
        begins = {"_position_m": start, "_velocity_m_per_s": slope, "actuator_force_n": -record.force_n[0]}
        state = [next((value for end, value in begins.items() if name.endswith(end)), 0.0) for name in step.names]
        return np.array(state), inputs
