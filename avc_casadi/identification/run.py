"""Simulation of a model through a record: compiled where there is a C compiler, else evaluated by CasADi.

One sample of a model as CasADi functions: the next state, the prediction error, and their exact derivatives.

Dry friction stops, holds and releases the motor inside the sample. It enters through two numbers only, the mean force
and its moment; their gradient is computed once a sample, and each free parameter then costs products with the matrices
of the linear part.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.linear import TAPS, entries_of
from avc_casadi.identification.terms import DRAG, FRICTION
from avc_casadi.simulation.emit import LANES_HEAD, in_lanes
from avc_casadi.simulation.native import compiler, library

_LEVEL = FRICTION.index("coulomb_friction_n")
_ASYMMETRY = FRICTION.index("damping_asymmetry_ns_per_m")
_EXCESS = FRICTION.index("breakaway_excess_n")
_SPEED = FRICTION.index("stribeck_speed_m_per_s")
_DRAG = FRICTION.index(DRAG)
_OFFSET = FRICTION.index("offset_n")
_DRIFT = FRICTION.index("offset_drift_n_per_s")
_TINY = 1e-30
# Least share of a velocity taken to remain after a sample; a resonance may reverse it.
_LEAST_LEFT = 0.05
_CLOSE = 1e-3
_HALF_ROOT_PI = math.sqrt(math.pi) / 2


@dataclass(frozen=True, eq=False)
class Sample:
    """One sample of a model of n states.

    Attributes:
        plain: state, inputs (the forces of the taps, measured position, time), parameters (entries of the linear part,
            friction, gain of the observer, index of the measured state) -> next state, error.
        seen: the same -> next state, error and the friction terms of the slopes.
        slope: derivative of the state by one parameter, that of the numbers by it, state, inputs, numbers, the second
            output of `seen` -> derivative of the next state, of the error.
    """

    plain: Any
    seen: Any
    slope: Any


@lru_cache(maxsize=16)
def sample(states: int, cuts: int, stribeck: bool) -> Sample:
    """Return the functions of a sample of n states, with so many evaluations of the velocity inside it."""
    count = entries_of(states, cuts)
    x, inputs = ca.SX.sym("x", states), ca.SX.sym("inputs", TAPS + 2)
    entries, parts = ca.SX.sym("entries", count), ca.SX.sym("friction", len(FRICTION))
    gain, measured = ca.SX.sym("gain", states), ca.SX.sym("measured", states)
    numbers = ca.vertcat(entries, parts, gain, measured)
    friction = ca.SX.sym("mean and moment", 2)

    forces, y, time = inputs[:TAPS], inputs[TAPS], inputs[TAPS + 1]
    matrix = ca.reshape(entries[: states * states], states, states)
    inward = ca.reshape(entries[states * states : states * (states + TAPS)], states, TAPS)
    motor = entries[states * (states + TAPS) : states * (states + TAPS + 1)]
    early = entries[states * (states + TAPS + 1) :]
    error = y - ca.dot(measured, x)
    corrected = x + gain * error
    speed = corrected[1]
    driven = matrix @ corrected + inward @ forces
    push = parts[_OFFSET] + parts[_DRIFT] * time - parts[_ASYMMETRY] * ca.fabs(speed)
    # Drag is that at the mean speed of the sample, which friction and drag slow by half of what they do until its end.
    middle = (speed + driven[1]) / 2
    slower = ca.fmax(ca.fabs(middle) - motor[1] / 2 * (parts[_LEVEL] + parts[_DRAG] * middle**2), 0.0)
    middle = ca.sign(middle) * slower + motor[1] / 2 * push
    push -= parts[_DRAG] * middle * ca.fabs(middle)
    alone = driven + motor * push
    width = states + TAPS + 1
    inside, eases = [], []
    for cut in range(cuts):
        row = early[cut * width : (cut + 1) * width]
        ease = ca.fmax(row[-1], (1 + cut) * _TINY)
        inside.append(ca.dot(row[:states], corrected) + ca.dot(row[states:-1], forces) + ease * push)
        eases.append(ease)
    moved = ca.vertcat(
        speed, *inside, alone[1], *eases, motor[1], matrix[1, 1], parts[_LEVEL], parts[_EXCESS], parts[_SPEED]
    )
    after = alone - motor * friction[0]
    # Early friction displaces more than late friction of the same impulse.
    after[0] -= motor[0] * (friction[1] - friction[0])

    given = ca.SX.sym("moved", moved.numel())
    through = ca.vertcat(*_friction_of(ca.vertsplit(given), cuts, stribeck=stribeck))
    # Common subexpressions of the loop over the parts are evaluated once.
    both = ca.cse([through, ca.densify(ca.jacobian(through, given))])
    value, by_moved = ca.Function("gradient", [given], both)(moved)
    held = ca.substitute(after, friction, value)

    direction, of_state = ca.SX.sym("direction", numbers.numel()), ca.SX.sym("s", states)
    kept = ca.SX.sym("kept", 3 + by_moved.numel())
    where, along = ca.vertcat(x, numbers), ca.vertcat(of_state, direction)
    change = ca.reshape(kept[3:], *by_moved.shape) @ ca.jtimes(moved, where, along)
    following = ca.jtimes(after, ca.vertcat(where, friction), ca.vertcat(along, change))
    following = ca.substitute(following, friction, kept[1:3])
    arguments = [x, inputs, numbers]
    return Sample(
        ca.Function("plain", arguments, [held, error]),
        ca.Function("seen", arguments, [held, ca.vertcat(error, value, ca.vec(by_moved))]),
        ca.Function("slope", [of_state, direction, *arguments, kept], [following, ca.jtimes(error, where, along)]),
    )


def _friction_of(moved: Sequence[Any], cuts: int, *, stribeck: bool) -> tuple[Any, Any]:
    """Return the mean of dry friction over a sample, weighted as in the final velocity, and as in the position.

    The sample is cut where the newer force arrives and at the other evaluations. A velocity that decays evenly changes
    in proportion to the change by 1 N: that is the clock inside the sample.

    Args:
        moved: velocity at the start, and without friction at the cuts and at the end; change of velocity by 1 N of
            friction until each cut and over the sample; the share of a velocity that remains after the sample; the
            parameters of friction.
        cuts: of the sample.
        stribeck: whether friction depends on the velocity.
    """
    speeds, eases, left, law = moved[: cuts + 2], (0.0, *moved[cuts + 2 : -4]), moved[-4], moved[-3:]
    level, excess, slow = law
    of_motion = _Law(level, excess if stribeck else 0.0, slow if stribeck else None)
    whole, gone = eases[-1], 1 - ca.fmax(left, _LEAST_LEFT)
    now, mean, moment = speeds[0], 0.0, 0.0
    for before, free, begun, done in zip(speeds[:-1], speeds[1:], eases[:-1], eases[1:], strict=True):
        slower = 1 - gone * begun / whole
        kept = (1 - gone * done / whole) / slower
        ease = ca.fmax((done - begun) / slower, _TINY)
        change = free - before + (1 - kept) * (before - now)
        moving, rested, rest = _part(now, now + change, ease, kept, of_motion)
        stop = begun + (done - begun) * (1 - rest)
        weights = [_late(each / whole, gone) for each in (begun, stop, done)]
        for force, one, other in ((moving, *weights[:2]), (rested, *weights[1:])):
            mean += force * (one - other)
            moment += force * (_further(one, gone) - _further(other, gone))
        now += change - ease * (rested + (moving - rested) * (1 - _late(1 - rest, 1 - kept)))
    return mean, moment


def _late(share: Any, gone: Any) -> Any:
    """Return the share of the weight in the final velocity of a force that acts from some instant on.

    Args:
        share: of the change by 1 N that has passed by then.
        gone: share of a velocity that has decayed over the whole.
    """
    return (1 - share) / (1 - gone * share)


def _further(late: Any, gone: Any) -> Any:
    """Return the corresponding weight in the position, to first order in the decay."""
    return late**2 * (1 - gone * (1 - late) * 2 / 3)


@dataclass(frozen=True, eq=False)
class _Law:
    """Dry friction: Coulomb level, excess at breakaway, and the Stribeck speed (or None)."""

    coulomb: Any
    excess: Any
    slow: Any

    def level(self, one: Any, other: Any) -> Any:
        """Return the mean level over the velocities between two, N."""
        if self.slow is None:
            return self.coulomb
        apart = other - one
        few = ca.fabs(apart) < _CLOSE * self.slow
        over = ca.if_else(few, 1.0, apart)
        middle = (one + other) / 2
        mean = self.slow * _HALF_ROOT_PI * (ca.erf(other / self.slow) - ca.erf(one / self.slow)) / over
        return self.coulomb + self.excess * ca.if_else(few, ca.exp(-((middle / self.slow) ** 2)), mean)

    def held(self, change: Any, ease: Any) -> Any:
        """Return friction at breakaway: the holding force, or the level of the motion that begins."""
        away = ca.if_else(change > 0, 1.0, -1.0)
        going = ca.fmax(away * change - ease * (self.coulomb + self.excess), 0.0)
        return away * ca.fmin(away * change / ease, self.level(0.0, going))


def _part(before: Any, free: Any, ease: Any, kept: Any, law: _Law) -> Sequence[Any]:
    """Return dry friction over a part of a sample: sliding, after sticking, and the share after sticking.

    The velocity keeps its sign, or it reaches zero inside the part, and then friction holds the motor up to its level
    or releases it in the other direction. The level is the mean over the velocities passed.

    Args:
        before: velocity at the start, m/s.
        free: velocity at the end without friction.
        ease: change of velocity by 1 N of friction over that time.
        kept: share of a velocity that remains at the end.
        law: of friction.
    """
    sign = ca.if_else(before > 0, 1.0, -1.0)
    guess = ca.fmax(sign * (free - sign * ease * law.level(before, before)), 0.0)
    level = law.level(before, sign * guess)
    after = free - sign * ease * level
    rest = ca.fmin(ca.fmax(-sign * after / ca.fmax(sign * (before - after), _TINY), 0.0), 1.0)
    return sign * level, law.held(free - kept * before, ease), ca.if_else(before == 0, 1.0, rest)


# Samples after which a function is worth compiling.
_WORTH_COMPILING = 20_000


@dataclass(frozen=True)
class Kind:
    """Parameters of the generated C of a run.

    Attributes:
        states: of the linear part.
        cuts: number of evaluations of the velocity inside a sample.
        stribeck: whether friction depends on the velocity.
    """

    states: int
    cuts: int
    stribeck: bool


_DONE: dict[Kind, int] = {}
# One compiler at a time, in parallel to Python.
_COMPILING: dict[Kind, Future[ctypes.CDLL]] = {}
_COMPILERS = ThreadPoolExecutor(1, thread_name_prefix="compiler")

_LOOP = """
#include <string.h>
{head}
#define EVALUATE(name, x, inputs, numbers, first, second) {{ \\
  const double* given[{most}] = {{x, inputs, numbers}}; \\
  double *taken[{most}] = {{first, second}}, w[{most}]; \\
  if (name(given, taken, 0, w, 0)) return 1; }}
