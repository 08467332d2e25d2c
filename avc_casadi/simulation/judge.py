"""Verdicts on a run: settled or not, buzzing, rendered stiffness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi.model.device import Device
from avc_casadi.simulation.contact import Environment


@dataclass(frozen=True, eq=False)
class Ledger:
    """Energies at the samples, each of shape (..., samples), J."""

    absorbed_j: FloatArray
    stored_j: FloatArray

    @property
    def dissipated_j(self) -> FloatArray:
        """Absorbed and not stored energy; where it falls, sampling, delay or quantisation generate energy."""
        return self.absorbed_j - (self.stored_j - self.stored_j[..., :1])


def energy_ledger(
    position_m: FloatArray,
    force_n: FloatArray,
    tool_m: FloatArray,
    stiffness_n_per_m: ArrayLike,
    environment: Environment | None,
    anchor_m: ArrayLike = 0.0,
    potential_j: ArrayLike = 0.0,
) -> Ledger:
    """Return work absorbed by the device, energy stored in wall and coupling, and their difference over time, J.

    Args:
        position_m: positions, shape (..., samples).
        force_n: forces on the device, positive against +x.
        tool_m: positions of the tool between coupling and wall.
        stiffness_n_per_m: of the coupling's spring.
        environment: the wall; None in free space.
        anchor_m: where the coupling's spring is relaxed.
        potential_j: energy of detents.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        work = force_n[..., :-1] * np.diff(position_m, axis=-1)
        absorbed = np.concatenate([np.zeros((*work.shape[:-1], 1)), np.cumsum(work, axis=-1)], axis=-1)
        stored = np.zeros_like(absorbed)
        if environment is not None:
            one_sided = environment.one_sided
            depth = np.maximum(tool_m, 0.0) if one_sided else tool_m
            stored += environment.stiffness_n_per_m * depth**2 / 2
            stiffness = np.asarray(stiffness_n_per_m, np.float64)
            deflection = position_m - tool_m
            # Out of contact the clip-last law stretches its coupling without a force: that energy is not recovered.
            deflection = environment.by_law(np.maximum(deflection, 0.0), deflection) if one_sided else deflection
            stretch = np.where(np.isinf(stiffness), 0.0, deflection - np.asarray(anchor_m, np.float64))
            stored += np.where(np.isinf(stiffness), 0.0, stiffness) * stretch**2 / 2
        potential = np.broadcast_to(np.asarray(potential_j, np.float64), absorbed.shape)
    return Ledger(absorbed + potential[..., :1], stored + potential)


SETTLING_WINDOW_S = 0.5
"""Time at the end of a run by which it is judged."""
AT_REST_M_PER_S = 5e-3
"""Speed of device and handle below which a run counts as settled."""
RIPPLE_HZ = (20.0, 500.0)
"""Band of the ripple of the force."""
BUZZ_SHARE = 0.07
"""Ripple, rms as a share of the mean force, above which a run buzzes."""
DIVERGENCE_M = 10.0
"""Travel beyond any desktop workspace: the run has diverged."""
TOUCH_N = 1e-6
"""Mean force at the handle below which nothing is touched."""
IMPACT_S = 0.01
"""Time after the first contact in which the rise of the force is the rate-hardness."""


@dataclass(frozen=True, eq=False, repr=False)
class Judgement(Tabular):
    """Figures of one or many runs; every array has the shape of the runs."""

    stable: BoolArray
    diverged: BoolArray
    buzzing: BoolArray
    peak_velocity_m_per_s: FloatArray
    position_peak_to_peak_m: FloatArray
    mean_force_n: FloatArray
    mean_penetration_m: FloatArray
    force_ripple_n: FloatArray
    apparent_stiffness_n_per_m: FloatArray
    rate_hardness_n_per_m: FloatArray

    @classmethod
    def join(cls, parts: Sequence[Judgement]) -> Judgement:
        """Return the figures of all runs, in the order of the parts."""
        return cls(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})

    def to_dict(self) -> Columns:
        """Return the figures as columns, a row for each run."""
        figures = {name: np.atleast_1d(value).ravel() for name, value in vars(self).items()}
        return {"run": np.arange(len(figures["stable"])), **figures}

    def _summary(self) -> str:
        stable = np.atleast_1d(self.stable)
        return f"{int(stable.sum())} of {stable.size} runs settle, {int(np.sum(self.buzzing))} buzzing"


