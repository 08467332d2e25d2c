"""A model run through a record sample by sample: compiled where there is a compiler, else evaluated by CasADi."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.sample import Sample, sample
from avc_casadi.simulation.native import LANES_HEAD, compiler, in_lanes, library

# Samples after which a function that runs on is compiled.
_WORTH_COMPILING = 20_000


@dataclass(frozen=True)
class Kind:
    """What the C of a run depends on.

    Attributes:
        states: of the linear part.
        cuts: how often the velocity is looked at inside a sample.
        stribeck: whether friction depends on the velocity.
    """

    states: int
    cuts: int
    stribeck: bool


_DONE: dict[Kind, int] = {}
# One compiler at a time, beside what Python does.
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
    """Begin to compile, where there is a compiler, what long runs will ask for; a run of the kind waits for it.

    Args:
        kinds: in the order in which they are asked for.
    """
    for kind in kinds:
        if kind not in _COMPILING and compiler() is not None:
            _COMPILING[kind] = _COMPILERS.submit(library, _source(kind))


def run(state: FloatArray, inputs: FloatArray, numbers: FloatArray, directions: FloatArray, kind: Kind) -> FloatArray:
    """Return the prediction error of every sample and its derivatives, shape (samples, 1 + columns).

    Args:
        state: at the start, shape (states,).
        inputs: forces of the taps, measured position and time, shape (samples, taps + 2).
        numbers: of the model, as `Sample` lists them.
        directions: derivative of the numbers by each parameter that is searched for, shape (columns, numbers).
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
    """Do the same as the loop in C."""
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
    """Return a buffer, which must be kept, and the evaluation of a function from and into arrays that stay in place."""
    buffer, evaluate = function.buffer()
    for index, array in enumerate(given):
        buffer.set_arg(index, memoryview(array))  # type: ignore[arg-type]
    for index, array in enumerate(taken):
        buffer.set_res(index, memoryview(array))  # type: ignore[arg-type]
    return buffer, evaluate
