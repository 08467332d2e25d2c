"""One-step-ahead prediction of the position from the commanded force, with its slopes.

The linear part of the loop is the exact discretisation of the device; dry friction is a force on the motor that stops,
holds and releases it inside a sample, where it enters by two numbers only, the mean force and its moment. An observer
of fixed gain keeps the prediction near the log: without gain the model runs free (output error), with a larger gain an
unmodelled disturbance is forgotten sooner. Models run side by side: compiled where there is a C compiler, else by
CasADi.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import FORCES, FRICTION, LOOP_RATIO, OFFSET, Structure, is_force, offset_of
from avc_casadi.model.device import Device, Resonance
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import LinearPlant, SampledPlant, Transition, device_plant, sampled_plant, transitions
from avc_casadi.model.quantity import LEAST_DELAY_SAMPLES
from avc_casadi.simulation.emit import LANES_HEAD, in_lanes
from avc_casadi.simulation.execute import compiler, library

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
    output: int
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
        discrete = sampled_plant([devices[place] for place in mine], None if spring is None else Hand(0.0, 0.0, spring))
        sampled |= {place: (discrete, row) for row, place in enumerate(mine)}
    plants = [
        device_plant(device, None if spring is None else Hand(0.0, 0.0, spring)).linear()
        for device, spring in zip(devices, springs, strict=True)
    ]
    late_s = [(device.delay_samples - int(device.delay_samples)) * sample_time_s for device in devices]
    cuts = [_cuts(one, near or one, sample_time_s, parts) for one in several]
    motor, early = _inside(plants, late_s, sample_time_s, cuts)
    steps = []
    for place, plant in enumerate(plants):
        discrete, row = sampled[place]
        whole = int(discrete.whole_delay[row])
        columns = {whole: -discrete.new[row, 0], whole + 1: -discrete.old[row, 0]}
        force = np.stack([columns.get(tap, np.zeros(plant.states)) for tap in taps], axis=1)
        inside = np.zeros((len(early[place]), plant.states + len(taps) + 1))
        inside[:, : plant.states] = early[place][:, : plant.states]
        # Forces are positive against +x in the loop.
        for tap, column in ((whole + 1, plant.states), (whole, plant.states + 1)):
            if tap in taps:
                inside[:, plant.states + taps.index(tap)] = -early[place][:, column]
        inside[:, -1] = -early[place][:, -1]
        steps.append(
            LinearStep(
                matrix=discrete.matrix[row, 0],
                force=force,
                motor=-motor[place],
                early=inside,
                taps=taps,
                output=int(np.argmax(discrete.output_row)),
                names=plant.names,
            )
        )
    return steps


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
    keys = {(place, True, period): 0 for place in range(len(plants))}
    for place, (mine, late) in enumerate(zip(cuts, late_s, strict=True)):
        for time in mine:
            parts = ((True, time), (False, min(time, late)), (False, time - late))
            keys |= {(place, rubs, t): 0 for rubs, t in parts if t > 0}
    by_friction = [replace(plant, force=plant.friction) for plant in plants]
    every = transitions([((by_friction if rubs else plants)[place], time) for place, rubs, time in keys])
    moves = dict(zip(keys, every, strict=True))
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
        move = 1e-5 * max(1.0, abs(q))
        if one.name == "delay_samples":
            # The same two forces act within a sample, where every entry is smooth.
            move = 2 * LEAST_DELAY_SAMPLES if value % 1.0 < 0.5 else -2 * LEAST_DELAY_SAMPLES
        if q + move > structure.inward(one, one.highest):
            move = -move  # beyond its bounds there is no device
        other = structure.outward(one, q + move)
        several.append({**values, one.name: other})
        moves.append(structure.inward(one, other) - q)
    return several, np.array(moves)


_TINY = 1e-30
_LOOP = """
{head}
static inline void sample(const Lanes* restrict x, const double* restrict inputs, const Lanes* restrict numbers,
                          Lanes* restrict next, Lanes* restrict error) {{
  {body}
}}

