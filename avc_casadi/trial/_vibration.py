"""The vibration that is left at rest, against what a hand on a stylus detects."""

from __future__ import annotations

import numpy as np

from avc_casadi.support import FloatArray

# Peak displacement at the detection threshold of a hand in a pen-hold posture, approximately after Israr, Choi and Tan
# (IROS 2006, "Detection threshold and mechanical impedance of the hand in a pen-hold posture"); read off, indicative.
THRESHOLD_HZ = np.array([10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 500.0])
THRESHOLD_M = np.array([20e-6, 12e-6, 5e-6, 1.6e-6, 0.5e-6, 0.25e-6, 0.7e-6])
JUDGED_S = 0.5
QUIET = 1.0
"""Ratio below which a vibration is not detected."""
# Power of Hann's window beside that of its mean, squared.
_HANN_BANDWIDTH = 1.5


def felt_vibration(position_m: FloatArray, sample_time_s: float) -> FloatArray:
    """Return how many times the detection threshold the vibration at the end of runs amounts to.

    The peak displacement of each frequency from 10 to 500 Hz over its threshold; several add as the root of the sum of
    squares. The last half second counts, a straight drift taken out.

    Args:
        position_m: true position where the hand holds, shape (..., samples).
        sample_time_s: T.

    Returns:
        Shape (...); 1 is about noticeable, infinite where a run diverged.
    """
    last = position_m[..., -max(8, round(JUDGED_S / sample_time_s)) :]
    n = last.shape[-1]
    time = np.linspace(-1.0, 1.0, n)
    with np.errstate(invalid="ignore", over="ignore"):
        slope = (last * time).sum(axis=-1, keepdims=True) / (time**2).sum()
        moved = last - last.mean(axis=-1, keepdims=True) - slope * time
        window = np.hanning(n)
        peak = 2 * np.abs(np.fft.rfft(moved * window, axis=-1)) / window.sum()
        frequency = np.fft.rfftfreq(n, sample_time_s)
        heard = (frequency >= THRESHOLD_HZ[0]) & (frequency <= THRESHOLD_HZ[-1])
        ratio = peak[..., heard] / threshold_m(frequency[heard])
        whole = np.sqrt((ratio**2).sum(axis=-1) / _HANN_BANDWIDTH)
    return np.asarray(np.where(np.isfinite(whole), whole, np.inf))


def threshold_m(frequency_hz: FloatArray) -> FloatArray:
    """Return the peak displacement that is just detected, on straight lines in the logarithms, shape (n,)."""
    return np.asarray(np.exp(np.interp(np.log(frequency_hz), np.log(THRESHOLD_HZ), np.log(THRESHOLD_M))))
