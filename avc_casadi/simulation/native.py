"""The sample function as machine code: generated C, compiled once, for runs long enough to pay for it.

The compiler may not fuse multiplications and additions, so that the results have the bits of CasADi's own evaluation.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.parallel import processors

if TYPE_CHECKING:
    from avc_casadi.simulation.compile import CompiledScene


KEPT = 1024
"""Scenes whose machine code is at hand: a device with ranges is tried in some hundreds, many of the same text."""
# To begin a thread takes as long as some runs do.
_THREADS = ThreadPoolExecutor(processors(), thread_name_prefix="scene")
_FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")

_LOOP = """
int avc_run(long long runs, long long samples, const double* initial, const double* inputs, const double* parameters,
            double* traces) {{
  double now[{states}], next[{states}];
  for (long long run = 0; run < runs; ++run) {{
    const double* p = parameters + run * {n_parameters};
    for (int i = 0; i < {n_states}; ++i) now[i] = initial[i];
    for (long long tick = 0; tick < samples; ++tick) {{
      if (avc_sample(now, inputs + tick * {n_inputs}, p, next, traces + (run * samples + tick) * {n_traces})) return 1;
      for (int i = 0; i < {n_states}; ++i) now[i] = next[i];
    }}
  }}
  return 0;
}}
"""

_CALL = """
static int call_{name}({inputs}double* r, double* s, double* t) {{
  const double* arg[{arguments}];
  double* res[{results}];
  double w[{work}];
  long long int iw[{integers}];
  {given}
  res[0] = r; {second}{third}
  (void)s; (void)t;
  return {name}(arg, res, iw, w, 0);
}}
"""

_WHOLE = """
static int avc_sample(const double* now, const double* u, const double* p, double* next, double* traces) {
  return call_sample(now, u, p, next, traces, 0);
}
"""

_SPLIT = """
static int through(double* x, double force, double* target, double velocity, double duration, const double* p) {{
  const double part = duration / {substeps};
  for (int substep = 0; substep < {substeps}; ++substep) {{
    double moment[5] = {{force, *target, velocity, part, 0.0}}, out[{n_plant}], used[2];
    for (int event = 0; event < {events} && moment[3] != 0.0; ++event) {{
      if (call_until_event(x, moment, p, out, used, 0)) return 1;
      for (int i = 0; i < {n_plant}; ++i) x[i] = out[i];
      moment[3] -= used[0];
      moment[1] += velocity * ({sample_time!r} * used[0]);
      moment[4] = used[1];
    }}
    if (moment[3] != 0.0) {{
      if (call_to_the_end(x, moment, p, out, 0, 0)) return 1;
      for (int i = 0; i < {n_plant}; ++i) x[i] = out[i];
    }}
    *target = moment[1] + velocity * ({sample_time!r} * moment[3]);
  }}
  return 0;
}}

