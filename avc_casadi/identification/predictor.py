"""One-step-ahead prediction of the position from the commanded force, with its slopes.

The linear part of the loop is the exact discretisation of the device; dry friction is a force on the motor that stops,
holds and releases it inside a sample, where it enters by two numbers only, the mean force and its moment. An observer
of fixed gain keeps the prediction near the log: without gain the model runs free (output error), with a larger gain an
unmodelled disturbance is forgotten sooner. Models run side by side: compiled where there is a C compiler, else by
CasADi.

`linear_step` says what a cut and a mobility are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.linear_step import (
    MOTOR_POSITION,
    MOTOR_VELOCITY,
    PARTS,
    TAPS,
    LinearStep,
    entries_of,
    linear_steps,
    perturbed,
    taps_of,
)
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import FORCES, FRICTION, OFFSET, ModelStructure, is_force, offset_of
from avc_casadi.simulation.emit import LANES_HEAD, in_lanes
from avc_casadi.simulation.execute import compiler, library

_TINY = 1e-30
"""Stands for 0 in a divisor, and for no mobility."""
_LEAST_DECAY = 0.05
"""A resonance may reverse the velocity within a sample: this share of it is taken to remain."""
_MOST_DOUBLINGS = 60
"""Doublings of the Riccati equation: the last would be sample 2^60."""
_CONVERGED = 1e-14
"""Share of the covariance below which a doubling ends it."""
_FIRST_SAMPLES = 40
"""Samples from whose line the initial position and velocity of a record are taken."""

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
      const long long model = first + lane < models ? first + lane : models - 1;
      for (int i = 0; i < {numbers}; ++i) numbers[i][lane] = all[model * {numbers} + i];
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
    """Return the prediction error of every sample and model, shape (samples, models).

    Args:
        state: initial state of every model, (states,).
        inputs: of every sample, its forces by tap and its measured position, (samples, taps + 1).
        numbers: of every model, as `sample` takes them, (models, numbers).
        cuts: instants of a sample at which the velocity is evaluated.
    """
    state = np.array(state, dtype=np.float64, order="C")
    inputs = np.array(inputs, dtype=np.float64, order="C")
    numbers = np.array(numbers, dtype=np.float64, order="C")
    if compiler() is None:
        through = sample(state.size, cuts).mapaccum("through", len(inputs))
        return np.array([np.asarray(through(state, inputs.T, of_model)[1]).ravel() for of_model in numbers]).T
    errors = np.empty((len(inputs), len(numbers)))
    pointers = (array.ctypes.data for array in (state, inputs, numbers, errors))
    _native(state.size, cuts)(len(inputs), len(numbers), *pointers)
    return errors


@lru_cache(maxsize=16)
def _native(states: int, cuts: int) -> Callable[..., int]:
    """Return the compiled C loop of one-step predictions over samples and models, by states and cuts of a sample."""
    function = sample(states, cuts)
    body = in_lanes(function, ("x[{}]", "SPREAD(inputs[{}])", "numbers[{}]"), ("next[{}]", "error[{}]"))
    source = _LOOP.format(
        head=LANES_HEAD,
        body=body,
        states=function.numel_in(0),
        inputs=function.numel_in(1),
        numbers=function.numel_in(2),
    )
    loop = library(source).avc_run
    loop.restype = ctypes.c_int
    loop.argtypes = [ctypes.c_longlong, ctypes.c_longlong] + [ctypes.c_void_p] * 4
    result: Callable[..., int] = loop
    return result


@lru_cache(maxsize=16)
def sample(states: int, cuts: int) -> Any:
    """Return a sample as a CasADi function: state, inputs, numbers -> next state, error.

    Numbers are the entries of a `LinearStep`, the level of dry friction and the constant force, N, the gain of the
    observer, and the row of the output.
    """
    x = ca.SX.sym("x", states)
    inputs = ca.SX.sym("inputs", TAPS + 1)
    sizes = [entries_of(states, cuts), len(FORCES), states, states]
    numbers = ca.SX.sym("numbers", sum(sizes))
    entries, motor_forces, gain, output = ca.vertsplit(numbers, np.cumsum([0, *sizes]).tolist())
    level, constant = ca.vertsplit(motor_forces)
    forces, position = inputs[:TAPS], inputs[TAPS]
    matrix = ca.reshape(entries[: states * states], states, states)
    by_forces = ca.reshape(entries[states * states : states * (states + TAPS)], states, TAPS)
    motor = entries[states * (states + TAPS) : states * (states + TAPS + 1)]
    cut_rows = entries[states * (states + TAPS + 1) :]
    error = position - ca.dot(output, x)
    corrected = x + gain * error
    without_friction = matrix @ corrected + by_forces @ forces + motor * constant
    width = states + TAPS + 1
    velocities, mobilities = [], []
    for cut in range(cuts):
        row = cut_rows[cut * width : (cut + 1) * width]
        mobility = ca.fmax(row[-1], (1 + cut) * _TINY)
        by_state = ca.dot(row[:states], corrected)
        velocities.append(by_state + ca.dot(row[states:-1], forces) + mobility * constant)
        mobilities.append(mobility)
    friction = _friction_of(
        [corrected[MOTOR_VELOCITY], *velocities, without_friction[MOTOR_VELOCITY]],
        [0.0, *mobilities, motor[MOTOR_VELOCITY]],
        matrix[MOTOR_VELOCITY, MOTOR_VELOCITY],
        level,
    )
    after = without_friction - motor * friction.mean
    # Early friction displaces more than late friction of the same impulse.
    after[MOTOR_POSITION] -= motor[MOTOR_POSITION] * (friction.moment - friction.mean)
    return ca.Function("sample", [x, inputs, numbers], ca.cse([ca.densify(after), error]))


@dataclass(frozen=True, eq=False)
class _Friction:
    """Means of dry friction over a sample, N: weighted as in the final velocity, and as in the position."""

    mean: Any
    moment: Any


def _friction_of(velocities: Sequence[Any], mobilities: Sequence[Any], decay: Any, level: Any) -> _Friction:
    """Return the dry friction of a sample.

    `velocities` are those that the motor would have without friction, and `mobilities` the velocity that a unit of
    friction takes from it, at the beginning, at each cut and at the end. `decay` is the share of a velocity that
    remains after the sample, and `level` the friction of a motor that moves.

    Between two cuts the velocity v moves under a constant drive and its own friction -level sign(v). It keeps its sign,
    or it reaches zero inside the interval, and then friction holds the motor up to its level or releases it in the
    other direction.

    A force weighs in the final velocity by the mobility that is left when it acts: mobility is the clock here, and all
    shares (`_late`, `_held_share`) are shares of it.
    """
    whole = mobilities[-1]
    loss = 1 - ca.fmax(decay, _LEAST_DECAY)
    velocity = velocities[0]
    mean = 0.0
    moment = 0.0
    intervals = zip(velocities[:-1], velocities[1:], mobilities[:-1], mobilities[1:], strict=True)
    for free_before, free_after, begin, end in intervals:
        remaining_before = 1 - loss * begin / whole
        # Of this interval alone: the share of a velocity that remains after it, and its mobility.
        remaining = (1 - loss * end / whole) / remaining_before
        mobility = ca.fmax((end - begin) / remaining_before, _TINY)
        change = free_after - free_before + (1 - remaining) * (free_before - velocity)
        moving = ca.if_else(velocity > 0, 1.0, -1.0) * level
        held = _held_share(velocity, velocity + change - mobility * moving)
        drive = velocity + change - remaining * velocity
        holding = ca.if_else(drive > 0, 1.0, -1.0) * ca.fmin(ca.fabs(drive) / mobility, level)
        stop = begin + (end - begin) * (1 - held)
        late_begin, late_stop, late_end = (_late(instant / whole, loss) for instant in (begin, stop, end))
        mean += moving * (late_begin - late_stop)
        moment += moving * (_further(late_begin, loss) - _further(late_stop, loss))
        mean += holding * (late_stop - late_end)
        moment += holding * (_further(late_stop, loss) - _further(late_end, loss))
        velocity += change - mobility * (holding + (moving - holding) * (1 - _late(1 - held, 1 - remaining)))
    return _Friction(mean, moment)


def _held_share(velocity: Any, end: Any) -> Any:
    """Return the share of an interval that is left once the motor stops, where friction alone would bring it to `end`.

    Shares are those of the mobility: 0 for a motor that keeps its sign, 1 for one that stands from the beginning.
    """
    sign = ca.if_else(velocity > 0, 1.0, -1.0)
    beyond_stop = -sign * end / ca.fmax(sign * (velocity - end), _TINY)
    return ca.if_else(velocity == 0, 1.0, ca.fmin(ca.fmax(beyond_stop, 0.0), 1.0))


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
class SteadyObserver:
    """Observer of a random disturbance; its rate is its bandwidth for a mass alone."""

    rate_per_s: float

    def gain(self, step: LinearStep, mass_kg: float, period_s: float) -> FloatArray:
        """Return the gain of the observer for a white disturbance at the motor, shape (states,).

        The covariance P of the predicted state solves P = A P A' - A P c (1 + c'P c)^-1 c'P A' + g g' m^2 rate^4 with
        readings of unit variance, and the gain is P c/(1 + c'P c).
        """
        # With velocities in metres per sample and forces as accelerations in metres per sample squared the equation is
        # balanced.
        scale = np.array([_scale(name, mass_kg, period_s) for name in step.names])
        matrix = step.matrix * scale[:, None] / scale
        disturbance = step.motor * scale * mass_kg * self.rate_per_s**2
        covariance = _riccati(matrix, step.output, disturbance)[:, step.output]
        return np.asarray(covariance / (covariance[step.output] + 1.0) / scale, dtype=np.float64)


def _riccati(matrix: FloatArray, output: int, disturbance: FloatArray) -> FloatArray:
    """Return the covariance of the predicted state, shape (states, states).

    By doubling: `solve_discrete_are` fails where eigenvalues lie near the unit circle, as of a slow observer. With
    W = (1 + G H)^-1 a step is A <- A W A, G <- G + A W G A', H <- H + A'H W A, and H tends to the covariance.
    """
    row = np.zeros((1, len(matrix)))
    row[0, output] = 1.0
    a = matrix.T
    g = row.T @ row
    h = np.outer(disturbance, disturbance)
    for _ in range(_MOST_DOUBLINGS):
        inner = np.linalg.inv(np.eye(a.shape[0]) + g @ h)
        more = a.T @ h @ inner @ a
        a, g, h = a @ inner @ a, g + a @ inner @ g @ a.T, h + more
        if np.abs(more).max() <= _CONVERGED * np.abs(h).max():
            break
    return np.asarray(h)


def _scale(name: str, mass_kg: float, period_s: float) -> float:
    """Return the factor that balances a state: samples in place of seconds, accelerations in place of forces."""
    if name.startswith("actuator"):
        return period_s**2 / mass_kg * (period_s if name.endswith("_per_s") else 1.0)
    return period_s if name.endswith("_m_per_s") else 1.0


class Predictor:
    """Predicts the records of one device, all with one sample time, with models of it."""

    def __init__(self, records: Sequence[Record], whole: Predictor | None = None) -> None:
        self.records = tuple(records)
        self.sample_time_s = records[0].sample_time_s
        # Of pieces, logs and origin are those of the whole.
        log_names = tuple(dict.fromkeys(record.whole for record in records))
        self.names: tuple[str, ...] = whole.names if whole else log_names
        self.origin_m: float = whole.origin_m if whole else float(records[0].position_m[0])
        self._logs = [self.names.index(record.whole) for record in records]

    def predict(
        self, structure: ModelStructure, search: FloatArray, observer: SteadyObserver, *, slopes: bool = True
    ) -> list[Prediction]:
        """Predict every record; the observer's gain counts as constant in the derivatives."""
        values = structure.values(search)
        moved_models, moves = perturbed(values, structure) if slopes else ([], np.zeros(0))
        models = [values, *moved_models]
        taps = taps_of(values)
        cuts = PARTS if structure.present("amplifier_bandwidth_hz") else 1
        step, linear = self._models(structure, models, taps, observer)
        predictions = []
        for record, log in zip(self.records, self._logs, strict=True):
            # Where each log has a constant force of its own, that takes the place of the common one.
            keys = [FRICTION, offset_of(log) if structure.offsets > 1 else OFFSET]
            forces = [[model.get(key, 0.0) for key in keys] for model in models]
            numbers = np.insert(linear, [step.flat().size], np.array(forces), axis=1)
            errors = run(*self._initial(step, record, taps), numbers, cuts)
            differences = (errors[:, 1:] - errors[:, :1]) / moves
            predictions.append(Prediction(errors[:, 0].copy(), differences))
        return predictions

    def _models(
        self,
        structure: ModelStructure,
        models: Sequence[Mapping[str, float]],
        taps: tuple[int, ...],
        observer: SteadyObserver,
    ) -> tuple[LinearStep, FloatArray]:
        """Return the first step, and of every model the entries, gain and row that `run` takes around its forces."""
        # Models that differ from the first by a force alone have its linear part.
        moved = structure.names[: len(models) - 1]
        linear = [0, *(model for model, name in enumerate(moved, 1) if not is_force(name))]
        linear_models = [models[model] for model in linear]
        steps = dict(
            zip(
                linear,
                linear_steps(linear_models, structure, self.sample_time_s, taps, reference=models[0]),
                strict=True,
            )
        )
        first = steps[0]
        gain = observer.gain(first, models[0]["mass_kg"], self.sample_time_s)
        row = np.eye(len(first.names))[first.output]
        numbers = [np.concatenate([steps.get(model, first).flat(), gain, row]) for model in range(len(models))]
        return first, np.array(numbers)

    def _initial(self, step: LinearStep, record: Record, taps: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return the initial state of a record, at rest or in uniform motion, and the inputs of its samples."""
        position = record.position_m - self.origin_m
        size = position.size
        inputs = np.empty((size, len(taps) + 1))
        for column, tap in enumerate(taps):
            inputs[:tap, column] = record.force_n[0]
            inputs[tap:, column] = record.force_n[: size - tap]
        inputs[:, -1] = position
        first_samples = min(size, _FIRST_SAMPLES)
        times_s = np.arange(first_samples) * self.sample_time_s
        velocity, start = np.polyfit(times_s, position[:first_samples], 1)
        begins = {"_position_m": start, "_velocity_m_per_s": velocity, "actuator_force_n": -record.force_n[0]}
        state = [next((value for ending, value in begins.items() if name.endswith(ending)), 0.0) for name in step.names]
        return np.array(state), inputs