/* Models side by side in the lanes of vectors; lanes without a model go through the last one. */
int avc_run(long long samples, long long models, const double* initial, const double* inputs, const double* all,
            double* out) {{
  for (long long first = 0; first < models; first += WIDTH) {{
    Lanes x[2][{states}], numbers[{numbers}], error;
    for (int lane = 0; lane < WIDTH; ++lane) {{
      const long long mine = first + lane < models ? first + lane : models - 1;
      for (int i = 0; i < {numbers}; ++i) numbers[i][lane] = all[mine * {numbers} + i];
    }}
    for (int i = 0; i < {states}; ++i) x[0][i] = SPREAD(initial[i]);
    for (long long k = 0; k < samples; ++k) {{
      sample(x[k & 1], inputs + k * {inputs}, numbers, x[~k & 1], &error);
      for (int lane = 0; lane < WIDTH && first + lane < models; ++lane) out[k * models + first + lane] = error[lane];
    }}
  }}
  return 0;
}}
"""


def run(state: FloatArray, inputs: FloatArray, numbers: FloatArray, cuts: int) -> FloatArray:
    """Return the prediction error of every sample and model, with some looks at the velocity, (samples, models)."""
    x, inputs, numbers = (np.array(one, dtype=np.float64, order="C") for one in (state, inputs, numbers))
    if compiler() is None:
        through = sample(x.size, cuts).mapaccum("through", len(inputs))
        return np.array([np.asarray(through(x, inputs.T, one)[1]).ravel() for one in numbers]).T
    out = np.empty((len(inputs), len(numbers)))
    pointers = (one.ctypes.data for one in (x, inputs, numbers, out))
    _native(x.size, cuts)(len(inputs), len(numbers), *pointers)
    return out


@lru_cache(maxsize=16)
def _native(states: int, cuts: int) -> Callable[..., int]:
    one = sample(states, cuts)
    body = in_lanes(one, ("x[{}]", "SPREAD(inputs[{}])", "numbers[{}]"), ("next[{}]", "error[{}]"))
    sizes = dict(zip(("states", "inputs", "numbers"), (one.numel_in(at) for at in range(3)), strict=True))
    function = library(_LOOP.format(head=LANES_HEAD, body=body, **sizes)).avc_run
    function.restype = ctypes.c_int
    function.argtypes = [ctypes.c_longlong, ctypes.c_longlong] + [ctypes.c_void_p] * 4
    result: Callable[..., int] = function
    return result


@lru_cache(maxsize=16)
def sample(states: int, cuts: int) -> Any:
    """Return a sample as a CasADi function: state, inputs, numbers -> next state, error."""
    x, inputs = ca.SX.sym("x", states), ca.SX.sym("inputs", TAPS + 1)
    numbers = ca.SX.sym("numbers", entries_of(states, cuts) + len(FORCES) + 2 * states)
    entries, parts, gain, output = ca.vertsplit(
        numbers, np.cumsum([0, entries_of(states, cuts), len(FORCES), states, states]).tolist()
    )
    level, push = ca.vertsplit(parts)
    forces, y = inputs[:TAPS], inputs[TAPS]
    matrix = ca.reshape(entries[: states * states], states, states)
    inward = ca.reshape(entries[states * states : states * (states + TAPS)], states, TAPS)
    motor = entries[states * (states + TAPS) : states * (states + TAPS + 1)]
    early = entries[states * (states + TAPS + 1) :]
    error = y - ca.dot(output, x)
    corrected = x + gain * error
    alone = matrix @ corrected + inward @ forces + motor * push
    width = states + TAPS + 1
    inside, eases = [], []
    for cut in range(cuts):
        row = early[cut * width : (cut + 1) * width]
        ease = ca.fmax(row[-1], (1 + cut) * _TINY)
        inside.append(ca.dot(row[:states], corrected) + ca.dot(row[states:-1], forces) + ease * push)
        eases.append(ease)
    mean, moment = _friction_of([corrected[1], *inside, alone[1]], [0.0, *eases, motor[1]], matrix[1, 1], level)
    after = alone - motor * mean
    # Early friction displaces more than late friction of the same impulse.
    after[0] -= motor[0] * (moment - mean)
    return ca.Function("sample", [x, inputs, numbers], ca.cse([ca.densify(after), error]))


def _friction_of(speeds: Sequence[Any], eases: Sequence[Any], decay: Any, level: Any) -> tuple[Any, Any]:
    """Return the mean of dry friction over a sample, weighted as in the final velocity, and as in the position."""
    # A resonance may reverse the velocity within a sample: some of it is taken to remain.
    whole, loss = eases[-1], 1 - ca.fmax(decay, 0.05)
    now, mean, moment = speeds[0], 0.0, 0.0
    for before, free, begin, until in zip(speeds[:-1], speeds[1:], eases[:-1], eases[1:], strict=True):
        slower = 1 - loss * begin / whole
        remainder = (1 - loss * until / whole) / slower
        ease = ca.fmax((until - begin) / slower, _TINY)
        change = free - before + (1 - remainder) * (before - now)
        # The velocity keeps its sign, or it reaches zero inside the part, and then friction holds the motor up to its
        # level or releases it in the other direction.
        sign = ca.if_else(now > 0, 1.0, -1.0)
        moving = sign * level
        end = now + change - ease * moving
        rest = ca.fmin(ca.fmax(-sign * end / ca.fmax(sign * (now - end), _TINY), 0.0), 1.0)
        rest = ca.if_else(now == 0, 1.0, rest)
        drive = now + change - remainder * now
        holding = ca.if_else(drive > 0, 1.0, -1.0) * ca.fmin(ca.fabs(drive) / ease, level)
        stop = begin + (until - begin) * (1 - rest)
        weights = [_late(each / whole, loss) for each in (begin, stop, until)]
        for force, one, other in ((moving, *weights[:2]), (holding, *weights[1:])):
            mean += force * (one - other)
            moment += force * (_further(one, loss) - _further(other, loss))
        now += change - ease * (holding + (moving - holding) * (1 - _late(1 - rest, 1 - remainder)))
    return mean, moment


def _late(share: Any, loss: Any) -> Any:
    """Return the share of the weight in the final velocity of a force that acts after this share of the change."""
    return (1 - share) / (1 - loss * share)


def _further(late: Any, loss: Any) -> Any:
    """Return the corresponding weight in the position, to first order in the decay."""
    return late**2 * (1 - loss * (1 - late) * 2 / 3)


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
        row[0, step.output] = 1.0
        # Doubling: `solve_discrete_are` fails where eigenvalues lie near the unit circle, as of a slow observer.
        a, g, h = matrix.T, row.T @ row, np.outer(push, push)
        for _ in range(60):
            inner = np.linalg.inv(np.eye(a.shape[0]) + g @ h)
            more = a.T @ h @ inner @ a
            a, g, h = a @ inner @ a, g + a @ inner @ g @ a.T, h + more
            if np.abs(more).max() <= 1e-14 * np.abs(h).max():
                break
        covariance = h[:, step.output]
        return np.asarray(covariance / (covariance[step.output] + 1.0) / scale, dtype=np.float64)


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
        predictions = []
        for record, log in zip(self.records, self._logs, strict=True):
            # Where each log has a constant force of its own, that takes the place of the common one.
            keys = [FRICTION, offset_of(log) if structure.offsets > 1 else OFFSET]
            forces = [[each.get(key, 0.0) for key in keys] for each in (values, *several)]
            numbers = np.insert(linear, [step.flat().size], np.array(forces), axis=1)
            out = run(*self._initial(step, record, taps), numbers, cuts)
            by = (out[:, 1:] - out[:, :1]) / moves
            predictions.append(Prediction(out[:, 0].copy(), by))
        return predictions

    def _models(
        self, structure: Structure, several: Sequence[Mapping[str, float]], taps: tuple[int, ...], observer: Observer
    ) -> tuple[LinearStep, FloatArray]:
        """Return the first step, and of every model the entries, gain and row that `run` takes around its forces."""
        linear = [0, *(at for at, name in enumerate(structure.names, 1) if at < len(several) and not is_force(name))]
        of_linear = linear_steps([several[at] for at in linear], structure, self.sample_time_s, taps, near=several[0])
        by_place = dict(zip(linear, of_linear, strict=True))
        steps = [by_place.get(at, of_linear[0]) for at in range(len(several))]
        step = steps[0]
        gain = observer.gain(step, several[0]["mass_kg"], self.sample_time_s)
        row = np.eye(len(step.names))[step.output]
        return step, np.array([np.concatenate([one.flat(), gain, row]) for one in steps])

    def _initial(self, step: LinearStep, record: Record, taps: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return the initial state of a record, at rest or in uniform motion, and the inputs of its samples."""
        position = record.position_m - self.origin_m
        size = position.size
        inputs = np.empty((size, len(taps) + 1))
        for at, tap in enumerate(taps):
            inputs[:tap, at] = record.force_n[0]
            inputs[tap:, at] = record.force_n[: size - tap]
        inputs[:, -1] = position
        few = min(size, 40)
        slope, start = np.polyfit(np.arange(few) * self.sample_time_s, position[:few], 1)
        begins = {"_position_m": start, "_velocity_m_per_s": slope, "actuator_force_n": -record.force_n[0]}
        state = [next((value for end, value in begins.items() if name.endswith(end)), 0.0) for name in step.names]
        return np.array(state), inputs