static inline void slope(const Lanes* restrict s, const Lanes* restrict direction, const double* restrict x,
                         const double* restrict inputs, const double* restrict numbers, const double* restrict kept,
                         Lanes* restrict along, Lanes* restrict error) {{
  {slope}
}}

static int without(long long samples, double* x, const double* inputs, const double* numbers, double* out) {{
  double next[{states}];
  for (long long k = 0; k < samples; ++k, inputs += {inputs}) {{
    EVALUATE(plain, x, inputs, numbers, next, out + k)
    memcpy(x, next, sizeof next);
  }}
  return 0;
}}

/* Slopes by several parameters side by side in the lanes of vectors; lanes without a parameter go through 0. */
int avc_run(long long samples, long long columns, double* x, const double* inputs, const double* numbers,
            const double* directions, double* out) {{
  if (columns == 0) return without(samples, x, inputs, numbers, out);
  const long long vectors = (columns + WIDTH - 1) / WIDTH;
  Lanes s[vectors][2][{states}], direction[vectors][{numbers}];
  memset(s, 0, sizeof s);
  memset(direction, 0, sizeof direction);
  for (long long j = 0; j < columns; ++j)
    for (int i = 0; i < {numbers}; ++i) direction[j / WIDTH][i][j % WIDTH] = directions[j * {numbers} + i];
  double next[{states}], kept[{kept}];
  for (long long k = 0; k < samples; ++k, inputs += {inputs}, out += columns + 1) {{
    EVALUATE(seen, x, inputs, numbers, next, kept)
    out[0] = kept[0];
    for (long long v = 0; v < vectors; ++v) {{
      Lanes error;
      slope(s[v][k & 1], direction[v], x, inputs, numbers, kept, s[v][~k & 1], &error);
      for (int lane = 0; lane < WIDTH && v * WIDTH + lane < columns; ++lane) out[1 + v * WIDTH + lane] = error[lane];
    }}
    memcpy(x, next, sizeof next);
  }}
  return 0;
}}
"""


def prepare(kinds: Sequence[Kind]) -> None:
    """Start compiling, where there is a compiler, the code of long runs; a run of the kind waits for it.

    Args:
        kinds: in the order of their use.
    """
    for kind in kinds:
        if kind not in _COMPILING and compiler() is not None:
            _COMPILING[kind] = _COMPILERS.submit(library, _source(kind))


def run(state: FloatArray, inputs: FloatArray, numbers: FloatArray, directions: FloatArray, kind: Kind) -> FloatArray:
    """Return the prediction error of every sample and its derivatives, shape (samples, 1 + columns).

    Args:
        state: at the start, shape (states,).
        inputs: forces of the taps, measured position and time, shape (samples, taps + 2).
        numbers: parameters of the model, as `Sample` lists them.
        directions: derivative of the numbers by each free parameter, shape (columns, numbers).
        kind: of the model.
    """
    _DONE[kind] = _DONE.get(kind, 0) + len(inputs)
    if _DONE[kind] >= _WORTH_COMPILING:
        prepare([kind])
    x, inputs, numbers, directions = (
        np.array(one, dtype=np.float64, order="C") for one in (state, inputs, numbers, directions)
    )
    out = np.empty((len(inputs), 1 + len(directions)))
    if kind in _COMPILING:
        pointers = (one.ctypes.data for one in (x, inputs, numbers, directions, out))
        _native(kind)(len(inputs), len(directions), *pointers)
    else:
        _interpreted(_sample(kind), x, inputs, numbers, directions, out)
    return out


def _sample(kind: Kind) -> Sample:
    return sample(kind.states, kind.cuts, kind.stribeck)


def _source(kind: Kind) -> str:
    one = _sample(kind)
    generator = ca.CodeGenerator("sample", {"with_header": False, "main": False, "mex": False})
    for function in (one.plain, one.seen):
        generator.add(function)
    reads = ("s[{}]", "direction[{}]", *(f"SPREAD({name}[{{}}])" for name in ("x", "inputs", "numbers", "kept")))
    loop = _LOOP.format(
        head=LANES_HEAD,
        slope=in_lanes(one.slope, reads, ("along[{}]", "error[{}]")),
        states=kind.states,
        kept=one.seen.numel_out(1),
        inputs=one.plain.numel_in(1),
        numbers=one.plain.numel_in(2),
        most=max(size for each in (one.plain, one.seen) for size in (each.sz_arg(), each.sz_res(), each.sz_w())),
    )
    return str(generator.dump()) + loop


@lru_cache(maxsize=16)
def _native(kind: Kind) -> Callable[..., int]:
    function = _COMPILING[kind].result().avc_run
    function.restype = ctypes.c_int
    function.argtypes = [ctypes.c_longlong, ctypes.c_longlong] + [ctypes.c_void_p] * 5
    result: Callable[..., int] = function
    return result


def _interpreted(
    one: Sample,
    x: FloatArray,
    inputs: FloatArray,
    numbers: FloatArray,
    directions: FloatArray,
    out: FloatArray,
) -> None:
    """Evaluate the loop of the C code by CasADi."""
    slopes = np.zeros((len(directions), x.size))
    now, after = np.empty(inputs.shape[1]), np.empty_like(x)
    kept = np.empty((one.seen if len(directions) else one.plain).numel_out(1))
    _buffer, step = _bound(one.seen if len(directions) else one.plain, (x, now, numbers), (after, kept))
    along, moved, slope = np.empty_like(x), np.empty_like(x), np.empty(1)
    columns = [_bound(one.slope, (along, direction, x, now, numbers, kept), (moved, slope)) for direction in directions]
    for k in range(len(inputs)):
        now[:] = inputs[k]
        step()
        out[k, 0] = kept[0]
        for j, (_, column) in enumerate(columns):
            along[:] = slopes[j]
            column()
            slopes[j], out[k, 1 + j] = moved, slope[0]
        x[:] = after


def _bound(function: Any, given: Sequence[FloatArray], taken: Sequence[FloatArray]) -> tuple[Any, Callable[[], None]]:
    """Return a buffer, which must be kept alive, and the evaluation of a function on arrays in place."""
    buffer, evaluate = function.buffer()
    for index, array in enumerate(given):
        buffer.set_arg(index, memoryview(array))  # type: ignore[arg-type]
    for index, array in enumerate(taken):
        buffer.set_res(index, memoryview(array))  # type: ignore[arg-type]
    return buffer, evaluate
