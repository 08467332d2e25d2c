"""Identification of devices drawn at random: do the stated intervals hold the truth, and what is refused.

nice -n 10 python tests/benchmarks/identification.py --count 1000 --write
nice -n 10 python tests/benchmarks/identification.py --count 40 --amplifier --write
nice -n 10 python tests/benchmarks/identification.py --count 40 --lost 0.005 --write
nice -n 10 python tests/benchmarks/identification.py --count 60 --seconds 30 --write

Each device is simulated by `tests/measured_device.c`, which shares no code with the project: a multisine beside a weak
controller, an encoder of 2 to 61 um, friction of 0 to 2 N, a delay of 0 to 3 samples, no resonance or one of 60 to 300
Hz, noise and a drifting force. With --write it overwrites identification.json and RESULTS_identification.md after
every device and goes on where it stopped; without it the results are printed only. With --amplifier no device has a
resonance and each an amplifier of 80 to 1000 Hz, and the results are identification_amplifier.json. With --lost this
share of the rows is missing, which cuts a log into pieces, and the results are identification_lost.json. Logs of
another length than 10 s go to identification_long.json: their intervals are narrower, what a model leaves out is not.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, kept_rows, made_by, write_rows

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent.parent / "hardware")]

from measured_device import Truth, measured, multisine  # noqa: E402 - found beside the tests

from avc_casadi._util.arrays import BoolArray, FloatArray  # noqa: E402
from avc_casadi.identification.identify import identify  # noqa: E402
from avc_casadi.identification.record import (  # noqa: E402
    Columns,
    Record,
    records_of,
)

OUT = HERE / "results" / "identification.json"
WITH_AMPLIFIER = HERE / "results" / "identification_amplifier.json"
WITH_GAPS = HERE / "results" / "identification_lost.json"
LONGER = HERE / "results" / "identification_long.json"
PAGE = HERE / "RESULTS_identification.md"
PARTS = {WITH_AMPLIFIER: "With amplifiers", WITH_GAPS: "With lost rows", LONGER: "Of longer logs"}
SEED = 15
SECONDS = 10.0
KEYS = {
    "mass_kg": "mass",
    "damping_ns_per_m": "damping",
    "delay_samples": "delay",
    "coulomb_friction_n": "coulomb",
    "encoder_resolution_m": "encoder",
    "position_noise_rms_m": "noise",
    "amplifier_bandwidth_hz": "bandwidth",
    "amplifier_damping_ratio": "loop_damping",
    "resonance.frequency_hz": "resonance",
    "resonance.damping_ratio": "ratio",
    "resonance.mass_ratio": "share",
    "offset_n": "offset",
    "offset_drift_n_per_s": "drift",
}


def drawn(index: int, seed: int, *, amplifier: bool = False) -> tuple[dict[str, float], dict[str, float]]:
    """Draw a device and how it is excited; the same for an index whatever the count."""
    random = np.random.default_rng([seed, index])

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
    mode = {
        "resonance": log(60.0, 300.0),
        "ratio": log(0.01, 0.1),
        "share": float(random.uniform(0.15, 0.6)),
        "at_handle": float(random.random() < 0.3),
    }
    if random.random() < 0.5 and not amplifier:
        device |= mode
    noise = log(1e-6, 2e-5) if random.random() < 0.5 else 0.0
    excited = {"rms": max(1.0, float(random.uniform(1.2, 3.0)) * device["coulomb"]), "noise": noise}
    if amplifier:
        device["bandwidth"] = log(80.0, 1000.0)
        device["loop_damping"] = log(0.35, 1.4) if index % 2 else 0.0
    return device, excited


def one(index: int, seed: int, seconds: float, *, amplifier: bool = False, lost: float = 0.0) -> dict[str, Any]:
    """Simulate, identify and judge one device."""
    device, excited = drawn(index, seed, amplifier=amplifier)
    random = np.random.default_rng([seed, index, 1])
    truth = Truth(**device)
    wanted = multisine(random, seconds, truth.period, 0.5, 300.0, excited["rms"])
    _, position, force = measured(truth, wanted, random, noise=excited["noise"])
    before = _cpu()
    whole = [Record("drawn", truth.period, position, force)]
    found = identify(pieces(random.random(position.size) < lost, truth.period, position, force) if lost else whole)
    row: dict[str, Any] = {"index": index, "cpu_s": _cpu() - before, "terms": list(found.terms), "keys": {}}
    true = {key: device.get(name, 0.0) for key, name in KEYS.items()}
    if amplifier and "amplifier_bandwidth_hz" not in found.estimates:
        # Its lag is then said to be part of the delay.
        true["delay_samples"] += (2 * truth.loop_damping or 1.0) / (2 * np.pi * truth.bandwidth * truth.period)
    true["position_noise_rms_m"] = excited["noise"]
    if not device.get("resonance"):
        true = {key: value for key, value in true.items() if not key.startswith("resonance")}
    if not amplifier:
        del true["amplifier_bandwidth_hz"]
    if not truth.loop_damping:
        del true["amplifier_damping_ratio"]
    row["mode"] = bool(device.get("resonance"))
    row["side_right"] = None
    if row["mode"] and "resonance" in found.terms:
        row["side_right"] = found.encoder_at == ("handle" if device["at_handle"] else "motor")
    for key, value in true.items():
        estimate = found.estimates.get(key)
        if estimate is None:
            row["keys"][key] = None
            continue
        half = (estimate.high - estimate.low) / 2
        row["keys"][key] = {
            "inside": bool(estimate.low <= value <= estimate.high),
            "true": value,
            "value": estimate.value,
            "half": half,
        }
    row["false_mode"] = not row["mode"] and "resonance" in found.terms
    return row


def pieces(lost: BoolArray, period_s: float, position_m: FloatArray, force_n: FloatArray) -> list[Record]:
    """Return the records of a log without the rows that are lost."""
    time = np.flatnonzero(~lost) * period_s
    found, faults, _ = records_of(Columns("drawn", time, position_m[~lost], force_n[~lost]))
    assert not faults
    return found


def _cpu() -> float:
    return sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def page() -> str:
    """Return the results as text, the main study first."""
    study = json.loads(OUT.read_text(encoding="utf-8"))
    text = table_of(study["rows"], study["about"])
    for path, heading in PARTS.items():
        if path.exists():
            more = json.loads(path.read_text(encoding="utf-8"))
            text += "\n" + table_of(more["rows"], more["about"], heading)
    return text


def table_of(rows: list[dict[str, Any]], made: Mapping[str, Any], of: str = "") -> str:
    """Return one study as text."""
    seconds = made["seconds"]
    devices = {
        "With amplifiers": "As above, but each device has an amplifier of 80 to 1000 Hz, every other "
        "one of the second order with a damping ratio of 0.35 to 1.4, and none a resonance. "
        "Where the amplifier is not told, the delay is said to hold its lag, and is compared with both. "
        "Numbers as above.",
        "Of longer logs": "As above, but of longer logs. Numbers as above.",
        "With lost rows": f"As above, but {100 * made.get('lost', 0.0):g} % of the rows are missing, at random; "
        "of the pieces the longer ones are taken. Numbers as above.",
        "": (__doc__ or "").split("\n\n")[2].partition(" With --write")[0].replace("\n", " ")
        + " *Inside*: share of stated intervals (95 %) that hold the truth, of those told. *Bias* and *error*: median "
        "of (found - true) and of its size, as shares of the truth (delay in samples, offset in N, drift in N/s, noise "
        "in um). *Interval*: median half width in the same unit.",
    }[of]
    lines = [
        f"## {of}" if of else "# Identification of devices drawn at random",
        "",
        made_by(made),
        "",
        f"{len(rows)} devices, {seconds:g} s of log each at 1 kHz. {devices}",
        "",
        "| what | asked of | refused | inside | bias | error | interval |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    absolute = {"delay_samples": 1.0, "offset_n": 1.0, "offset_drift_n_per_s": 1.0, "position_noise_rms_m": 1e6}
    for key in KEYS:
        asked = [row for row in rows if key in row["keys"]]
        told = [row["keys"][key] for row in asked if row["keys"][key] is not None]
        if not told:
            continue
        inside = np.mean([each["inside"] for each in told])
        usable = [each for each in told if key in absolute or each["true"] > 0]
        scale = [absolute.get(key) or 1 / each["true"] for each in usable]
        errors = [(each["value"] - each["true"]) * by for each, by in zip(usable, scale, strict=True)]
        halves = [each["half"] * by for each, by in zip(usable, scale, strict=True)]
        refused = 100 * (1 - len(told) / len(asked))
        middle = [np.median(errors), np.median(np.abs(errors)), np.median(halves)] if errors else [np.nan] * 3
        lines.append(
            f"| {key} | {len(asked)} | {refused:.0f} % | {100 * inside:.1f} % | {middle[0]:+.2g} | {middle[1]:.2g} "
            f"| {middle[2]:.2g} |"
        )
    modes = [row for row in rows if row["mode"]]
    found = [row for row in modes if row["side_right"] is not None]
    plain = [row for row in rows if not row["mode"]]
    time = [row["cpu_s"] for row in rows]
    right, claimed = sum(bool(row["side_right"]) for row in found), sum(row["false_mode"] for row in plain)
    of_modes = (
        f"A resonance was found in {len(found)} of {len(modes)} devices that have one, the side of the encoder right "
        f"in "
        f"{right}; one was claimed in {claimed} of {len(plain)} that have none."
    )
    of_time = (
        f"Processor time a log: median {np.median(time):.1f} s, 95 % below {np.quantile(time, 0.95):.1f} s (the "
        f"share of the "
        "compiler is in the first of each kind)."
    )
    lines += ["", of_modes, "", of_time, ""] if modes else ["", of_time, ""]
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--amplifier", action="store_true", help="devices with an amplifier and without resonance")
    parser.add_argument("--lost", type=float, default=0.0, help="share of the rows that are lost")
    parser.add_argument("--write", action="store_true", help="overwrite the results file and the page")
    args = parser.parse_args()
    more = f"{f' --seed {args.seed}' if args.seed != SEED else ''}{' --amplifier' if args.amplifier else ''}"
    more += f" --lost {args.lost:g}" if args.lost else ""
    more += f" --seconds {args.seconds:g}" if args.seconds != SECONDS else ""
    made = about(f"python tests/benchmarks/identification.py --count {args.count}{more} --write", args.seed)
    made["seconds"], made["first"] = args.seconds, args.first
    if args.lost:
        made["lost"] = args.lost
    out = WITH_GAPS if args.lost else WITH_AMPLIFIER if args.amplifier else OUT
    out = LONGER if args.seconds != SECONDS else out
    rows = kept_rows(out, made) if args.write else []
    for index in range(args.first + len(rows), args.first + args.count):
        row = one(index, args.seed, args.seconds, amplifier=args.amplifier, lost=args.lost)
        rows.append(row)
        missed = [
            f"{key} {each['value']:.4g}+-{each['half']:.2g} ({each['true']:.4g})"
            for key, each in row["keys"].items()
            if each is not None and not each["inside"]
        ]
        print(
            f"{index}: {row['cpu_s']:.1f} s, {' '.join(row['terms'])}; outside: {', '.join(missed) or 'none'}",
            flush=True,
        )
        if args.write:
            write_rows(out, made, rows)
            PAGE.write_text(page(), encoding="utf-8")
    print(table_of(rows, made, PARTS.get(out, "")))


if __name__ == "__main__":
    main()
