"""Devices and walls drawn at random, as studies of recommendations and laws have them.

This imports what release 0.3.0 has too: a study that compares the two draws the same devices in both.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import avc_casadi as avc
from avc_casadi.model.problem import Problem

SEED = 3355


def drawn(index: int, seed: int = SEED) -> Problem:
    """Draw a device and a wall; the same for an index whatever the count."""
    random = np.random.default_rng([seed, index])

    def log(low: float, high: float) -> float:
        return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.3g}")

    device: dict[str, Any] = {
        "sample_time_s": log(0.25e-3, 2e-3),
        "mass_kg": log(0.05, 0.5),
        "damping_ns_per_m": log(0.1, 5.0),
        "encoder_resolution_m": log(1e-6, 60e-6),
        "amplifier_bandwidth_hz": log(300.0, 3000.0),
    }
    whole, late = bool(random.random() < 0.5), float(random.uniform(0, 3))
    device["delay_samples"] = int(random.integers(0, 4)) if whole else round(late, 2)
    frictionless, friction = bool(random.random() < 0.3), float(random.uniform(0, 1))
    device["coulomb_friction_n"] = 0.0 if frictionless else round(friction, 2)
    rigid = bool(random.random() < 0.4)
    mode = {"frequency_hz": log(60.0, 300.0), "damping_ratio": log(0.02, 0.1), "mass_ratio": log(0.2, 0.6)}
    if not rigid:
        device["resonance"] = mode
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": log(500.0, 50e3)}
    box = avc.load_problem("reference-r1").coupling
    stop_hz = min(450.0, 0.45 / device["sample_time_s"])  # the default grid ends above the Nyquist frequency of some
    return Problem(
        device=device,
        environment=wall,
        coupling=box,
        stability={"model": "sampled-data", "scope": "hands"},
        frequency={"stop_hz": stop_hz},
    )
