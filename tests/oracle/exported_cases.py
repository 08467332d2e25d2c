"""Random couplings and random motions, for tests of the exported C."""

from __future__ import annotations

import dataclasses

import numpy as np
from hardware_bench import believer, coupling

from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime


def drawn(seed: int) -> Coupling:
    """Any coupling: T of 0.1 to 3 ms; with and without observer, guard, delay, encoder, force limit, adaptation.

    The last seeds have an observer with state feedback. Two of three that have a spring in the wall clip last.
    """
    rng = np.random.default_rng(seed)
    time_s = float(np.exp(rng.uniform(np.log(1e-4), np.log(3e-3))))
    estimators = ("fused", "zero-crossing", "adaptive-notch", "spectral-peak")
    runtime = Runtime(
        estimator=estimators[seed // 2 % 4],
        hold_s=float(rng.uniform(0, 0.3)),
        slew_per_s=None if seed % 3 == 0 else float(rng.uniform(1, 50)),
        passive=seed % 5 != 0,
        observer_mass_kg=None if seed % 4 < 2 or seed >= 16 else float(rng.uniform(0.1, 0.5)),
        state_feedback=believer(seed) if seed >= 16 else None,
        guard=(None, "passivity-controller", "energy-tank")[seed % 3],
    )
    return coupling(
        (1, 7, 60, 1)[seed % 4],
        seed=seed,
        largest=(300.0, 1e5, (0.0, 50.0)[seed % 2]),
        wall=((0.0, 3e4), (10.0, 1e5), (5.0, 0.0))[seed % 3],
        runtime=runtime,
        contact="clip-last" if seed % 3 < 2 and seed % 7 > 1 else "gated",
        sample_time_s=time_s,
        encoder_resolution_m=float(rng.uniform(1e-6, 1e-4)),
        delay_samples=int(rng.integers(0, 4)),
        max_force_n=None if seed % 7 == 0 else float(rng.uniform(2, 20)),
    )


def motions(made: Coupling) -> FloatArray:
    """Taps that grow faster, a press with noise, jumps, and a stroke with what no sensor should say; (4, 500)."""
    samples = 500
    time = np.arange(samples) * made.sample_time_s
    rng = np.random.default_rng(1)
    step = made.problem.device.encoder_resolution_m
    broken = 1e-3 * np.sin(2 * np.pi * 7 * time)
    broken[[40, 41, 90, 150, 151, 220, 300]] = [np.nan, np.nan, np.inf, -np.inf, 3e38, 1e7, -np.nan]
    broken[350:360] = 9e5
    ways = [
        4e-4 * np.sin(2 * np.pi * (2 + 30 * time) * time),
        np.minimum(0.05 * time - 1e-3, 2e-3) + step * rng.integers(-1, 2, samples),
        np.where(np.arange(samples) // 60 % 2 == 0, 3e-3, -1e-3),
    ]
    return np.array([*(step * np.round(way / step) for way in ways), broken])


def notched(seed: int) -> Coupling:
    """The same with detents in front of the wall and in it: narrow and wide ones, with and without a damper."""
    made = drawn(seed)
    rng = np.random.default_rng(seed)
    detent = {
        "force_n": float(rng.uniform(0.3, 3.0)),
        "pitch_m": float(rng.uniform(3e-4, 3e-3)),
        "width": (1.0, 0.4)[seed % 2],
        "centre_m": float(rng.uniform(-2e-3, 0.0)),
        "damping_ns_per_m": (0.0, 1.5)[seed // 2 % 2],
    }
    return dataclasses.replace(made, problem=made.problem.changed(detent=detent))
