"""Bad and odd problem files through `avc check` and `avc recommend`: does check say whatever recommend refuses?

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/refusals.py --count 200

Overwrites results/refusals.json and RESULTS_refusals.md after every file, and goes on where it stopped. Half of the
files are refused when they are read; the others take some ten seconds of processor time each.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, campaign_text, made_by, table

from avc_casadi.cli import main as avc
from avc_casadi.files.toml import toml_value

_HERE = Path(__file__).parent
_OUT = _HERE / "results" / "refusals.json"
_PAGE = _HERE / "RESULTS_refusals.md"
SEED = 9106
_CHECKED_S = 2.0

_GRIP = {"mass_kg": [0.05, 0.3], "damping_ns_per_m": [3.0, 20.0], "stiffness_n_per_m": [200.0, 800.0]}
_STYLUS = {
    "mass_kg": 0.12,
    "damping_ns_per_m": 0.8,
    "delay_samples": 1,
    "encoder_resolution_m": 2e-5,
    "max_force_n": 8.0,
    "sample_time_s": 0.001,
}
BASES: dict[str, dict[str, dict[str, Any]]] = {
    "stylus": {
        "device": {
            "mass_kg": 0.12,
            "damping_ns_per_m": 0.8,
            "delay_samples": 1,
            "coulomb_friction_n": 0.1,
            "encoder_resolution_m": 2e-5,
            "max_force_n": 8.0,
            "sample_time_s": 0.001,
        },
        "environment": {"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 20.0},
        "hands": _GRIP,
    },
    "knob": {
        "device": {
            "motion": "rotary",
            "handle_radius_m": 0.03,
            "inertia_kgm2": 3e-5,
            "damping_nms_per_rad": 1e-4,
            "delay_samples": 1,
            "coulomb_friction_nm": 0.003,
            "encoder_resolution_rad": 0.0015,
            "max_torque_nm": 0.3,
            "sample_time_s": 0.001,
        },
        "environment": {"stiffness_nm_per_rad": 1.0, "damping_nms_per_rad": 0.01},
    },
    "slow stage": {
        "device": {
            "mass_kg": 1.5,
            "damping_ns_per_m": 2.0,
            "delay_samples": 2,
            "coulomb_friction_n": 2.0,
            "encoder_resolution_m": 1e-5,
            "max_force_n": 60.0,
            "sample_time_s": 0.002,
            "amplifier_bandwidth_hz": 300.0,
        },
        "environment": {"stiffness_n_per_m": 4000.0, "damping_ns_per_m": 100.0},
    },
    "engine": {
        "device": _STYLUS,
        "simulation": {"step_s": 0.002, "tool_mass_kg": 0.2},
    },
    "game wheel": {
        "device": {
            "motion": "rotary",
            "handle_radius_m": 0.15,
            "inertia_kgm2": 0.03,
            "damping_nms_per_rad": 0.02,
            "delay_samples": 1,
            "max_torque_nm": 8.0,
        },
        "simulation": {"step_s": 0.016, "exchange": "held-force", "steps_late": 1, "stiffness_nm_per_rad": 3.0},
    },
    "follower": {
        "device": _STYLUS,
        "follower": {"mass_kg": 0.3, "damping_ns_per_m": 1.0, "delay_samples": 1, "delay_s": 0.005},
    },
    "joint": {
        "simulation": {
            "tool_inertia_kgm2": [0.003, 0.01],
            "tool_damping_nms_per_rad": 0.01,
            "step_s": 0.005,
            "integrator": "implicit-damping",
        },
    },
    "own law": {
        "device": _STYLUS,
        "environment": {"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 20.0},
        "law": {"stiffness_n_per_m": 300.0, "damping_ns_per_m": 3.0, "integral_n_per_m_s": 50.0},
    },
    "guided arm": {
        "device": {
            "drive": "velocity",
            "drive_bandwidth_hz": 15.0,
            "sample_time_s": 0.002,
            "delay_samples": 2,
            "max_speed_m_per_s": 0.5,
        },
        "device.force_sensor": {
            "stiffness_n_per_m": 1e6,
            "damping_ratio": 0.02,
            "handle_mass_kg": 1.0,
            "noise_rms_n": 0.2,
            "resolution_n": 0.05,
            "max_force_n": 200.0,
        },
        "law": {"admittance": {"mass_kg": 12.0, "damping_ns_per_m": 300.0, "cutoff_hz": 40.0}},
        "hands": {"mass_kg": [0.5, 2.0], "damping_ns_per_m": [10.0, 40.0], "stiffness_n_per_m": [100.0, 1000.0]},
        "contact": {"stiffness_n_per_m": [0.0, 5e3], "damping_ns_per_m": 5.0},
    },
    "lightened rail": {
        "device": {
            "drive": "force",
            "mass_kg": 4.0,
            "damping_ns_per_m": 8.0,
            "sample_time_s": 0.0005,
            "delay_samples": 1,
            "amplifier_bandwidth_hz": 1000.0,
        },
        "device.force_sensor": {
            "stiffness_n_per_m": 2e4,
            "damping_ratio": 0.2,
            "handle_mass_kg": 0.3,
            "noise_rms_n": 0.05,
            "resolution_n": 0.01,
        },
        "law": {"force_feedback": {"gain": 1.0, "cutoff_hz": 200.0}, "damping_ns_per_m": 20.0},
    },
}
_TEXTS = ("fast", "1 kHz", "12 V", "nan", "-")


def drawn(index: int) -> dict[str, dict[str, Any]]:
    """Return a problem with one or two values changed: far off, absent, misspelt, of another type, or no number."""
    random = np.random.default_rng([SEED, index])
    base = copy.deepcopy(list(BASES.values())[index % len(BASES)])
    for _ in range(int(random.integers(1, 3))):
        table_name = str(random.choice(list(base)))
        values = base[table_name]
        inner = [value for value in values.values() if isinstance(value, dict)]
        # An inline table is changed inside.
        values = inner[0] if inner else values
        keys = [key for key, value in values.items() if not isinstance(value, str)]
        if not keys:
            continue
        key = str(random.choice(keys))
        _change(values, key, values[key], random)
    return base


def _change(values: dict[str, Any], key: str, value: Any, random: np.random.Generator) -> None:
    """Change one value of a table, most often by a power of ten."""
    way = random.choice(["scaled", "scaled", "scaled", "zero", "negative", "text", "absent", "misspelt", "huge"])
    if way == "scaled":
        factor = float(f"{10 ** random.uniform(-3.0, 3.0):.3g}")
        scaled = [float(f"{end * factor:.4g}") for end in value] if isinstance(value, list) else value * factor
        values[key] = scaled if isinstance(scaled, list) else float(f"{scaled:.4g}")
    elif way == "zero":
        values[key] = [0.0, 0.0] if isinstance(value, list) else 0
    elif way == "negative":
        values[key] = [-end for end in value] if isinstance(value, list) else -value
    elif way == "text":
        values[key] = str(random.choice(_TEXTS))
    elif way == "huge":
        values[key] = float(f"{10.0 ** random.uniform(8, 30):.3g}")
    else:
        del values[key]
        if way == "misspelt":
            values[key.replace("a", "e", 1)] = value


def text_of(problem: dict[str, dict[str, Any]]) -> str:
    """Return a problem as TOML."""
    lines = []
    for name, values in problem.items():
        lines.append(f"[{name}]")
        for key, value in values.items():
            numbers = value.items() if isinstance(value, dict) else ()
            inline = ", ".join(f"{inner} = {toml_value(number)}" for inner, number in numbers)
            lines.append(f"{key} = {{ {inline} }}" if numbers else f"{key} = {toml_value(value)}")
    return "\n".join(lines) + "\n"


def _said(words: list[str]) -> tuple[dict[str, Any] | None, str, float]:
    """Run a verb; returns its document, what it complains of where it has none, and its processor time."""
    output, errors = io.StringIO(), io.StringIO()
    begin = time.process_time()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        code = avc([*words, "--json"])
    took_s = time.process_time() - begin
    document = json.loads(output.getvalue())
    if code in (0, 1) and "errors" not in document:
        return document, "", took_s
    first = document["errors"][0]
    return None, f"{first['key']} {first['message']}", took_s


def judged(index: int) -> dict[str, Any]:
    """Return what check and recommend say of a drawn file."""
    problem = drawn(index)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "drawn.toml"
        file.write_text(text_of(problem), encoding="utf-8")
        checked, complaint, checked_s = _said(["check", str(file)])
        recommended, refused, recommended_s = _said(_command(problem, file))
    return {
        "file": problem,
        "valid": checked is not None,
        "check": complaint if checked is None else checked.get("refused", ""),
        "check_refuses": checked is None or bool(checked.get("refused")),
        "check_s": round(checked_s, 2),
        "recommend": refused if recommended is None else recommended.get("reason", ""),
        "recommend_refuses": _refused(recommended),
        "recommend_s": round(recommended_s, 2),
    }


def _command(problem: dict[str, dict[str, Any]], file: Path) -> list[str]:
    """Return the verb that uses a file, which is certify where the file has force feedback: its law is stated."""
    if "force_feedback" in problem.get("law", {}):
        return ["certify", str(file)]
    # Simulated hands choose no law for a joint or a force sensor.
    simulates_hands = "device" in problem and "device.force_sensor" not in problem
    return ["recommend", str(file), *(["--hands", "16"] if simulates_hands else [])]


def _refused(answer: dict[str, Any] | None) -> bool:
    """Return whether a verb gives nothing to deploy; of a stated law any verdict is an answer."""
    if answer is None:
        return True
    if answer["kind"].startswith("certify"):
        return False
    return not answer["stiffest"] if answer["kind"] == "recommend-joint" else not answer["deployable"]


_TEXT = """# Bad and odd files: does check say whatever recommend refuses?

