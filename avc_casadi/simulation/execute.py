"""Execution of a compiled scene: CasADi's own loop over samples, or machine code where that is faster.

The machine code is C written from CasADi's instructions. Several runs lie side by side in the lanes of vectors. Lanes
are independent, no instruction is reordered or fused, and a choice is a bit mask instead of a jump: a run has the bits
of CasADi's own evaluation, in any lane, alone or with others.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi._util.parallel import processors
from avc_casadi.simulation.compile import CompiledScene
from avc_casadi.simulation.emit import LANES_HEAD, in_lanes
from avc_casadi.simulation.judge import AT_REST_M_PER_S, DIVERGENCE_M, window_samples
from avc_casadi.simulation.tick import ca

# Cached machine code: a device with ranges is tried in some hundreds of scenes, many of the same text.
_CACHE = 1024
# Kept, as starting a thread takes as long as some runs.
_THREADS = ThreadPoolExecutor(processors(), thread_name_prefix="scene")
_COMPILING = ThreadPoolExecutor(processors(), thread_name_prefix="compile")
LANES = 16
"""Runs side by side."""
_RUNS_AT_ONCE = 250
"""Runs whose traces are in memory at a time, where CasADi runs the scene."""

_LOOP = """
#define LANES {lanes}
static inline void sample(const Lanes* restrict now, const double* restrict u, const Lanes* restrict p,
                          Lanes* restrict next, Lanes* restrict traces) {{
  {body}
}}

#define VECTORS (LANES / WIDTH)
/* The largest so far; once not a number, always not a number. */
static inline Lanes peak(Lanes value, Lanes before) {{
  const Lanes size = (Lanes)((Bits)value & 0x7fffffffffffffffLL);
  return PICK((size > before) | (size != size), size, before);
}}

