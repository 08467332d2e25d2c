"""Prediction of the next position from the commanded force, with exact derivatives, sample by sample in CasADi.

The linear part of the loop is that of the device; dry friction is a force on the motor that stops it, holds it and lets
it go inside a sample. An observer of fixed gain keeps the prediction near the log: with no gain the model runs free
(output error), with more of it what the model does not know, a disturbance, is forgotten sooner. In a closed loop the
prediction error stays free of bias where the gain fits the disturbance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi.identification._linear import TAPS, LinearStep, linear_derivatives, linear_step, taps_of
from avc_casadi.identification._record import Record
from avc_casadi.identification._terms import FRICTION, LINEAR, Structure
from avc_casadi.scene import NativeScene, compiler
from avc_casadi.support import FloatArray

_LEVEL = FRICTION.index("coulomb_friction_n")
_ASYMMETRY = FRICTION.index("damping_asymmetry_ns_per_m")
_EXCESS = FRICTION.index("breakaway_excess_n")
_SPEED = FRICTION.index("stribeck_speed_m_per_s")
_OFFSET = FRICTION.index("offset_n")
_DRIFT = FRICTION.index("offset_drift_n_per_s")
# Parameters of the linear part at most, by the number of states: an amplifier has one, a handle two states.
_MOST_LINEAR = {2: 5, 3: 6, 4: 8, 5: 9}
# Samples after which a function that runs on is compiled.
_WORTH_COMPILING = 200_000
_COMPILED: set[tuple[int, int]] = set()
_TINY = 1e-30
_MOST_DOUBLINGS = 60
_CLOSE = 1e-3
_HALF_ROOT_PI = math.sqrt(math.pi) / 2


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a model says of one record.

    Attributes:
        error_m: measured less predicted position, shape (samples,).
        slopes: derivative of the error by the coordinates of the search, shape (samples, free), or None.
    """

    error_m: FloatArray
    slopes: FloatArray | None


@dataclass(frozen=True, eq=False)
class Observer:
    """How fast what is not known is forgotten.

    Attributes:
        rate_per_s: bandwidth for a mass alone: the square root of the disturbance's acceleration over the noise.
    """

    rate_per_s: float

    def gain(self, step: LinearStep, mass_kg: float, period: float) -> tuple[FloatArray, float]:
        """Return the gain of the observer for a white disturbance at the motor, and the share of noise in the error.

        Args:
            step: the linear part.
            mass_kg: of the device.
            period: T.
        """
        # Velocities in metres a sample and forces in what moves the mass a metre in a sample balance the equation.
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


