"""BLAS kernels that this machine can run, an old and a new one: `python tests/kernels.py` prints their names.

OpenBLAS has a kernel for each kind of processor. They add in different orders, so results differ in the last bits.
OPENBLAS_CORETYPE chooses a kernel when a process starts: one machine shows what another would answer. `.ci/run` sets it
to each name on standard output. Standard error says which kernels NumPy and SciPy then run, or why none are compared;
each of the two brings an OpenBLAS of its own.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

KERNELS = ("Prescott", "Haswell")
"""Kernels of 2004 (SSE3) and of 2013 (AVX2, fused multiply and add). OpenBLAS runs the second on Zen too."""
_NEEDS = "avx2"
"""What a processor must have for the newer: OpenBLAS does not check."""
_LOADED = """
import numpy, scipy.linalg, threadpoolctl
libraries = [library for library in threadpoolctl.threadpool_info() if library["internal_api"] == "openblas"]
print(*sorted({library["architecture"] for library in libraries}))
"""


def environment(kernel: str) -> dict[str, str]:
    """Return the environment of a process that runs a kernel, on one thread."""
    return {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}


def loaded(kernel: str) -> str:
    """Return the names of the kernels that NumPy and SciPy run when one is wanted; "" where neither has OpenBLAS."""
    program = [sys.executable, "-c", _LOADED]
    return subprocess.run(program, env=environment(kernel), capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603


def why_none() -> str:
    """Return why this machine cannot run both kernels; "" where it can."""
    if platform.machine().lower() not in {"x86_64", "amd64"}:
        return f"the processor is {platform.machine()}; the kernels are those of x86_64"
    if sys.platform == "linux" and _NEEDS not in Path("/proc/cpuinfo").read_text(encoding="utf-8").split():
        return f"the processor has no {_NEEDS.upper()}"
    old, new = map(loaded, KERNELS)
    return "" if old != new else f"OPENBLAS_CORETYPE changes nothing: {old or 'no OpenBLAS'}"


def main() -> None:
    """Print the kernels."""
    if reason := why_none():
        print(f"kernels: skipped, {reason}", file=sys.stderr)
        return
    for kernel in KERNELS:
        print(f"kernels: OPENBLAS_CORETYPE={kernel} runs {loaded(kernel)}", file=sys.stderr)
        print(kernel)


if __name__ == "__main__":
    main()
