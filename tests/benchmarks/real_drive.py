"""A real drive: identified from a record, and what the model says of the part of the record that it has not seen.

python tests/benchmarks/real_drive.py emps_pulses.csv --write

The record is not ours to publish. It is of the EMPS benchmark: A. Janot, M. Gautier, M. Brunot, Data set and reference
models of EMPS, Nonlinear System Identification Benchmarks 2019 (nonlinearbenchmark.org): a linear drive of about 95 kg
with strong friction at 1 kHz, in closed loop, with pulses of force. Its file holds time, position and motor voltage;
the CSV holds them as time_s, position_m and force_n, the voltage times the drive's gain plus the pulses.

Each half is identified alone, and a simulator of this script's own runs freely through the other, from its force alone;
ordinary least squares on filtered signals do the same beside it. With --write it overwrites real_drive.json; without it
the results are printed only.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from studied import about, cpu_seconds

from avc_casadi.identification.identify import identify
from avc_casadi.identification.log import Record
from avc_casadi.identification.read import read_logs

OUT = Path(__file__).parent / "results" / "real_drive.json"
SUBSTEPS = 10
# Least squares see the signals below this frequency, at every so manieth sample.
LOW_PASS_HZ = 60.0
EVERY = 5
KEYS = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "offset_n", "delay_samples")

Values = Mapping[str, float]
Array = NDArray[np.float64]


def filtered(record: Record) -> tuple[Array, Array, Array]:
    """Return force, velocity and acceleration without what lies above LOW_PASS_HZ, without a phase."""
    sections = signal.butter(4, LOW_PASS_HZ, fs=1 / record.sample_time_s, output="sos")
    force, position = (signal.sosfiltfilt(sections, values) for values in (record.force_n, record.position_m))
    velocity = np.gradient(position, record.sample_time_s)
    return force, velocity, np.gradient(velocity, record.sample_time_s)


def least_squares(record: Record) -> dict[str, float]:
    """Return mass, damping, dry friction and a constant force by ordinary least squares."""
    force, velocity, acceleration = (values[EVERY:-EVERY:EVERY] for values in filtered(record))
    columns = np.stack([acceleration, velocity, np.sign(velocity), -np.ones_like(force)], axis=1)
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    return dict(zip(("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "offset_n"), map(float, found), strict=True))


def simulated(values: Values, record: Record) -> tuple[Array, Array]:
    """Return position and velocity of a drive that starts as the record does and knows its force only."""
    h, size = record.sample_time_s / SUBSTEPS, record.position_m.size
    late = values.get("delay_samples", 0.0)
    where = np.arange(size * SUBSTEPS) / SUBSTEPS - late
    force = record.force_n[np.clip(np.floor(where).astype(int), 0, size - 1)] + values["offset_n"]
    mass, damping, dry = values["mass_kg"], values["damping_ns_per_m"], values["coulomb_friction_n"]
    x, v = float(record.position_m[0]), float(filtered(record)[1][0])
    positions, velocities = np.empty(size), np.empty(size)
    for k, push in enumerate(force.tolist()):
        if k % SUBSTEPS == 0:
            positions[k // SUBSTEPS], velocities[k // SUBSTEPS] = x, v
        drive = push - damping * v
        if v == 0.0:
            after = 0.0 if abs(drive) <= dry else h * (drive - np.copysign(dry, drive)) / mass
        else:
            after = v + h * (drive - np.copysign(dry, v)) / mass
            after = 0.0 if after * v < 0 else after
        x, v = x + h * (v + after) / 2, after
    return positions, velocities


def explained(measured: Array, model: Array) -> float:
    """Return the share of the variance that a model explains."""
    return float(1 - np.mean((measured - model) ** 2) / measured.var())


def unseen(values: Values, record: Record) -> dict[str, float]:
    """Say how a model does on a record that it was not fitted to."""
    position, velocity = simulated(values, record)
    return {
        "position": explained(record.position_m, position),
        "velocity": explained(filtered(record)[1], velocity),
        "position_rms_mm": float(1e3 * np.sqrt(np.mean((record.position_m - position) ** 2))),
    }


def identified(record: Record) -> dict[str, dict[str, float]]:
    """Return what `avc identify` says."""
    estimates = identify([record]).estimates
    return {
        key: {"value": estimates[key].value, "low": estimates[key].low, "high": estimates[key].high}
        for key in KEYS
        if key in estimates
    }


def main() -> None:
    """Identify the drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", metavar="CSV", type=Path, help="time_s, position_m, force_n")
    parser.add_argument("--write", action="store_true", help=f"overwrite results/{OUT.name}")
    args = parser.parse_args()
    records, notes = read_logs([args.log])
    (record,) = records
    before = cpu_seconds()
    whole = identified(record)
    found: dict[str, Any] = {
        "about": about("python tests/benchmarks/real_drive.py emps_pulses.csv --write", 0) | {"seed": "none"},
        "seconds": record.seconds,
        "sample_time_s": record.sample_time_s,
        "travel_m": float(np.ptp(record.position_m)),
        "notes": notes,
        "cpu_s": cpu_seconds() - before,
        "identified": whole,
        "least_squares": least_squares(record),
        "halves": [],
    }
    middle = record.position_m.size // 2
    halves = [
        Record(f"half {index}", record.sample_time_s, record.position_m[part], record.force_n[part])
        for index, part in enumerate((slice(0, middle), slice(middle, None)), start=1)
    ]
    for seen, other in (halves, halves[::-1]):
        model, plain = identified(seen), least_squares(seen)
        found["halves"].append(
            {
                "fitted_to": seen.name,
                "identified": model,
                "least_squares": plain,
                "other_identified": unseen({key: one["value"] for key, one in model.items()}, other),
                "other_least_squares": unseen(plain, other),
            }
        )
    text = json.dumps(found, indent=1)
    print(text)
    if args.write:
        OUT.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