def _friction(before: Any, free: Any, ease: Any, parts: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return dry friction over a part of a sample: while moving, from rest on, and the share from rest on.

    The velocity is taken to change evenly: it keeps its sign, or it ends inside the sample, and then friction holds the
    motor up to its level or lets it go the other way. The level is the mean over the velocities passed.

    Args:
        before: velocity at the start, m/s.
        free: velocity at the end without friction.
        ease: change of velocity by 1 N of friction over that time.
        parts: numbers of FRICTION.
    """
    sign = ca.if_else(before > 0, 1.0, -1.0)
    still = parts[_LEVEL] + parts[_EXCESS]
    guess = ca.fmax(sign * (free - sign * ease * _level(before, before, parts)), 0.0)
    level = _level(before, sign * guess, parts)
    after = free - sign * ease * level
    rest = ca.fmin(ca.fmax(-sign * after / ca.fmax(sign * (before - after), _TINY), 0.0), 1.0)
    held = _held(free - before, ease, still, parts)
    at_rest = before == 0
    return sign * level, ca.if_else(at_rest, _held(free, ease, still, parts), held), ca.if_else(at_rest, 1.0, rest)


def _held(change: Any, ease: Any, still: Any, parts: Sequence[Any]) -> Any:
    """Return friction from rest: what holds, or the level of the motion that begins."""
    away = ca.if_else(change > 0, 1.0, -1.0)
    going = ca.fmax(away * change - ease * still, 0.0)
    return away * ca.fmin(away * change / ease, _level(0.0, going, parts))


def _level(one: Any, other: Any, parts: Sequence[Any]) -> Any:
    """Return the mean level of friction over the velocities between two, N."""
    slow = parts[_SPEED]
    apart = other - one
    few = ca.fabs(apart) < _CLOSE * slow
    over = ca.if_else(few, 1.0, apart)
    middle = (one + other) / 2
    mean = slow * _HALF_ROOT_PI * (ca.erf(other / slow) - ca.erf(one / slow)) / over
    return parts[_LEVEL] + parts[_EXCESS] * ca.if_else(few, ca.exp(-((middle / slow) ** 2)), mean)


@lru_cache(maxsize=64)
def _step_function(states: int, free: tuple[int, ...], linear: int, measured: int, slopes: bool) -> Any:
    """Return one sample as a CasADi function of state and sensitivities, inputs and the numbers of the model.

    Args:
        states: number n of states.
        free: index in FRICTION of each free parameter of friction.
        linear: number of free parameters of the linear part.
        measured: index of the measured position.
        slopes: whether the sensitivities are carried along.
    """
    taps = TAPS
    x = ca.SX.sym("x", states)
    forces, y, time = ca.SX.sym("u", taps), ca.SX.sym("y"), ca.SX.sym("t")
    plain = states * states + states * taps + states
    count = plain + states + taps + 1
    entries = ca.SX.sym("entries", count)
    by_linear = ca.SX.sym("by_linear", count, linear)
    friction = ca.SX.sym("friction", len(FRICTION))
    gain = ca.SX.sym("gain", states)
    p = ca.SX.sym("p", linear + len(free))
    moved = entries + by_linear @ p[:linear] if slopes and linear else entries
    parts = [friction[index] for index in range(len(FRICTION))]
    if slopes:
        for at, index in enumerate(free):
            parts[index] = parts[index] + p[linear + at]
    matrix = ca.reshape(moved[: states * states], states, states)
    inward = ca.reshape(moved[states * states : states * (states + taps)], states, taps)
    motor = moved[states * (states + taps) : plain]
    early = moved[plain:]

    error = y - x[measured]
    corrected = x + gain * error
    speed = corrected[1]
    push = parts[_OFFSET] + parts[_DRIFT] * time - parts[_ASYMMETRY] * ca.fabs(speed)
    alone = matrix @ corrected + inward @ forces + motor * push
    # The sample has two parts, before and after the newer force arrives: within each the velocity changes evenly.
    ease = ca.fmax(early[states + taps], _TINY)
    halfway = ca.dot(early[:states], corrected) + ca.dot(early[states : states + taps], forces) + ease * push
    one = _friction(speed, halfway, ease, parts)
    first = (1 - one[2]) * one[0] + one[2] * one[1]
    turned = halfway - ease * first
    two = _friction(turned, turned + alone[1] - halfway, ca.fmax(motor[1] - ease, _TINY), parts)
    second = (1 - two[2]) * two[0] + two[2] * two[1]
    share = ease / motor[1]
    mean = share * first + (1 - share) * second
    # Early friction moves the position further than late friction of the same impulse.
    ends = (0.0, share * (1 - one[2]), share, share + (1 - share) * (1 - two[2]), 1.0)
    forces_in = (one[0], one[1], two[0], two[1])
    moment = sum(
        force * ((end - begin) * (2 - end - begin))
        for force, begin, end in zip(forces_in, ends[:-1], ends[1:], strict=True)
    )
    after = alone - motor * mean
    after[0] -= motor[0] * (moment - mean)
    if not slopes:
        arguments = [x, ca.vertcat(forces, y, time), ca.vertcat(entries, friction, gain)]
        return ca.Function("sample", arguments, [after, error])
    sensitivity = ca.SX.sym("s", states, linear + len(free))
    by_state, by_parameter = ca.jacobian(after, x), ca.jacobian(after, p)
    nothing = ca.DM.zeros(p.shape)
    after, by_state, by_parameter = ca.substitute([after, by_state, by_parameter], [p], [nothing])
    following = by_state @ sensitivity + by_parameter
    arguments = [
        ca.vertcat(x, ca.vec(sensitivity)),
        ca.vertcat(forces, y, time),
        ca.vertcat(entries, friction, gain, ca.vec(by_linear)),
    ]
    return ca.Function(
        "sample", arguments, [ca.vertcat(after, ca.vec(following)), ca.vertcat(error, -sensitivity[measured, :].T)]
    )


class Predictor:
    """Predicts the records of one device with models of it.

    Args:
        records: of the device, all with one sample time.
        origin_m: position taken as 0.
    """

    def __init__(self, records: Sequence[Record], origin_m: float) -> None:
        self.records = tuple(records)
        self.sample_time_s = records[0].sample_time_s
        self._interpreted: dict[tuple[int, int], int] = {}
        self._positions = [np.ascontiguousarray(record.position_m - origin_m) for record in records]

    def predict(
        self, structure: Structure, search: FloatArray, observer: Observer, *, slopes: bool = True
    ) -> list[Prediction]:
        """Predict every record.

        Args:
            structure: terms of the model.
            search: coordinates of its free parameters.
            observer: how fast a disturbance is forgotten.
            slopes: whether derivatives are wanted; the observer's gain counts as constant in them.
        """
        values = structure.values(search)
        taps = taps_of(values)
        outward = structure.slopes(search)
        free = structure.free
        linear = [index for index, one in enumerate(free) if one.name in LINEAR]
        rough = [index for index, one in enumerate(free) if one.name in FRICTION]
        found = []
        models: dict[float, tuple[LinearStep, FloatArray, FloatArray]] = {}
        for record, position in zip(self.records, self._positions, strict=True):
            if record.added_mass_kg not in models:
                whole = {**values, "mass_kg": values["mass_kg"] + record.added_mass_kg}
                step = linear_step(whole, structure, self.sample_time_s, taps)
                gain, _ = observer.gain(step, whole["mass_kg"], self.sample_time_s)
                by_linear = (
                    linear_derivatives(whole, structure, self.sample_time_s, taps)
                    if slopes and linear
                    else np.zeros((step.flat().size, 0))
                )
                models[record.added_mass_kg] = (step, gain, by_linear)
            step, gain, by_linear = models[record.added_mass_kg]
            friction = np.array([values[name] for name in FRICTION])
            numbers = np.concatenate([step.flat(), friction, gain])
            kind = (len(step.names), step.measured)
            program = self._program(kind, position.size)
            if program is None:
                which = tuple(FRICTION.index(free[index].name) for index in rough) if slopes else ()
                if slopes:
                    numbers = np.concatenate([numbers, by_linear.ravel(order="F")])
                function = _step_function(len(step.names), which, len(linear) if slopes else 0, step.measured, slopes)
                state, inputs = _begun(step, record, position, taps, function.size1_in(0))
                out = _interpreted(function, state, inputs, numbers)
            else:
                # One compiled function for all models of a size; what is not searched for has no derivative.
                most = program.linear
                whole_linear = np.zeros((step.flat().size, most))
                whole_linear[:, : by_linear.shape[1]] = by_linear
                state, inputs = _begun(step, record, position, taps, program.states)
                out = program.run(state, inputs, np.concatenate([numbers, whole_linear.ravel(order="F")]))
                columns = [*range(1, 1 + len(linear)), *(1 + most + FRICTION.index(free[at].name) for at in rough)]
                out = out[:, [0, *columns]] if slopes else out[:, :1]
            by = None
            if slopes:
                by = np.empty((out.shape[0], len(free)))
                by[:, linear + rough] = out[:, 1:] * outward[linear + rough]
            found.append(Prediction(out[:, 0].copy(), by))
        return found

    def _program(self, kind: tuple[int, int], samples: int) -> _Program | None:
        """Return the compiled function of models of a size, once so much was interpreted that compiling pays."""
        done = self._interpreted.get(kind, 0) + samples
        self._interpreted[kind] = done
        if done < _WORTH_COMPILING and not _COMPILED & {kind}:
            return None
        if compiler() is None:
            return None
        _COMPILED.add(kind)
        return _compiled(*kind)


@dataclass(frozen=True)
class _Sampled:
    """A sample function as `NativeScene` takes it."""

    function: Any

    def split(self) -> None:
        """Say that the function is a whole sample."""


class _Program:
    """A compiled sample function."""

    def __init__(self, function: Any, linear: int) -> None:
        sampled: Any = _Sampled(function)
        self.states = int(function.size1_in(0))
        self.linear = linear
        self._native = NativeScene(sampled)

    def run(self, state: FloatArray, inputs: FloatArray, numbers: FloatArray) -> FloatArray:
        """Return the second output of every sample."""
        return np.asarray(self._native(state, inputs, numbers[None], 1)[0])


@lru_cache(maxsize=16)
def _compiled(states: int, measured: int) -> _Program:
    most = _MOST_LINEAR[states]
    return _Program(_step_function(states, tuple(range(len(FRICTION))), most, measured, True), most)


def _interpreted(function: Any, state: FloatArray, inputs: FloatArray, numbers: FloatArray) -> FloatArray:
    """Run a sample function by CasADi's own evaluation."""
    columns = function.size1_out(1)
    after, now, out = np.empty_like(state), np.empty(inputs.shape[1]), np.empty(columns)
    buffer, evaluate = function.buffer()
    given: Any = (state, now, np.ascontiguousarray(numbers))
    taken: Any = (after, out)
    for index, array in enumerate(given):
        buffer.set_arg(index, memoryview(array))
    for index, array in enumerate(taken):
        buffer.set_res(index, memoryview(array))
    results = np.empty((len(inputs), columns))
    for k in range(len(inputs)):
        now[:] = inputs[k]
        evaluate()
        results[k] = out
        state[:] = after
    return results


def _begun(
    step: LinearStep, record: Record, position: FloatArray, taps: tuple[int, ...], states: int
) -> tuple[FloatArray, FloatArray]:
    """Return the state at the start of a record, at rest or moving evenly as a whole, and the inputs of its samples."""
    size, period = position.size, record.sample_time_s
    inputs = np.empty((size, len(taps) + 2))
    for at, tap in enumerate(taps):
        inputs[:tap, at] = record.force_n[0]
        inputs[tap:, at] = record.force_n[: size - tap]
    inputs[:, -2] = position
    inputs[:, -1] = np.arange(size) * period
    few = min(size, 40)
    slope, start = np.polyfit(np.arange(few) * period, position[:few], 1)
    state = np.zeros(states)
    for index, name in enumerate(step.names):
        if name.endswith("_position_m"):
            state[index] = start
        elif name.endswith("_velocity_m_per_s"):
            state[index] = slope
        elif name == "actuator_force_n":
            state[index] = -record.force_n[0]
    return state, inputs
