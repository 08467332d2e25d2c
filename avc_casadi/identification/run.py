"""Simulation of models through a record, side by side: compiled where there is a C compiler, else by CasADi.

Dry friction stops, holds and releases the motor inside a sample. It enters through two numbers only, the mean force
and its moment.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.linear import TAPS, entries_of
from avc_casadi.identification.terms import FORCES
from avc_casadi.simulation.emit import LANES_HEAD, in_lanes
from avc_casadi.simulation.native import compiler, library

_TINY = 1e-30
# Least share of a velocity taken to remain after a sample; a resonance may reverse it.
_LEAST_LEFT = 0.05
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
    entries, parts, gain, measured = ca.vertsplit(
        numbers, np.cumsum([0, entries_of(states, cuts), len(FORCES), states, states]).tolist()
    )
    level, push = ca.vertsplit(parts)
    forces, y = inputs[:TAPS], inputs[TAPS]
    matrix = ca.reshape(entries[: states * states], states, states)
    inward = ca.reshape(entries[states * states : states * (states + TAPS)], states, TAPS)
    motor = entries[states * (states + TAPS) : states * (states + TAPS + 1)]
    early = entries[states * (states + TAPS + 1) :]
    error = y - ca.dot(measured, x)
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


def _friction_of(speeds: Sequence[Any], eases: Sequence[Any], left: Any, level: Any) -> tuple[Any, Any]:
    """Return the mean of dry friction over a sample, weighted as in the final velocity, and as in the position.

    The sample is cut where the newer force arrives and at the other evaluations. A velocity that decays evenly changes
    in proportion to the change by 1 N: that is the clock inside the sample.
    """
    whole, gone = eases[-1], 1 - ca.fmax(left, _LEAST_LEFT)
    now, mean, moment = speeds[0], 0.0, 0.0
    for before, free, begun, done in zip(speeds[:-1], speeds[1:], eases[:-1], eases[1:], strict=True):
        slower = 1 - gone * begun / whole
        kept = (1 - gone * done / whole) / slower
        ease = ca.fmax((done - begun) / slower, _TINY)
        change = free - before + (1 - kept) * (before - now)
        # The velocity keeps its sign, or it reaches zero inside the part, and then friction holds the motor up to its
        # level or releases it in the other direction.
        sign = ca.if_else(now > 0, 1.0, -1.0)
        moving = sign * level
        end = now + change - ease * moving
        rest = ca.fmin(ca.fmax(-sign * end / ca.fmax(sign * (now - end), _TINY), 0.0), 1.0)
        rest = ca.if_else(now == 0, 1.0, rest)
        pushed = now + change - kept * now
        rested = ca.if_else(pushed > 0, 1.0, -1.0) * ca.fmin(ca.fabs(pushed) / ease, level)
        stop = begun + (done - begun) * (1 - rest)
        weights = [_late(each / whole, gone) for each in (begun, stop, done)]
        for force, one, other in ((moving, *weights[:2]), (rested, *weights[1:])):
            mean += force * (one - other)
            moment += force * (_further(one, gone) - _further(other, gone))
        now += change - ease * (rested + (moving - rested) * (1 - _late(1 - rest, 1 - kept)))
    return mean, moment


def _late(share: Any, gone: Any) -> Any:
    """Return the share of the weight in the final velocity of a force that acts after this share of the change."""
    return (1 - share) / (1 - gone * share)


def _further(late: Any, gone: Any) -> Any:
    """Return the corresponding weight in the position, to first order in the decay."""
    return late**2 * (1 - gone * (1 - late) * 2 / 3)
