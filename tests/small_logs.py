"""Multisines of random phase, and records of logs."""

import numpy as np

from avc_casadi.identification.record import records_of


def multisine(peak, ticks, low_hz=1.0, high_hz=80.0, period=1e-3, seed=5):
    """Return a multisine of some peak whose sines, 40 at most, have a whole number of periods each."""
    time, seconds = np.arange(ticks) * period, ticks * period
    rates = np.unique(np.round(np.geomspace(low_hz, high_hz, 40) * seconds) / seconds)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, rates.size)
    sines = np.cos(2 * np.pi * rates[:, None] * time + phases[:, None]).sum(axis=0)
    return peak * sines / np.abs(sines).max()


def of(columns):
    """Return the records of a log without faults."""
    records, faults, _ = records_of(columns)
    assert not faults
    return records
