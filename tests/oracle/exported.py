"""The exported C of a coupling, compiled and called."""

from __future__ import annotations

import ctypes
import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from hardware_bench import export_c, require, run, scratch
from numpy.typing import ArrayLike, NDArray

from avc_casadi.coupling import Coupling

WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
C99 = ("gcc", "-std=c99")
CPP11 = ("g++", "-std=c++11", "-x", "c++")
CLANG = ("clang", "-std=c99")
CLANG_CPP17 = ("clang++", "-std=c++17", "-x", "c++")
# No ranges to search: what is exported does not depend on the hands.
ONE_HAND = "[hands]\nmass_kg = [0.1, 0.1]\ndamping_ns_per_m = [5.0, 5.0]\nstiffness_n_per_m = [400.0, 400.0]\n"
# More than any coupling remembers.
_ROOM = 8192


@functools.cache
def library(
    coupling: Coupling, compiler: tuple[str, ...] = C99, flags: tuple[str, ...] = WARNINGS, precision: str = "single"
) -> Path:
    """Compile the exported C once for each coupling: what one instance remembers stands in memory of its own."""
    require(compiler[0])
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for name, text in export_c(coupling, precision=precision).items():
        (folder / name).write_text(text, encoding="ascii")
    tool, *options = compiler
    build = ("-O2", *flags, "-fPIC", "-shared", "-nostdlib")
    run(tool, *options, *build, str(folder / "avc_coupling.c"), "-o", str(folder / "coupling.so"))
    return folder / "coupling.so"


class Exported:
    """One device with the exported coupling."""

    def __init__(
        self,
        coupling: Coupling,
        *,
        compiler: tuple[str, ...] = C99,
        flags: tuple[str, ...] = WARNINGS,
        precision: str = "single",
    ) -> None:
        self._c = ctypes.CDLL(str(library(coupling, compiler, flags, precision)))
        number: type[Any] = {"single": ctypes.c_float, "double": ctypes.c_double}[precision]
        self._c.avc_coupling_step.restype = number
        self._c.avc_coupling_step.argtypes = [ctypes.c_void_p, number]
        self._dtype = np.dtype(number)
        self._memory = ctypes.create_string_buffer(b"\xff" * _ROOM, _ROOM)
        self.start()

    def start(self) -> None:
        self._c.avc_coupling_start(self._memory)

    def step(self, position_m: float) -> float:
        force: float = self._c.avc_coupling_step(self._memory, position_m)
        return force

    def forces(self, positions_m: ArrayLike) -> NDArray[Any]:
        return np.array([self.step(float(x)) for x in np.asarray(positions_m)], dtype=self._dtype)