@dataclass(frozen=True)
class Traces:
    """Traces of runs, each of shape (..., samples); of the handle where it is another body than the device."""

    position_m: FloatArray
    velocity_m_per_s: FloatArray
    force_n: FloatArray
    sample_time_s: float
    metres_per_unit: float = 1.0
    measured_m: FloatArray | None = None
    handle_m: FloatArray | None = None
    handle_m_per_s: FloatArray | None = None

    @classmethod
    def of(cls, traces: Mapping[str, FloatArray], device: Device) -> Traces:
        """Return the traces of an executed scene; in free space there is no force."""
        position = traces["position_m"]
        force = traces.get("force_n", np.zeros_like(position))
        return cls(
            position_m=position,
            velocity_m_per_s=traces["velocity_m_per_s"],
            force_n=force,
            sample_time_s=device.sample_time_s,
            metres_per_unit=device.metres_per_unit,
            measured_m=traces.get("measured_m"),
            handle_m=traces.get("handle_m"),
            handle_m_per_s=traces.get("handle_m_per_s"),
        )

    @property
    def depth_m(self) -> FloatArray:
        """Penetration of the measured body."""
        return self.position_m if self.measured_m is None else self.measured_m

    @property
    def vibration(self) -> FloatArray:
        """Vibration at the hand at the end, in multiples of the detection threshold, shape (...)."""
        handle = self.position_m if self.handle_m is None else self.handle_m
        return vibration_level(handle * self.metres_per_unit, self.sample_time_s)

    def judge(self) -> Judgement:
        """Judge runs by the last half second (or the whole run, where it is shorter)."""
        sample_time_s = self.sample_time_s
        unit = self.metres_per_unit
        depth = self.depth_m
        last = slice(-window_samples(self.position_m.shape[-1], sample_time_s), None)
        here = np.all(np.abs(self.position_m) < DIVERGENCE_M / unit, axis=-1)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            peak = np.abs(self.velocity_m_per_s[..., last]).max(axis=-1)
            if self.handle_m_per_s is not None:
                peak = np.maximum(peak, np.abs(self.handle_m_per_s[..., last]).max(axis=-1))
            travel = np.ptp(self.position_m[..., last], axis=-1)
            force, penetration = self.force_n[..., last].mean(axis=-1), depth[..., last].mean(axis=-1)
            ripple = _ripple(self.force_n[..., last], sample_time_s)
            touching = (force > TOUCH_N * unit) & (penetration > 0) & here
            apparent = np.where(touching, force / penetration, np.nan)
            buzzing = ~here | (ripple > BUZZ_SHARE * np.abs(force))
        return Judgement(
            stable=here & (peak < AT_REST_M_PER_S / unit),
            diverged=~here,
            buzzing=buzzing,
            peak_velocity_m_per_s=peak,
            position_peak_to_peak_m=travel,
            mean_force_n=force,
            mean_penetration_m=penetration,
            force_ripple_n=ripple,
            apparent_stiffness_n_per_m=apparent,
            rate_hardness_n_per_m=_rate_hardness(depth, self.velocity_m_per_s, self.force_n, sample_time_s),
        )


def window_samples(samples: int, sample_time_s: float) -> int:
    """Return how many samples at the end of a run are judged."""
    return min(samples, max(1, round(SETTLING_WINDOW_S / sample_time_s)))


