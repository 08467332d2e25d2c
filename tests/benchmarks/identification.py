"""Identification of drawn devices: errors, and whether the stated intervals hold the truth.

nice -n 10 python tests/benchmarks/identification.py --count 200 --write

Each device is simulated by `tests/oracle/measured_device.c`, which shares no code with the project: 10 s of log
with a weak controller, an encoder of 2 to 61 um, friction of 0 to 2 N, a delay of 0 to 3 samples, half of them with
noise and a force that drifts. Six in ten are driven by a multisine at 1 kHz, half of these with a resonance of 60 to
300 Hz; two in ten have an amplifier of 80 to 400 Hz, one in ten is driven by steps, one in ten runs at 2 to 4 ms.
With --write it overwrites identification.json and RESULTS_identification.md; without it the table is printed only.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, made_by, write_rows

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "oracle"), str(HERE.parent.parent / "hardware")]

from measured_device import Truth, measured, multisine  # noqa: E402 - found beside the tests

import avc_casadi as avc  # noqa: E402
from avc_casadi.identification.identify import identify  # noqa: E402
from avc_casadi.identification.log import Record  # noqa: E402

OUT, PAGE = HERE / "results" / "identification.json", HERE / "RESULTS_identification.md"
SECONDS = 10.0
KEYS = {
    "mass_kg": "mass",
    "damping_ns_per_m": "damping",
    "coulomb_friction_n": "coulomb",
    "delay_samples": "delay",
    "amplifier_bandwidth_hz": "bandwidth",
    "resonance.frequency_hz": "resonance",
    "resonance.damping_ratio": "ratio",
}
# Largest error that counts as right: of the value, of the delay in samples.
RIGHT, RIGHT_SAMPLES = 0.03, 0.15
KINDS = ("rigid", "resonance", "rigid", "resonance", "amplifier", "rigid", "resonance", "steps", "amplifier", "slow")


def drawn(index: int, seed: int) -> tuple[dict[str, float], dict[str, float], str]:
    """Draw a device, how it is excited, and its kind; the same for an index whatever the count."""
    random = np.random.default_rng([seed, index])
    kind = KINDS[index % len(KINDS)]

    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    device = {
        "mass": log(0.03, 0.5),
        "damping": log(0.2, 5.0),
        "coulomb": float(random.uniform(0, 2)) if random.random() < 0.8 else 0.0,
        "delay": float(random.uniform(0, 3)),
        "encoder": log(2e-6, 61e-6),
        "offset": float(random.uniform(-0.2, 0.2)),
        "drift": float(random.uniform(-0.01, 0.01)) if random.random() < 0.5 else 0.0,
        "spring": log(20.0, 100.0),
    }
    excited = {
        "rms": max(1.0, float(random.uniform(1.2, 3.0)) * device["coulomb"]),
        "noise": log(1e-6, 2e-5) if random.random() < 0.5 else 0.0,
    }
    if kind == "resonance":
        device |= {
            "resonance": log(60.0, 300.0),
            "ratio": log(0.01, 0.1),
            "share": float(random.uniform(0.15, 0.6)),
            "at_handle": float(random.random() < 0.3),
        }
    if kind == "amplifier":
        device["bandwidth"] = log(80.0, 400.0)
        device["loop_damping"] = log(0.35, 1.4) if random.random() < 0.5 else 0.0
    if kind == "slow":
        device["period"] = float(random.uniform(2e-3, 4e-3))
    return device, excited, kind


def steps(random: np.random.Generator, count: int, rms: float, period: float) -> np.ndarray:
    """Return a force that jumps to another level every 20 to 200 ms."""
    lengths = random.integers(round(0.02 / period), round(0.2 / period), count)
    levels = np.repeat(random.choice([-1.0, -0.5, 0.5, 1.0], count), lengths)[:count]
    return levels * rms / levels.std()


def one(index: int, seed: int) -> dict[str, Any]:
    """Simulate, identify and judge one device."""
    device, excited, kind = drawn(index, seed)
    random = np.random.default_rng([seed, index, 1])
    truth = Truth(**device)
    count = round(SECONDS / truth.period)
    top = min(300.0, 0.3 / truth.period)
    wanted = multisine(random, SECONDS, truth.period, 0.5, top, excited["rms"])
    if kind == "steps":
        wanted = steps(random, count, excited["rms"], truth.period)
    _, position, force = measured(truth, wanted, random, noise=excited["noise"])
    before = time.process_time()
    row: dict[str, Any] = {"index": index, "kind": kind, "mode": bool(device.get("resonance")), "rungs": [], "keys": {}}
    try:
        found = identify([Record("drawn", truth.period, position, force)])
    except avc.InputError as error:
        return row | {"refused": str(error)}
    row |= {"cpu_s": round(time.process_time() - before, 2), "rungs": found.rungs}
    true = {key: device.get(name, 0.0) for key, name in KEYS.items()}
    if kind == "amplifier" and "amplifier_bandwidth_hz" not in found.estimates:
        # Its lag is then in the delay.
        true["delay_samples"] += (2 * truth.loop_damping or 1.0) / (2 * np.pi * truth.bandwidth * truth.period)
    for key, value in true.items():
        estimate = found.estimates.get(key)
        if estimate is not None and (value or key in {"coulomb_friction_n", "delay_samples"}):
            row["keys"][key] = [float(f"{x:.6g}") for x in (value, estimate.value, estimate.low, estimate.high)]
    return row


def table_of(rows: Sequence[Mapping[str, Any]], made: Mapping[str, Any]) -> str:
    """Return the study as a page."""
    lines = [
        "# Identification of drawn devices",
        "",
        made_by(made),
        "",
        " ".join((__doc__ or "").split("\n\n")[2].partition("\nWith --write")[0].split())
        + " *Right*: share of logs whose error is at most 3 % of the value (a delay: 0.15 samples; friction: of the "
        "value or of 0.1 N). *Error*: median, and below which 90 % lie, as a share of the value (a delay in samples). "
        "*Inside*: share of 95 % intervals that hold the truth.",
        "",
        "| what | logs | right | error | 90 % | inside |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for key in KEYS:
        told = np.array([row["keys"][key] for row in rows if key in row["keys"]]).reshape(-1, 4)
        if not len(told):
            continue
        true, value, low, high = told.T
        size = 1.0 if key == "delay_samples" else np.maximum(np.abs(true), 0.1) if key == "coulomb_friction_n" else true
        error = np.abs(value - true) / size
        right = np.mean(error <= (RIGHT_SAMPLES if key == "delay_samples" else RIGHT))
        inside = np.mean((low <= true) & (true <= high))
        lines.append(
            f"| {key} | {len(told)} | {100 * right:.1f} % | {np.median(error):.2g} | {np.quantile(error, 0.9):.2g} "
            f"| {100 * inside:.1f} % |"
        )
    modes, plain = ([row for row in rows if row["mode"] == there] for there in (True, False))
    found, claimed = (sum("resonance" in row["rungs"] for row in some) for some in (modes, plain))
    amplifiers = [row for row in rows if row["kind"] == "amplifier"]
    lags = sum(bool({"lag", "loop"} & set(row["rungs"])) for row in amplifiers)
    seconds = [row["cpu_s"] for row in rows if "cpu_s" in row]
    refused = sum("refused" in row for row in rows)
    of_rungs = (
        f"A resonance was found in {found} of {len(modes)} devices that have one, and claimed in {claimed} of "
        f"{len(plain)} that have none; an amplifier was distinguished from delay in {lags} of {len(amplifiers)}. "
        f"Refused: {refused}."
    )
    of_time = f"Processor time a log: median {np.median(seconds):.1f} s, 95 % below {np.quantile(seconds, 0.95):.1f} s."
    lines += ["", f"{of_rungs} {of_time}", ""]
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=4711)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", action="store_true", help="overwrite the results file and the page")
    args = parser.parse_args()
    made = about(
        f"python tests/benchmarks/identification.py --count {args.count} --seed {args.seed} --write", args.seed
    )
    rows = []
    with ProcessPoolExecutor(args.workers) as pool:
        for row in pool.map(partial(one, seed=args.seed), range(args.first, args.first + args.count)):
            rows.append(row)
            print(json.dumps(row), flush=True)
    if args.write:
        write_rows(OUT, made, rows)
        PAGE.write_text(table_of(rows, made), encoding="utf-8")
    print(table_of(rows, made))


if __name__ == "__main__":
    main()