{made_by}

{count} problem files, each one of {bases} with one or two values changed: far off, absent, misspelt, of another
type, or no number. A file with force feedback states its law: `certify` uses it, and any verdict is an answer. Times
are of the processor, the first file of a process with its imports.

{summary}

{rows}
"""


def _write_page(document: dict[str, Any]) -> None:
    cells = document["cells"]
    unread = [cell for cell in cells.values() if not cell["valid"]]
    refused = [cell for cell in cells.values() if cell["valid"] and cell["recommend_refuses"]]
    unlike = {name: cell for name, cell in cells.items() if cell["check_refuses"] != cell["recommend_refuses"]}
    times = np.array([cell["check_s"] for cell in cells.values()])
    late = int((times > _CHECKED_S).sum())
    summary = (
        f"{len(unread)} are refused when they are read, by both. Of the other {len(cells) - len(unread)} `recommend` "
        f"deploys nothing for {len(refused)}. Both agree on {len(cells) - len(unlike)} of {len(cells)}. `check` takes "
        f"{np.median(times):.2f} s (median), {times.max():.2f} s at most; {late} take more than {_CHECKED_S:g} s."
    )
    rows = [
        [name, cell["check"] or "-", f"{cell['recommend']} ({cell['recommend_s']} s)"] for name, cell in unlike.items()
    ]
    _PAGE.write_text(
        _TEXT.format(
            made_by=made_by(document["about"]),
            count=len(document["cells"]),
            bases=", ".join(BASES),
            summary=summary,
            rows=table(("file", "check", "recommend"), rows) if rows else "",
        ),
        encoding="utf-8",
    )


def main() -> None:
    """Run the study; the page is written after each file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="files, default 200")
    parser.add_argument("--workers", type=int, default=1, help="processes, default 1")
    options = parser.parse_args()
    command = "OPENBLAS_NUM_THREADS=1 python tests/benchmarks/refusals.py --count N"
    document: dict[str, Any] = {"about": about(command, SEED), "cells": {}}
    if _OUT.exists():
        document["cells"] = json.loads(_OUT.read_text(encoding="utf-8"))["cells"]
    left = [index for index in range(options.count) if f"file-{index}" not in document["cells"]]
    with ProcessPoolExecutor(options.workers) as pool:
        futures = {pool.submit(judged, index): index for index in left}
        for future in as_completed(futures):
            document["cells"][f"file-{futures[future]}"] = future.result()
            _OUT.write_text(campaign_text(document), encoding="utf-8")
            _write_page(document)


if __name__ == "__main__":
    main()