static int avc_sample(const double* now, const double* u, const double* p, double* next, double* traces) {{
  double drive[5];
  if (call_computer(now, u, p, next + {n_plant}, traces, drive)) return 1;
  for (int i = 0; i < {n_plant}; ++i) next[i] = now[i];
  if (!{late}) return through(next, drive[0], drive + 3, drive[4], 1.0, p);
  {{
    double target = drive[3];
    if (through(next, drive[1], &target, drive[4], drive[2], p)) return 1;
    target = drive[3] + drive[4] * ({sample_time!r} * drive[2]);
    return through(next, drive[0], &target, drive[4], 1.0 - drive[2], p);
  }}
}}
"""


def compiler() -> str | None:
    """Return the path of the C compiler ($CC, or cc), or None."""
    return _found(os.environ.get("CC") or "cc", os.environ.get("PATH"))


@lru_cache(maxsize=8)
def _found(name: str, path: str | None) -> str | None:
    return shutil.which(name, path=path)


class NativeScene:
    """The compiled loop over samples; calls release the interpreter, so that threads run side by side."""

    def __init__(self, scene: CompiledScene) -> None:
        self._traces = int(scene.function.numel_out(1))
        self._run = _compiled(scene.function, scene.split()).avc_run
        self._run.restype = ctypes.c_int
        self._run.argtypes = [ctypes.c_longlong, ctypes.c_longlong] + [ctypes.c_void_p] * 4

    def __call__(self, initial: FloatArray, inputs: FloatArray, parameters: FloatArray, workers: int) -> FloatArray:
        """Run every row of the parameters from the same initial state.

        Args:
            initial: shape (states,).
            inputs: shape (samples, inputs).
            parameters: shape (runs, parameters).
            workers: number of threads.

        Returns:
            The traces, shape (runs, samples, traces).
        """
        traces = np.empty((len(parameters), len(inputs), self._traces))
        initial, inputs, parameters = (
            np.ascontiguousarray(value, np.float64) for value in (initial, inputs, parameters)
        )

        def work(rows: slice) -> None:
            self._run(
                len(parameters[rows]),
                len(inputs),
                initial.ctypes.data,
                inputs.ctypes.data,
                parameters[rows].ctypes.data,
                traces[rows].ctypes.data,
            )

        in_threads(work, len(parameters), workers)
        return traces


def in_threads(work: Callable[[slice], None], rows: int, workers: int, whole: int = 1) -> None:
    """Do some rows in each thread.

    Args:
        work: what to do with a slice of the rows; it leaves Python to others.
        rows: number of rows.
        workers: number of threads at most.
        whole: rows that are no cheaper apart: all threads but the last get a multiple of them.
    """
    groups = -(-rows // whole)
    each = whole * -(-groups // max(1, min(workers, groups)))
    parts = [slice(first, min(first + each, rows)) for first in range(0, rows, max(1, each))]
    others = [_THREADS.submit(work, part) for part in parts[1:]]
    try:
        for part in parts[:1]:
            work(part)
    finally:
        for other in others:
            other.result()


def c_of(functions: Sequence[Any], loop: str) -> str:
    """Return CasADi functions of at most three results and a loop that calls them, in C.

    Args:
        functions: each is ``call_NAME(arguments, three results)`` in C, a result that is 0 is not wanted.
        loop: C that follows them.
    """
    import casadi as ca  # noqa: PLC0415

    generator = ca.CodeGenerator("scene", {"with_header": False, "main": False, "mex": False})
    for function in functions:
        generator.add(function)
    return "".join([str(generator.dump()), *map(_call, functions), loop])


@lru_cache(maxsize=KEPT)
def _compiled(whole: Any, split: Any) -> ctypes.CDLL:
    """Return the loop of a scene, once for each: the text of its C takes as long as some runs."""
    functions = [whole] if split is None else [split.computer, split.until_event, split.to_the_end]
    return library(c_of(functions, _loop(whole, split)), _FLAGS)


def _loop(whole: Any, split: Any) -> str:
    """Return a sample of a scene and the loop over its samples, in C."""
    if split is None:
        sample = _WHOLE
    else:
        sample = _SPLIT.format(
            substeps=split.substeps,
            events=split.events,
            late=int(split.late),
            sample_time=split.sample_time_s,
            n_plant=split.to_the_end.numel_out(0),
        )
    return sample + _LOOP.format(
        states=max(1, whole.numel_in(0)),
        n_states=whole.numel_in(0),
        n_inputs=whole.numel_in(1),
        n_parameters=whole.numel_in(2),
        n_traces=whole.numel_out(1),
    )


def _call(function: Any) -> str:
    """Return a C function that gives a generated one its work space."""
    count = function.n_out()
    given = range(function.n_in())
    return _CALL.format(
        name=function.name(),
        inputs="".join(f"const double* a{index}, " for index in given),
        given=" ".join(f"arg[{index}] = a{index};" for index in given),
        arguments=max(1, function.sz_arg()),
        results=max(3, function.sz_res()),
        work=max(1, function.sz_w()),
        integers=max(1, function.sz_iw()),
        second="res[1] = s; " if count > 1 else "",
        third="res[2] = t;" if count > 2 else "",
    )


@lru_cache(maxsize=64)
def library(source: str, flags: tuple[str, ...]) -> ctypes.CDLL:
    """Compile C once in the life of this process.

    Raises:
        FileNotFoundError: there is no compiler.
        CalledProcessError: it refuses.
    """
    found = compiler()
    if found is None:
        raise FileNotFoundError("no C compiler: neither $CC nor cc is there")
    folder = Path(tempfile.mkdtemp(prefix="avc-scene-"))
    try:
        code, shared = folder / "sample.c", folder / "sample.so"
        code.write_text(source, encoding="utf-8")
        command = [found, *flags, str(code), "-o", str(shared), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - the user's own compiler
        return ctypes.CDLL(str(shared))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
