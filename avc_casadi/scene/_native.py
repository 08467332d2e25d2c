"""The sample function as machine code: generated C, compiled once, for runs long enough to pay for it.

The compiler may not fuse multiplications and additions, so that the results have the bits of CasADi's own evaluation.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")

_DRIVER = """
int avc_run(long long runs, long long samples, const double* initial, const double* inputs, const double* parameters,
            double* traces) {{
  const double* arg[{arguments}];
  double* res[{results}];
  double now[{states}], next[{states}], w[{work}];
  long long int iw[{integers}];
  for (long long run = 0; run < runs; ++run) {{
    for (int i = 0; i < {n_states}; ++i) now[i] = initial[i];
    for (long long tick = 0; tick < samples; ++tick) {{
      arg[0] = now;
      arg[1] = inputs + tick * {n_inputs};
      arg[2] = parameters + run * {n_parameters};
      res[0] = next;
      res[1] = traces + (run * samples + tick) * {n_traces};
      if ({name}(arg, res, iw, w, 0)) return 1;
      for (int i = 0; i < {n_states}; ++i) now[i] = next[i];
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

    def __init__(self, function: Any) -> None:
        self._traces = int(function.numel_out(1))
        self._run = _library(_source(function)).avc_run
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

        def work(rows: NDArray[np.intp]) -> None:
            first, count = int(rows[0]), len(rows)
            self._run(
                count,
                len(inputs),
                initial.ctypes.data,
                inputs.ctypes.data,
                parameters[first:].ctypes.data,
                traces[first:].ctypes.data,
            )

        parts = [rows for rows in np.array_split(np.arange(len(parameters)), workers) if len(rows)]
        if len(parts) == 1:
            work(parts[0])
        else:
            with ThreadPoolExecutor(len(parts)) as pool:
                list(pool.map(work, parts))
        return traces


def _source(function: Any) -> str:
    import casadi as ca  # noqa: PLC0415

    generator = ca.CodeGenerator("sample", {"with_header": False, "main": False, "mex": False})
    generator.add(function)
    driver = _DRIVER.format(
        name=function.name(),
        arguments=function.sz_arg(),
        results=function.sz_res(),
        states=max(1, function.numel_in(0)),
        work=max(1, function.sz_w()),
        integers=max(1, function.sz_iw()),
        n_states=function.numel_in(0),
        n_inputs=function.numel_in(1),
        n_parameters=function.numel_in(2),
        n_traces=function.numel_out(1),
    )
    return str(generator.dump()) + driver


@lru_cache(maxsize=64)
def _library(source: str) -> ctypes.CDLL:
    found = compiler()
    if found is None:
        raise FileNotFoundError("no C compiler: neither $CC nor cc is there")
    folder = Path(tempfile.mkdtemp(prefix="avc-scene-"))
    try:
        code, library = folder / "sample.c", folder / "sample.so"
        code.write_text(source, encoding="utf-8")
        command = [found, *_FLAGS, str(code), "-o", str(library), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - the user's own compiler
        return ctypes.CDLL(str(library))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
