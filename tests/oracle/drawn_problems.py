"""Random problems over eight decades of each parameter, both hold models, with delay and contact damping."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import avc_casadi as avc
from avc_casadi.model.problem import Problem


@cache
def walled() -> tuple[str, ...]:
    """Problems of the catalogue with a wall in the device's own loop: the others, `tool/`, refuse to be solved."""
    return tuple(entry.name for entry in avc.catalogue() if avc.load_problem(entry.name).simulation is None)


def drawn_problem(rng: np.random.Generator, *, frequencies: int = 8, structure: str | None = None) -> Problem:
    """Draw a valid problem; some of its values are 0, some of its gain boxes are narrow, flat or infeasible."""

    def decades(low: float, high: float) -> float:
        return float(10 ** rng.uniform(low, high))

    def interval(low: float, high: float) -> tuple[float, float]:
        ends = sorted((decades(low, high), decades(low, high)))
        if rng.random() < 0.2:
            ends[0] = 0.0
        if rng.random() < 0.05:
            ends[1] = ends[0]
        return ends[0], ends[1]

    structure = structure or str(rng.choice(["series", "damped"]))
    sample_time = decades(-6.9, 0.6)
    # Stiffness and mass matter by k T and m/T, which are drawn over eight decades each.
    b_e, k_e = decades(-3, 5), min(max(decades(-4, 4) / sample_time, 1e-9), 1e12)
    if rng.random() < 0.05:
        b_e = 0.0
    if rng.random() < 0.05:
        k_e = 0.0
    high, low = 1.0 + rng.uniform(-0.2, 0.2, 2), rng.uniform(0.1, 0.8, 2)
    upper = {"damping_ns_per_m": b_e * high[0], "stiffness_n_per_m": k_e * high[1]}
    lower = {"damping_ns_per_m": b_e * low[0], "stiffness_n_per_m": k_e * low[1]}
    if rng.random() < 0.25:
        upper = {"damping_ns_per_m": decades(-3, 5), "stiffness_n_per_m": decades(-4, 4) / sample_time}
        lower = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 0.0}
    shares = np.unique(rng.uniform(-5, np.log10(0.999), frequencies))
    document: dict[str, Any] = {
        "name": "drawn",
        "device": {
            "mass_kg": decades(-4, 4) * sample_time if rng.random() < 0.9 else 0.0,
            "damping_ns_per_m": decades(-3, 5) if rng.random() < 0.9 else 0.0,
            "sample_time_s": sample_time,
            "delay_samples": int(rng.choice([0, 0, 0, 1, 2, 5, 20])),
        },
        "environment": {"damping_ns_per_m": b_e, "stiffness_n_per_m": k_e},
        "boundaries": {"upper": upper, "lower": lower},
        "coupling": {
            "structure": structure,
            "damping_ns_per_m": interval(-4, 6),
            "stiffness_n_per_m": tuple(min(k / sample_time, 1e12) for k in interval(-5, 6)),
            "contact_damping_ns_per_m": interval(-3, 5) if structure == "damped" else (0.0, 0.0),
        },
        "stability": {
            "model": str(rng.choice(["paper", "sampled-data"])),
            "margin_ns_per_m": 0.0 if rng.random() < 0.7 else decades(-3, 3),
        },
        "scene": {"duration_s": max(3.0, 3 * sample_time)},
        "frequency": {"values_hz": [float(0.5 / sample_time * 10**share) for share in shares]},
    }
    return Problem.model_validate(_in_range(document))


def _in_range(value: Any) -> Any:
    """Turn values below the smallest admitted magnitude into 0, which is admitted."""
    if isinstance(value, dict):
        return {key: _in_range(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_in_range(item) for item in value)
    return 0.0 if isinstance(value, float) and value < 1e-9 else value
