"""Forces of the exported C of six couplings along a trace of positions that stands beside this file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from exported import Exported

import avc_casadi as avc

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


def exported_c(case: str) -> dict[str, Any]:
    """Return every 50th force along the trace, in N or N.m; a knob turns by what its rim goes along."""
    coupling = avc.read_coupling(coupling_file(case))
    share = COUPLINGS[case] * 1e-6 / coupling.problem.device.metres_per_unit
    forces = Exported(coupling).forces([share * x for x in trace_um()]).tolist()
    return {"samples": len(forces), "force": forces[EVERY - 1 :: EVERY]}
