"""How a hand feels an oscillation: that of the position, or what its force moves where an encoder shows one step."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.diagnosis.declared import Declared
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation, Swing
from avc_casadi.simulation.population.motions import felt_vibration, threshold_m

# An encoder that toggles between two counts moves by no more steps than that.
_TOGGLES = 1.5


def toggles(found: Oscillation) -> bool:
    """Return whether a position goes to and fro by one step of its encoder."""
    return found.steps < _TOGGLES


def felt(log: Log, swing: Swing, declared: Declared) -> float:
    """Return an oscillation as a multiple of what a hand on a stylus detects.

    Of one step of the encoder the size of the motion is not known, and its force is: the hand of the box that it moves
    the most counts. Where the force stands at its limit it moves nothing, and the position counts.

    Args:
        log: on its grid.
        swing: its oscillation.
        declared: the loop as it was meant.
    """
    found = swing.found
    if toggles(found) and np.ptp(log.force_n[(swing.first + swing.last) // 2 : swing.last]) > 0:
        return _moved_by_its_force(log, swing, declared)
    amplitude_m = log.reach_m * found.peak_to_peak_m / 2
    return amplitude_m / float(threshold_m(np.array([found.frequency_hz]))[0])


def _moved_by_its_force(log: Log, swing: Swing, declared: Declared) -> float:
    period, device, box = log.ticks.period_s, declared.device, declared.box()
    force = log.force_n[swing.first : swing.last]
    spectrum = np.fft.rfft(force - force.mean())[1:]
    angular = 2 * np.pi * np.fft.rfftfreq(force.size, period)[1:]

    def motion(mass_kg: float, damping_ns_per_m: float, stiffness_n_per_m: float) -> FloatArray:
        mass, damping = device.mass_kg + mass_kg, device.damping_ns_per_m + damping_ns_per_m
        moved = spectrum / (stiffness_n_per_m - mass * angular**2 + 1j * damping * angular)
        return np.asarray(log.reach_m * np.fft.irfft(np.append(0.0, moved), force.size))

    return max(float(felt_vibration(motion(**box.values(row)), period)) for row in range(len(box)))
