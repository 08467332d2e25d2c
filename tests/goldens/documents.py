"""The documents that verbs print with --json: which keys they have, of which type, and the exit code; no values."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from goldens.command import avc
from goldens.exported_c import coupling_file

# A problem that every verb is quick with.
SMALL = """\
[device]
mass_kg = 0.12
damping_ns_per_m = 0.8
delay_samples = 1
coulomb_friction_n = 0.1
encoder_resolution_m = 2e-5
max_force_n = 8.0
[environment]
stiffness_n_per_m = 3000.0
damping_ns_per_m = 1.0
[frequency]
points = 12
"""
# Versions, ports and solvers are those of a machine: what stands below is not looked at.
_OF_THE_MACHINE = ("versions", "solvers", "ports", "casadi", "packages")
_EMULATOR = ("--port", "emulator")

# What is typed. Not here: `explore` serves until it is interrupted; `accuracy` and `table1` take minutes;
# `firmware` needs the compiler of a board.
DOCUMENTS: dict[str, tuple[str, ...]] = {
    "list": ("list",),
    "check problem": ("check", "small.toml"),
    "check device": ("check", "devices/phantom-omni"),
    "check rotary": ("check", "knob"),
    "solve direct": ("solve", "small.toml"),
    "solve closed-form": ("solve", "small.toml", "--method", "closed-form"),
    "solve as-printed": ("solve", "small.toml", "--as-printed"),
    "solve schedule": ("solve", "small.toml", "--method", "schedule"),
    "compare": ("compare", "small.toml", "--mine", "2000,5"),
    "certify gains": ("certify", "small.toml", "gains.csv"),
    "certify coupling": ("certify", "coupling.json"),
    "certify proved": ("certify", "coupling.json", "--prove"),
    "recommend": ("recommend", "small.toml", "--hands", "8"),
    "recommend stiffest": ("recommend", "small.toml", "--stiffest", "--hands", "8"),
    "simulate": ("simulate", "scenes/stiff-wall-pressed"),
    "simulate explained": ("simulate", "scenes/stiff-wall-pressed", "--explain"),
    "simulate coupling": ("simulate", "coupling.json"),
    "screen": ("simulate", "scenes/stiff-wall-pressed", "--screen"),
    "zwidth": ("zwidth", "small.toml"),
    "trial": ("trial", "coupling.json", "--hands", "16", "--workers", "1"),
    "identify": ("identify", "log.csv"),
    "diagnose": ("diagnose", "log.csv", "--problem", "small.toml"),
    "export": ("export", "coupling.json", "--c", "c"),
    "export refused": ("export", "gains.csv", "--problem", "figure5", "--c", "c"),
    "excite planned": ("excite", "small.toml", "--plan-only", "--seconds", "4"),
    "excite": ("excite", "small.toml", "--seconds", "4", "--out", "excited.csv"),
    "push": ("push", "coupling.json", *_EMULATOR),
    "stream": ("stream", "coupling.json", *_EMULATOR, "--seconds", "0.2"),
    "monitor": ("monitor", *_EMULATOR, "--seconds", "0.4"),
    "clear": ("device", "--clear", *_EMULATOR),
    "limits": ("device", "--limits", *_EMULATOR, "--force-n", "1"),
    "ports": ("doctor", "--ports"),
    "doctor": ("doctor",),
    "run": ("run", "small.toml", "--out", "results"),
}


def document(case: str) -> dict[str, Any]:
    """Return exit code, and path and type of everything in the document of a verb."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "small.toml").write_text(SMALL, encoding="ascii")
        rows = "".join(f"{f},{b},{k}\n" for f, b, k in ((1.0, 5.0, 2e6), (10.0, 6.0, 2e6), (100.0, 8.0, 1e6)))
        (folder / "gains.csv").write_text(f"frequency_hz,damping_ns_per_m,stiffness_n_per_m\n{rows}", encoding="ascii")
        (folder / "coupling.json").write_bytes(coupling_file("wall").read_bytes())
        (folder / "log.csv").write_text(_log(), encoding="ascii")
        code, found = avc(*DOCUMENTS[case], folder=folder)
    types: dict[str, set[str]] = {}
    _note(found, "", types)
    return {"exit_code": code, "keys": [f"{path}: {'|'.join(sorted(types[path]))}" for path in sorted(types)]}


def _note(value: Any, path: str, types: dict[str, set[str]]) -> None:
    kinds = {dict: "object", list: "list", str: "text", bool: "bool", int: "number", float: "number"}
    types.setdefault(path, set()).add("null" if value is None else kinds[type(value)])
    if path.rpartition(".")[2] in _OF_THE_MACHINE:
        return
    if isinstance(value, dict):
        for key, one in value.items():
            _note(one, f"{path}.{key}", types)
    if isinstance(value, list):
        for one in value:
            _note(one, f"{path}[]", types)


def _log() -> str:
    """A mass on a damper and a weak spring, driven by 40 tones for 4 s."""
    step, mass, damping, spring = 1e-3, 0.12, 0.8, 50.0
    seconds, random = np.arange(4000) * step, np.random.default_rng(0)
    tones = np.geomspace(0.5, 100.0, 40)
    force = 0.3 * np.cos(2 * np.pi * tones[:, None] * seconds + random.uniform(0, 6, (40, 1))).sum(axis=0)
    lines, position, speed = ["time_s,position_m,force_N"], 0.0, 0.0
    for t, push in zip(seconds, force, strict=True):
        lines.append(f"{t:.3f},{position:.8f},{push:.6f}")
        speed += (push - damping * speed - spring * position) / mass * step
        position += speed * step
    return "\n".join(lines) + "\n"
