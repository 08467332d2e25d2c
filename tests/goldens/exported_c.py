"""Forces of the exported C of six couplings along a trace of positions that stands beside this file."""

from __future__ import annotations

import ctypes
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from avc_process import answered

_HERE = Path(__file__).resolve().parent
# One of each kind that is exported: contact damper, spring and damper, state feedback, a knob with detents, gains that
# follow the frequency, series and damped.
# Beside each: the share of the trace with which its force reaches its limit now and then, and not all the time.
COUPLINGS = {
    "wall": 0.5,
    "figure5": 0.1,
    "reference-r1": 0.3,
    "knob": 0.7,
    "figure5-direct": 0.1,
    "adaptive-press-schedule": 0.2,
}
EVERY = 50


def coupling_file(name: str) -> Path:
    """Return the committed coupling file, written by release 0.2.0."""
    return _HERE / "couplings" / f"{name}.json"


def trace_um() -> list[int]:
    """Return positions in micrometres, a sample each: slow press, hold and release, taps, bounces at the face."""
    found: list[int] = json.loads((_HERE / "trace_um.json").read_text(encoding="ascii"))
    return found


def exported(coupling: Path, folder: Path) -> None:
    """Write the exported C of a coupling into a folder; it may be one that is not deployable."""
    code, told = answered("export", str(coupling), "--c", ".", "--unsafe", cwd=folder)
    if code:
        raise RuntimeError(f"avc export {coupling}: {told}")


def compiled(folder: Path) -> ctypes.CDLL:
    """Compile the exported C of a folder, without warnings, into a library and load it."""
    build = ["gcc", "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared"]
    library = str(folder / "coupling.so")
    subprocess.run([*build, "avc_coupling.c", "-lm", "-o", library], cwd=folder, check=True)  # noqa: S603 - of the project's own files
    return ctypes.CDLL(library)


def exported_c(case: str) -> dict[str, Any]:
    """Return every 50th force along the trace, in N or N.m; a knob turns by what its rim goes along."""
    told = json.loads(coupling_file(case).read_text(encoding="ascii"))
    radius = told["problem_file"]["device"].get("handle_radius_m", 1.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        exported(coupling_file(case), folder)
        library = compiled(folder)
        step = library.avc_coupling_step
        step.restype, step.argtypes = ctypes.c_float, [ctypes.c_void_p, ctypes.c_float]
        memory = ctypes.create_string_buffer(1 << 16)  # more than any coupling remembers
        library.avc_coupling_start(memory)
        share = COUPLINGS[case] * 1e-6 / radius
        forces = [float(step(memory, share * x)) for x in trace_um()]
    return {"samples": len(forces), "force": forces[EVERY - 1 :: EVERY]}