int avc_run(long long runs, long long samples, long long judged, const double* initial, const double* inputs,
            const double* parameters, double* traces, double* peaks) {{
  for (long long first = 0; first < runs; first += LANES) {{
    const long long left = (runs - first + WIDTH - 1) / WIDTH, vectors = left < VECTORS ? left : VECTORS;
    Lanes now[2][VECTORS][{states}], p[VECTORS][{parameters}], seen[VECTORS][{traces}], far[VECTORS], fast[VECTORS];
    for (int v = 0; v < vectors; ++v) {{
      for (int lane = 0; lane < WIDTH; ++lane) {{
        /* Lanes without a run of their own go through the last one. */
        const long long mine = first + v * WIDTH + lane, run = mine < runs ? mine : runs - 1;
        for (int i = 0; i < {n_parameters}; ++i) p[v][i][lane] = parameters[run * {n_parameters} + i];
      }}
      for (int i = 0; i < {n_states}; ++i) now[0][v][i] = SPREAD(initial[i]);
      far[v] = fast[v] = SPREAD(0.);
    }}
    for (long long tick = 0; tick < samples; ++tick) {{
      for (int v = 0; v < vectors; ++v) {{
        sample(now[tick & 1][v], inputs + tick * {n_inputs}, p[v], now[~tick & 1][v], seen[v]);
        far[v] = peak(seen[v][0], far[v]);
        if (tick >= judged)
          for (int i = 1; i <= {speeds}; ++i) fast[v] = peak(seen[v][i], fast[v]);
      }}
      if (traces)
        for (int lane = 0; lane < LANES && first + lane < runs; ++lane)
          for (int i = 0; i < {n_traces}; ++i)
            traces[((first + lane) * samples + tick) * {n_traces} + i] = seen[lane / WIDTH][i][lane % WIDTH];
    }}
    if (peaks)
      for (int lane = 0; lane < LANES && first + lane < runs; ++lane) {{
        peaks[2 * (first + lane)] = far[lane / WIDTH][lane % WIDTH];
        peaks[2 * (first + lane) + 1] = fast[lane / WIDTH][lane % WIDTH];
      }}
  }}
  return 0;
}}
"""


def compiler() -> str | None:
    """Return the path of the C compiler ($CC, or cc), or None."""
    return shutil.which(os.environ.get("CC") or "cc")


class NativeScene:
    """The compiled loop over samples; calls release the interpreter, so that threads run side by side."""

    def __init__(self, scene: CompiledScene) -> None:
        self._traces = int(scene.function.numel_out(1))
        self._run = _compile(scene.function, len(scene.speeds)).result().avc_run
        self._run.restype = ctypes.c_int
        self._run.argtypes = [ctypes.c_longlong] * 3 + [ctypes.c_void_p] * 5

    def __call__(
        self, initial: FloatArray, inputs: FloatArray, parameters: FloatArray, workers: int, first: int | None = None
    ) -> FloatArray:
        """Run every row of the parameters; return traces, or from a first sample on the peaks (runs, 2)."""
        initial = np.ascontiguousarray(initial, np.float64)
        inputs = np.ascontiguousarray(inputs, np.float64)
        parameters = np.ascontiguousarray(parameters, np.float64)
        runs, samples = len(parameters), len(inputs)
        results = np.empty((runs, samples, self._traces) if first is None else (runs, 2))

        def work(rows: slice) -> None:
            block = parameters[rows]
            result = results[rows].ctypes.data
            arrays = initial.ctypes.data, inputs.ctypes.data, block.ctypes.data
            pointers = (result, None) if first is None else (None, result)
            self._run(len(block), samples, first or 0, *arrays, *pointers)

        groups = -(-runs // LANES)
        share = LANES * -(-groups // max(1, min(workers, groups)))
        shares = (slice(begin, min(begin + share, runs)) for begin in range(0, runs, max(1, share)))
        list(_THREADS.map(work, shares))
        return results


def compile_ahead(scene: CompiledScene, runs: int) -> None:
    """Start to compile a scene in the background, where that pays."""
    with suppress(LookupError):
        if _pays(scene, runs):
            _compile(scene.function, len(scene.speeds))


@lru_cache(maxsize=_CACHE)
def _compile(function: Any, speeds: int) -> Future[ctypes.CDLL]:
    """Start to compile the loop over samples of a scene as C in lanes; return its future; results are cached."""
    body = in_lanes(function, ("now[{}]", "SPREAD(u[{}])", "p[{}]"), ("next[{}]", "traces[{}]"))
    sizes = {
        "states": function.numel_in(0),
        "inputs": function.numel_in(1),
        "parameters": function.numel_in(2),
        "traces": function.numel_out(1),
    }
    least = {name: max(1, size) for name, size in sizes.items()}
    exact = {f"n_{name}": size for name, size in sizes.items()}
    code = LANES_HEAD + _LOOP.format(**least, **exact, speeds=speeds, body=body, lanes=LANES)
    return _compilation(code, compiler())


def library(source: str) -> ctypes.CDLL:
    """Compile C for this machine, once per process."""
    return _compilation(source, compiler()).result()


@lru_cache(maxsize=_CACHE)
def _compilation(source: str, path: str | None) -> Future[ctypes.CDLL]:
    return _COMPILING.submit(_library, source, path)


def _library(source: str, path: str | None) -> ctypes.CDLL:
    """Return the loaded shared library of C source, compiled by the compiler at a path; errors of the compiler rise."""
    if path is None:
        raise FileNotFoundError("no C compiler: neither $CC nor cc is there")
    with tempfile.TemporaryDirectory(prefix="avc-scene-", ignore_cleanup_errors=True) as folder:
        code, shared = Path(folder, "sample.c"), Path(folder, "sample.so")
        code.write_text(source, encoding="utf-8")
        # Nothing fused; no errno, for which a root would leave its lanes. -O2 is no faster.
        plain = ("-O1", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared", "-w")
        # The machine's own vectors; not every compiler has this option.
        for flags in ((*plain, "-march=native"), plain):
            command = [path, *flags, str(code), "-o", str(shared), "-lm"]
            done = subprocess.run(command, check=False, capture_output=True, text=True)  # noqa: S603 - the user's own
            if done.returncode == 0:
                return ctypes.CDLL(str(shared))
        raise subprocess.CalledProcessError(done.returncode, command, done.stdout, done.stderr)


def execute(scene: CompiledScene, parameters: FloatArray, inputs: FloatArray) -> dict[str, FloatArray]:
    """Run a scene once for every row of the parameters."""
    native = _native(scene, len(parameters))
    if native is None:
        return _by_casadi(scene, parameters, inputs)
    traces = native(scene.initial, inputs.T, parameters, min(len(parameters), processors()))
    return {name: traces[:, :, index] for index, name in enumerate(scene.traces)}


def execute_to_speed(
    scene: CompiledScene, parameters: FloatArray, inputs: FloatArray, *, workers: int = 1
) -> FloatArray:
    """Run a scene once for every row of the parameters; return the residual speeds over that of rest, (runs,).

    No traces are kept in the compiled C, which takes less memory.
    """
    native = _native(scene, len(parameters))
    if native is not None:
        first = scene.samples - window_samples(scene.samples, scene.sample_time_s)
        far, fast = native(scene.initial, inputs.T, parameters, workers, first).T
        return _over_rest(scene, far, fast)
    parts = [np.zeros(0)]
    for begin in range(0, len(parameters), _RUNS_AT_ONCE):
        run = _by_casadi(scene, parameters[begin : begin + _RUNS_AT_ONCE], inputs)
        last = slice(-window_samples(scene.samples, scene.sample_time_s), None)
        fast = np.max([np.abs(run[name][:, last]).max(axis=-1) for name in scene.speeds], axis=0)
        parts.append(_over_rest(scene, np.abs(run["position_m"]).max(axis=-1), fast))
    return np.concatenate(parts)


def _over_rest(scene: CompiledScene, far_m: FloatArray, fast_m_per_s: FloatArray) -> FloatArray:
    here = far_m < DIVERGENCE_M / scene.metres_per_unit
    return np.where(here, fast_m_per_s / (AT_REST_M_PER_S / scene.metres_per_unit), np.inf)


_COMPILER_S = 0.1
"""Time of the compiler, whatever it compiles."""
_COMPILER_S_PER_INSTRUCTION = 2.5e-4
_GAIN_S_PER_INSTRUCTION = 1.5e-9
"""Time saved whenever an instruction is evaluated."""
_FEW_RUNS = 3
"""Where more hands try a scene, others will."""


def _pays(scene: CompiledScene, runs: int) -> bool:
    """Whether to compile: where that takes less time than it saves, or many hands will try the scene."""
    gain_s = runs * scene.samples * scene.instructions * _GAIN_S_PER_INSTRUCTION
    cost_s = _COMPILER_S + scene.instructions * _COMPILER_S_PER_INSTRUCTION
    return compiler() is not None and (runs > _FEW_RUNS or gain_s > cost_s)


def _native(scene: CompiledScene, runs: int) -> NativeScene | None:
    """Return the scene as machine code, or None where CasADi runs it."""
    with suppress(LookupError, OSError, subprocess.CalledProcessError):
        return NativeScene(scene) if _pays(scene, runs) else None
    return None


def _by_casadi(scene: CompiledScene, parameters: FloatArray, inputs: FloatArray) -> dict[str, FloatArray]:
    """Run a scene once for every row of the parameters by CasADi's own loop; return traces, (runs, samples) by name."""
    loop = _loop(scene.function, scene.samples)
    signals = ca.DM(inputs)
    results = np.empty((len(parameters), len(scene.traces), scene.samples))
    with DeferredInterrupt() as interrupt:
        for run, row in enumerate(parameters):
            if interrupt.came:
                break
            results[run] = loop(scene.initial, signals, row)[1].full()
    return {name: results[:, index] for index, name in enumerate(scene.traces)}


@lru_cache(maxsize=8)
def _loop(function: Any, samples: int) -> Any:
    """Return the loop over a scene's samples, with one set of parameters for all of them."""
    states, inputs = ca.MX.sym("states", function.size1_in(0)), ca.MX.sym("inputs", function.size1_in(1), samples)
    parameters = ca.MX.sym("parameters", function.size1_in(2))
    run = function.mapaccum("run", samples)
    return ca.Function("loop", [states, inputs, parameters], run(states, inputs, ca.repmat(parameters, 1, samples)))