def _ripple(force: FloatArray, sample_time_s: float) -> FloatArray:
    """Return the rms of a signal's spectrum between 20 and 500 Hz (or the Nyquist frequency)."""
    n = force.shape[-1]
    frequency = np.fft.rfftfreq(n, sample_time_s)
    within = (frequency >= RIPPLE_HZ[0]) & (frequency <= RIPPLE_HZ[1])
    # Every frequency but that of Nyquist counts twice, for its mirror image.
    weight = np.where(np.isclose(frequency * sample_time_s, 0.5), 1.0, 2.0)[within]
    spectrum = np.fft.rfft(force, axis=-1)[..., within]
    return np.asarray(np.sqrt((weight * np.abs(spectrum) ** 2).sum(axis=-1)) / n)


def _rate_hardness(depth: FloatArray, velocity: FloatArray, force: FloatArray, sample_time_s: float) -> FloatArray:
    """Return the largest rise of the force after the first contact over the speed of approach, N/m, shape (...,).

    Not a number where nothing is touched, or fewer than four samples are of the impact.
    """
    # Of fewer than four samples of an impact the rise of its force is not resolved.
    if force.shape[-1] < 2 or sample_time_s * 4 > IMPACT_S:
        return np.full(force.shape[:-1], np.nan)
    pushing = force > 0
    first = pushing.argmax(axis=-1)[..., None]
    # The last sample before the face: a force that comes late may meet a hand that has stopped.
    entry = (pushing | (depth > 0)).argmax(axis=-1)[..., None]
    speed = np.abs(np.take_along_axis(velocity, np.maximum(entry - 1, 0), axis=-1)[..., 0])
    window = np.minimum(first + np.arange(1 + round(IMPACT_S / sample_time_s)), force.shape[-1] - 1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        before = np.where(window > 0, np.take_along_axis(force, np.maximum(window - 1, 0), axis=-1), 0.0)
        rate = (np.take_along_axis(force, window, axis=-1) - before) / sample_time_s
        return np.where(pushing.any(axis=-1) & (speed > 0), rate.max(axis=-1) / speed, np.nan)


QUIET = 1.0
"""Multiple of the vibrotactile detection threshold below which a vibration is not detected."""


_THRESHOLD_HZ = (10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 500.0)
_THRESHOLD_M = (20e-6, 12e-6, 5e-6, 1.6e-6, 0.5e-6, 0.25e-6, 0.7e-6)
"""Peak displacement at each of these frequencies that a hand in a pen-hold posture just detects."""
_HANN_NOISE_BANDWIDTH = 1.5
"""Mean square of Hann's window over its squared mean."""


def vibration_level(position_m: FloatArray, sample_time_s: float) -> FloatArray:
    """Return the vibration in the last half second, without a straight drift, in multiples of the detection threshold.

    The peak displacement of each frequency over its threshold; several add as the root of the sum of squares. The
    threshold is that of a hand in a pen-hold posture, approximately after Israr, Choi and Tan (IROS 2006, "Detection
    threshold and mechanical impedance of the hand in a pen-hold posture"); read off, indicative.
    """
    table_hz = np.array(_THRESHOLD_HZ)
    table_m = np.array(_THRESHOLD_M)
    last = position_m[..., -max(8, round(SETTLING_WINDOW_S / sample_time_s)) :]
    n = last.shape[-1]
    time = np.linspace(-1.0, 1.0, n)
    with np.errstate(invalid="ignore", over="ignore"):
        slope = (last * time).sum(axis=-1, keepdims=True) / (time**2).sum()
        vibration = last - last.mean(axis=-1, keepdims=True) - slope * time
        window = np.hanning(n)
        peak = 2 * np.abs(np.fft.rfft(vibration * window, axis=-1)) / window.sum()
        frequency = np.fft.rfftfreq(n, sample_time_s)
        in_band = (frequency >= table_hz[0]) & (frequency <= table_hz[-1])
        threshold_m = np.exp(np.interp(np.log(frequency[in_band]), np.log(table_hz), np.log(table_m)))
        ratio = peak[..., in_band] / threshold_m
        whole = np.sqrt((ratio**2).sum(axis=-1) / _HANN_NOISE_BANDWIDTH)
    return np.asarray(np.where(np.isfinite(whole), whole, np.inf))
