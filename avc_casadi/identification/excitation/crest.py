"""Phases of a multisine for a low crest factor: Schroeder's, then a norm of rising order (Guillaume et al. 1991)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from avc_casadi._util.arrays import FloatArray

_ORDERS = (4, 8, 16, 32)
_STEPS = 60


def schroeder_phases(power: FloatArray) -> FloatArray:
    """Return Schroeder's phases (1970) of tones in order of frequency, rad, shape (tones,).

    Args:
        power: of each tone, in any unit.
    """
    share = power / power.sum()
    return np.asarray(-2 * np.pi * np.cumsum(np.concatenate([[0.0], np.cumsum(share)[:-1]])), dtype=np.float64)


def low_crest_phases(frequency_hz: FloatArray, power: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return phases with which the largest force of a multisine is small, rad, shape (tones,).

    Args:
        frequency_hz: of the tones, rising, shape (tones,).
        power: of each, shape (tones,).
        time_s: at which the force counts, shape (samples,).
    """
    amplitude = np.sqrt(2 * power / power.sum())
    turns = np.outer(time_s, 2 * np.pi * frequency_hz)
    cosine, sine = np.cos(turns) * amplitude, np.sin(turns) * amplitude

    def norm(phase: FloatArray, order: int) -> tuple[float, FloatArray]:
        wave = sine @ np.cos(phase) + cosine @ np.sin(phase)
        size = np.abs(wave)
        top = float(size.max())
        relative = (size / top) ** (order - 1)
        mean = float(np.mean(relative * size / top))
        pull = np.sign(wave) * relative / (wave.size * mean)
        slope = (pull @ cosine) * np.cos(phase) - (pull @ sine) * np.sin(phase)
        return float(np.log(top) + np.log(mean) / order), np.asarray(slope / top, dtype=np.float64)

    phase = schroeder_phases(power)
    for order in _ORDERS:
        found = minimize(norm, phase, args=(order,), jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
        phase = np.asarray(found.x, dtype=np.float64)
    return phase


def crest_factor(wave: FloatArray) -> float:
    """Return the largest magnitude over the root mean square."""
    return float(np.abs(wave).max() / np.sqrt(np.mean(wave**2)))
