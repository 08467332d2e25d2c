"""Running a compiled scene: CasADi's own loop over samples, or generated C where that pays."""

from __future__ import annotations

import os
import subprocess
from typing import Literal

import numpy as np

from avc_casadi.scene._compile import CompiledScene
from avc_casadi.scene._native import NativeScene, compiler
from avc_casadi.support import FloatArray, HeldInterrupt

Engine = Literal["auto", "casadi", "native"]

# Compiling takes about 0.1 s and 0.25 ms an instruction, and saves some 1.5 ns each time an instruction is evaluated.
_COMPILE_S, _COMPILE_S_PER_INSTRUCTION, _SAVED_S = 0.1, 2.5e-4, 1.5e-9
# In pieces, a sample with dry friction is no longer than this.
_SPLIT_INSTRUCTIONS = 3000


def execute(
    scene: CompiledScene, parameters: FloatArray, inputs: FloatArray, *, engine: Engine = "auto"
) -> dict[str, FloatArray]:
    """Run a scene once for every row of the parameters.

    Args:
        scene: the compiled scene.
        parameters: shape (runs, parameters), of `CompiledScene.parameter_values`.
        inputs: shape (inputs, samples), of `CompiledScene.input_values`.
        engine: ``casadi``, ``native`` (generated C; the same bits), or ``auto``: C for long work where a compiler is.

    Returns:
        Every trace, shape (runs, samples).
    """
    saved = len(parameters) * scene.samples * scene.instructions * _SAVED_S
    size = min(scene.instructions, _SPLIT_INSTRUCTIONS) if scene.branches else scene.instructions
    pays = saved > _COMPILE_S + size * _COMPILE_S_PER_INSTRUCTION
    if engine == "native" or (engine == "auto" and pays and compiler() is not None):
        try:
            native = NativeScene(scene)
        except (OSError, subprocess.CalledProcessError):
            if engine == "native":
                raise
        else:
            traces = native(scene.initial, inputs.T, parameters, min(len(parameters), os.cpu_count() or 1))
            return {name: traces[:, :, index] for index, name in enumerate(scene.traces)}
    return _by_casadi(scene, parameters, inputs)


def _by_casadi(scene: CompiledScene, parameters: FloatArray, inputs: FloatArray) -> dict[str, FloatArray]:
    import casadi as ca  # noqa: PLC0415

    loop = scene.function.mapaccum("run", scene.samples)
    held = ca.DM(inputs)
    results = np.empty((len(parameters), len(scene.traces), scene.samples))
    with HeldInterrupt() as interrupt:
        for run, row in enumerate(parameters):
            if interrupt.came:
                break
            results[run] = loop(scene.initial, held, ca.repmat(ca.DM(row), 1, scene.samples))[1].full()
    return {name: results[:, index] for index, name in enumerate(scene.traces)}
