"""Execution of a compiled scene: CasADi's own loop over samples, or generated C where that is faster."""

from __future__ import annotations

import subprocess
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.interrupt import HeldInterrupt
from avc_casadi._util.parallel import processors
from avc_casadi.simulation.compile import CompiledScene
from avc_casadi.simulation.judge import AT_REST_M_PER_S, DIVERGED_M, judged_samples
from avc_casadi.simulation.native import NativeScene, compiler

Engine = Literal["auto", "casadi", "native"]

# Compiling takes about 0.1 s and 0.25 ms an instruction, and saves some 1.5 ns each time an instruction is evaluated.
_COMPILE_S, _COMPILE_S_PER_INSTRUCTION, _SAVED_S = 0.1, 2.5e-4, 1.5e-9
# Runs whose traces are held at a time, where only verdicts are wanted.
_TRACES = 250


def execute(
    scene: CompiledScene, parameters: FloatArray, inputs: FloatArray, *, engine: Engine = "auto"
) -> dict[str, FloatArray]:
    """Run a scene once for every row of the parameters."""
    native = _compiled(scene, len(parameters), engine)
    if native is None:
        return _by_casadi(scene, parameters, inputs)
    traces = native(scene.initial, inputs.T, parameters, min(len(parameters), processors()))
    return {name: traces[:, :, index] for index, name in enumerate(scene.traces)}


def execute_to_speed(
    scene: CompiledScene, parameters: FloatArray, inputs: FloatArray, *, engine: Engine = "auto", workers: int = 1
) -> FloatArray:
    """Run a scene once for every row of the parameters; return the residual speeds, without traces in C."""
    native = _compiled(scene, len(parameters), engine)
    if native is not None:
        first = scene.samples - judged_samples(scene.samples, scene.sample_time_s)
        far, fast = native(scene.initial, inputs.T, parameters, workers, first).T
        return _over_rest(scene, far, fast)
    found = [np.zeros(0)]
    for begin in range(0, len(parameters), _TRACES):
        run = _by_casadi(scene, parameters[begin : begin + _TRACES], inputs)
        last = slice(-judged_samples(scene.samples, scene.sample_time_s), None)
        fast = np.max([np.abs(run[name][:, last]).max(axis=-1) for name in scene.speeds], axis=0)
        found.append(_over_rest(scene, np.abs(run["position_m"]).max(axis=-1), fast))
    return np.concatenate(found)


def _over_rest(scene: CompiledScene, far_m: FloatArray, fast_m_per_s: FloatArray) -> FloatArray:
    here = far_m < DIVERGED_M / scene.metres_per_unit
    return np.where(here, fast_m_per_s / (AT_REST_M_PER_S / scene.metres_per_unit), np.inf)


def _compiled(scene: CompiledScene, runs: int, engine: Engine) -> NativeScene | None:
    """Return the scene as machine code, or None where CasADi runs it."""
    saved = runs * scene.samples * scene.instructions * _SAVED_S
    pays = saved > _COMPILE_S + scene.instructions * _COMPILE_S_PER_INSTRUCTION
    if engine != "native" and not (engine == "auto" and pays and compiler() is not None):
        return None
    try:
        return NativeScene(scene)
    except (LookupError, OSError, subprocess.CalledProcessError):
        if engine == "native":
            raise
    return None


def _by_casadi(scene: CompiledScene, parameters: FloatArray, inputs: FloatArray) -> dict[str, FloatArray]:
    import casadi as ca  # noqa: PLC0415

    loop = _loop(scene.function, scene.samples)
    held = ca.DM(inputs)
    results = np.empty((len(parameters), len(scene.traces), scene.samples))
    with HeldInterrupt() as interrupt:
        for run, row in enumerate(parameters):
            if interrupt.came:
                break
            results[run] = loop(scene.initial, held, ca.repmat(ca.DM(row), 1, scene.samples))[1].full()
    return {name: results[:, index] for index, name in enumerate(scene.traces)}


@lru_cache(maxsize=8)
def _loop(function: Any, samples: int) -> Any:
    """Return the loop over a scene's samples; building it takes as long as a run or two."""
    return function.mapaccum("run", samples)
