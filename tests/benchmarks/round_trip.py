"""Round trip without a hand on it: hidden device -> excite -> identify -> excite again -> recommend -> push -> at rest.

nice -n 10 python tests/benchmarks/round_trip.py --count 24 --write

Each device is drawn at random within what its file guesses, and stands on an emulated board that runs the packaged
firmware image. The commands `avc excite`, `avc identify` and `avc recommend` know of it by that board alone; the
coupling is then pushed to a board with the hidden device and a hand presses the wall, dry friction left out. With
--write it overwrites round_trip.json and RESULTS_round_trip.md after every device and goes on where it stopped; without
it the results are printed only.
"""

from __future__ import annotations

import argparse
import io
import json
import tempfile
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, kept_rows, made_by, write_rows

from avc_casadi import load_device, read_coupling
from avc_casadi.cli import main
from avc_hardware import tried_in_the_loop

HERE = Path(__file__).parent
OUT = HERE / "results" / "round_trip.json"
PAGE = HERE / "RESULTS_round_trip.md"
SEED = 16
HANDS = 30
KEYS = ("mass_kg", "damping_ns_per_m", "delay_samples", "coulomb_friction_n")
GUESS = {"mass_kg": 0.12, "damping_ns_per_m": 1.0, "delay_samples": 1.0, "coulomb_friction_n": 0.15}
RANGE = {
    "mass_kg": (0.05, 0.25),
    "damping_ns_per_m": (0.2, 4.0),
    "delay_samples": (0.0, 3.0),
    "coulomb_friction_n": (0.0, 0.4),
}
WALLS_N_PER_M = (1000.0, 2000.0, 3000.0)
HEAD = """# Round trip

{made_by}

Hidden device on an emulated board -> `avc excite` (guessed: mass 0.05 to 0.25 kg, damping 0.2 to 4 N.s/m, friction 0 to
0.4 N, delay 0 to 3 samples; known: encoder 20 um, 8 N, 1 kHz) -> `avc identify` -> `avc excite` with what was found ->
`avc identify` of both logs -> `avc recommend` -> push -> the middle hand presses, on the hidden device without its
friction. One script, no hand on it. The bench has mass, damping, Coulomb friction, delay and encoder as hidden; it has
no backlash, no gravity, no resonance, and friction that is the same at every speed.

"Off by": mass, damping, friction in per cent, delay in samples. "Inside": intervals of 95 % that hold the truth, from
the first log and from both.

| | kg, N.s/m, samples, N | lost | off by, first log | off by, both | inside | wall N/m | felt | in loop | at rest |
|--:|---|--:|---|---|---|--:|--:|--:|---|
"""


def device_toml(values: dict[str, float], ranges: bool) -> str:
    """Return a device file with an encoder of 20 um, 8 N and 1 kHz."""
    lines = [f"{key} = {value!r}" for key, value in values.items()]
    wide = [f"{key} = [{low!r}, {high!r}]" for key, (low, high) in RANGE.items()] if ranges else []
    sources = [f'{key} = {{ grade = "assumed", source = "drawn or guessed" }}' for key in values]
    known = ("sample_time_s = 1e-3", "encoder_resolution_m = 2e-5", "max_force_n = 8.0")
    sources += [f'{one.split()[0]} = {{ grade = "vendor", source = "stated" }}' for one in known]
    return "\n".join(
        [
            'title = "A device of the round trip"',
            'gaps = ["position_noise_rms_m", "amplifier_bandwidth_hz", "backlash_m", "resonance"]',
            "[device]",
            *known,
            *lines,
            *(["[device.range]", *wide] if ranges else []),
            "[sources]",
            *sources,
            "",
        ]
    )


def problem_toml(device: str, wall: float) -> str:
    """Return a problem with a wall before a device."""
    return f"""title = "Wall of the round trip"
device = "{device}"
[environment]
damping_ns_per_m = 0.0
stiffness_n_per_m = {wall}
[coupling]
structure = "damped"
damping_ns_per_m = [0.0, 1e4]
stiffness_n_per_m = [0.0, 1e7]
contact_damping_ns_per_m = [0.0, 200.0]
[stability]
model = "sampled-data"
scope = "hands"
[realism]
objective = "complex"
"""


def drawn(index: int) -> dict[str, float]:
    """Draw a hidden device; the same for an index whatever the count."""
    random = np.random.default_rng([SEED, index])
    values = {key: float(random.uniform(*RANGE[key])) for key in ("delay_samples", "coulomb_friction_n")}
    for key in ("mass_kg", "damping_ns_per_m"):
        values[key] = float(np.exp(random.uniform(*np.log(RANGE[key]))))
    return {key: round(values[key], 4) for key in KEYS}


def avc(*arguments: object) -> tuple[int, dict[str, Any]]:
    """Run a command as a user would; return its exit code and its document."""
    said = io.StringIO()
    with redirect_stdout(said):
        code = main([*map(str, arguments), "--json"])
    document: dict[str, Any] = json.loads(said.getvalue())
    return code, document


