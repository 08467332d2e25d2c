"""A model run through a record sample by sample: compiled where there is a compiler, else evaluated by CasADi."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from avc_casadi.identification._sample import Sample, sample
from avc_casadi.scene import compiled, compiler
from avc_casadi.support import FloatArray

# Samples after which a function that runs on is compiled.
_WORTH_COMPILING = 20_000
_DONE: dict[tuple[int, int, bool], int] = {}

_LOOP = """
#include <string.h>
int avc_run(long long samples, long long columns, double* x, double* s, const double* inputs, const double* numbers,
            const double* directions, double* out) {{
  double next[{states}], kept[{kept}];
  for (long long k = 0; k < samples; ++k, inputs += {inputs}, out += columns + 1) {{
    if (columns == 0) {{
      if (call_plain(x, inputs, numbers, next, out, 0)) return 1;
    }} else {{
      if (call_seen(x, inputs, numbers, next, kept, 0)) return 1;
      out[0] = kept[0];
      for (long long j = 0; j < columns; ++j) {{
        double along[{states}];
        const double* direction = directions + j * {numbers};
        if (call_slope(s + j * {states}, direction, x, inputs, numbers, kept, along, out + 1 + j, 0)) return 1;
        memcpy(s + j * {states}, along, sizeof along);
      }}
    }}
    memcpy(x, next, sizeof next);
  }}
  return 0;
}}
"""


def run(
    state: FloatArray, inputs: FloatArray, numbers: FloatArray, directions: FloatArray, *, cuts: int, stribeck: bool
) -> FloatArray:
    """Return the prediction error of every sample and its derivatives, shape (samples, 1 + columns).

    Args:
        state: at the start, shape (states,).
        inputs: forces of the taps, measured position and time, shape (samples, taps + 2).
        numbers: of the model, as `Sample` lists them.
        directions: derivative of the numbers by each parameter that is searched for, shape (columns, numbers).
        cuts: how often the velocity is looked at inside a sample.
        stribeck: whether friction depends on the velocity.
    """
    kind = (state.size, cuts, stribeck)
    _DONE[kind] = _DONE.get(kind, 0) + len(inputs)
    native = _DONE[kind] >= _WORTH_COMPILING and compiler() is not None
    x, inputs, numbers, directions = (
        np.array(one, dtype=np.float64, order="C") for one in (state, inputs, numbers, directions)
    )
    slopes = np.zeros((len(directions), x.size))
    out = np.empty((len(inputs), 1 + len(directions)))
    if native:
        pointers = (one.ctypes.data for one in (x, slopes, inputs, numbers, directions, out))
        _native(*kind)(len(inputs), len(directions), *pointers)
    else:
        _interpreted(sample(*kind), x, slopes, inputs, numbers, directions, out)
    return out


@lru_cache(maxsize=16)
def _native(states: int, cuts: int, stribeck: bool) -> Callable[..., int]:
    one = sample(states, cuts, stribeck)
    loop = _LOOP.format(
        states=states,
        kept=one.seen.numel_out(1),
        inputs=one.plain.numel_in(1),
        numbers=one.plain.numel_in(2),
    )
    function = compiled([one.plain, one.seen, one.slope], loop).avc_run
    function.restype = ctypes.c_int
    function.argtypes = [ctypes.c_longlong, ctypes.c_longlong] + [ctypes.c_void_p] * 6
    result: Callable[..., int] = function
    return result


def _interpreted(
    one: Sample,
    x: FloatArray,
    slopes: FloatArray,
    inputs: FloatArray,
    numbers: FloatArray,
    directions: FloatArray,
    out: FloatArray,
) -> None:
    """Do the same as the loop in C."""
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