def trip(index: int) -> dict[str, Any]:
    """Make one round trip."""
    hidden, wall = drawn(index), WALLS_N_PER_M[index % len(WALLS_N_PER_M)]
    row: dict[str, Any] = {"index": index, "hidden": hidden, "wall_n_per_m": wall}
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        base, mine, there = folder / "base.toml", folder / "mine.toml", folder / "hidden.toml"
        base.write_text(device_toml(GUESS, ranges=True))
        there.write_text(device_toml(hidden, ranges=False))
        logs: list[Path] = []
        for device in (base, mine):
            logs.append(folder / f"log{len(logs) + 1}.csv")
            code, played = avc("excite", device, "--on-bench", there, "--out", logs[-1])
            round_ = {
                "code": code,
                "log": played.get("log"),
                "peak_force_n": played.get("plan", {}).get("peak_force_n"),
            }
            code, found = avc("identify", *logs, "--device", base, "--out", mine)
            round_["estimates"] = {key: found.get("estimates", {}).get(key) for key in KEYS}
            row.setdefault("rounds", []).append(round_)
            if code:
                return row | {"stopped": f"identify ended with {code}"}
        problem, file = folder / "problem.toml", (folder / "coupling").with_suffix(".json")
        problem.write_text(problem_toml(mine.name, wall))
        code, found = avc("recommend", problem, "--hands", HANDS, "--out", file)
        row["deployable"] = bool(found.get("deployable"))
        if code:
            return row | {"stopped": f"recommend ended with {code}"}
        row["felt_n_per_m"] = found["felt"]["stiffness_n_per_m"]
        tried = tried_in_the_loop(read_coupling(file), device=load_device(there).device)
        row["tried"] = tried.document()
    return row | {"seconds": time.monotonic() - start}


def inside(row: dict[str, Any], which: int) -> tuple[int, int]:
    """Return how many intervals hold the truth, of how many told."""
    told = [(key, one) for key, one in row["rounds"][which]["estimates"].items() if one is not None]
    return sum(one["low"] <= row["hidden"][key] <= one["high"] for key, one in told), len(told)


def page(rows: list[dict[str, Any]], made: Mapping[str, Any]) -> str:
    """Return the results."""
    whole = [row for row in rows if len(row.get("rounds", ())) == 2]
    lines = HEAD.format(made_by=made_by(made)).splitlines()
    lines += [_line(row) for row in rows]
    rest = sum(bool(row.get("tried", {}).get("at_rest")) for row in rows)
    counts = [np.sum([inside(row, which) for row in whole], axis=0) for which in (0, 1)] if whole else [(0, 0)] * 2
    played = sum(round_["code"] == 0 for row in rows for round_ in row.get("rounds", ()))
    lines += [
        "",
        f"- at rest: {rest} of {len(rows)}",
        f"- played to the end within the limits: {played} of {sum(len(row.get('rounds', ())) for row in rows)}",
        "- intervals of 95 % that hold the truth: {} of {} from the first log, {} of {} from both".format(
            *counts[0], *counts[1]
        ),
        f"- largest error from both logs, relative (delay: in samples): {_largest(whole)}",
        f"- seconds a trip, median: {np.median([row['seconds'] for row in rows if 'seconds' in row] or [0]):.0f}",
    ]
    stopped = [f"- device {row['index']}: {row['stopped']}" for row in rows if "stopped" in row]
    return "\n".join([*lines, *stopped, ""])


def _line(row: dict[str, Any]) -> str:
    rounds, tried = row.get("rounds", []), row.get("tried")
    lost = sum((round_["log"] or {}).get("lost", 0) for round_ in rounds)
    off = [_off(row["hidden"], round_["estimates"]) for round_ in rounds] + ["-"] * (2 - len(rounds))
    held = ", ".join("{} of {}".format(*inside(row, which)) for which in range(len(rounds)))
    felt = f"{row['felt_n_per_m']:.0f}" if "felt_n_per_m" in row else "-"
    loop = tried and tried["apparent_stiffness_n_per_m"]
    end = "yes" if tried and tried["at_rest"] else "**no**"
    hidden = ", ".join(f"{row['hidden'][key]:g}" for key in KEYS)
    looped = f"{loop:.0f}" if loop else "-"
    return (
        f"| {row['index']} | {hidden} | {lost} | {off[0]} | {off[1]} | {held} | {row['wall_n_per_m']:.0f} | {felt} | "
        f"{looped} | {end} |"
    )


def _error(key: str, truth: float, one: dict[str, Any]) -> float:
    error = float(one["value"] - truth)
    return error if key == "delay_samples" else error / truth


def _off(hidden: dict[str, float], estimates: dict[str, Any]) -> str:
    parts = []
    for key in KEYS:
        one = estimates[key]
        if one is None:
            parts.append("-")
        elif key == "delay_samples":
            parts.append(f"{_error(key, hidden[key], one):+.3f}")
        else:
            parts.append(f"{100 * _error(key, hidden[key], one):+.2f} %")
    return ", ".join(parts)


def _largest(rows: list[dict[str, Any]]) -> str:
    parts = []
    for key in KEYS:
        told = [(row["hidden"][key], row["rounds"][1]["estimates"][key]) for row in rows]
        errors = [abs(_error(key, truth, one)) for truth, one in told if one is not None]
        parts.append(f"{key} {max(errors, default=float('nan')):.2g}")
    return ", ".join(parts)


def run() -> None:
    """Make the trips that are still to make."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=3, help="devices; default 3")
    parser.add_argument("--write", action="store_true", help=f"overwrites {OUT.name} and {PAGE.name}")
    arguments = parser.parse_args()
    made = about(f"python tests/benchmarks/round_trip.py --count {arguments.count} --write", SEED)
    rows = kept_rows(OUT, made) if arguments.write else []
    for index in range(len(rows), arguments.count):
        rows.append(trip(index))
        print(_line(rows[-1]), flush=True)
        if arguments.write:
            write_rows(OUT, made, rows)
            PAGE.write_text(page(rows, made))
    print(page(rows, made))


if __name__ == "__main__":
    run()
