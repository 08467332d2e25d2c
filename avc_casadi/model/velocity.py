"""Velocity estimators by name, from the sampled position alone: low passes behind the backward difference."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.effects import EffectTable
from avc_casadi.model.quantity import Acceleration, Hertz, Length
from avc_casadi.model.table import Finding

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray
    from avc_casadi.model.problem import Problem

Poles = tuple[float, float]
"""(a1, a2) of the low pass (1 + a1 + a2)/(1 + a1/z + a2/z^2) behind the backward difference."""
PLAIN: Poles = (0.0, 0.0)
"""No filter: the backward difference itself."""

# Keys of each estimator, the required one first. The motor's largest acceleration would make a Kalman filter a lead,
# with up to 217 times the difference's noise: it has no default.
_KEYS = {"first-order": ("cutoff_hz",), "kalman": ("acceleration_m_per_s2", "noise_rms_m")}


class VelocityFilterEffect(EffectTable):
    """Estimator of the velocity in place of the backward difference; each has its own keys."""

    kind: Literal["velocity-filter"] = "velocity-filter"
    estimator: Literal["first-order", "kalman"] = "first-order"
    cutoff_hz: Hertz | None = None
    acceleration_m_per_s2: Acceleration | None = None
    noise_rms_m: Length | None = None

    def faults(self) -> Iterator[Finding]:
        """Yield keys of the other estimator, which would be ignored, and a missing one."""
        keys = _KEYS[self.estimator]
        given = [key for key, value in self if value is not None and key not in ("kind", "estimator")]
        for key in given:
            if key not in keys:
                yield (), f'has {key}, no key of estimator "{self.estimator}"; allowed: {", ".join(keys)}'
        if keys[0] not in given:
            yield (), f'has no {keys[0]}; allowed: with it, which estimator "{self.estimator}" needs'


def low_pass(back: ComplexArray, poles: Poles) -> ComplexArray | float:
    """Return (1 + a1 + a2)/(1 + a1/z + a2/z^2) where 1 - 1/z is `back`, exact at low frequency too."""
    first, second = poles
    if poles == PLAIN:
        return 1.0
    whole = 1 + first + second
    return np.asarray(whole / (whole - (first + 2 * second) * back + second * back * back))


def velocity_poles(problem: Problem, table: VelocityFilterEffect, place: str = "scene.effects") -> Poles:
    """Return the poles of the effect velocity-filter."""
    period = problem.device.sample_time_s
    if table.cutoff_hz is not None:
        return (-math.exp(-2 * math.pi * table.cutoff_hz * period), 0.0)
    noise = _noise_m(problem) if table.noise_rms_m is None else table.noise_rms_m
    if noise == 0 or table.acceleration_m_per_s2 is None:
        said = "missing" if table.noise_rms_m is None else "0"
        message = f"is {said}; allowed: above 0 here, or an encoder or noise in the scene"
        raise InputError([Fault(problem.name or "problem", None, f"{place}.noise_rms_m", message)])
    # The steady filter of white acceleration, constant within a sample: P. R. Kalata, The tracking index, IEEE Trans.
    # Aerospace and Electronic Systems AES-20(2), 174-182 (1984).
    index = table.acceleration_m_per_s2 * period**2 / noise
    # 1 - r^2, where r = (4 + i - sqrt(8 i + i^2))/4, without its cancellation.
    root = 4 / (4 + index + math.sqrt(8 * index + index**2))
    alpha, beta = 1 - root**2, 2 * (1 - root) ** 2
    return (alpha + beta - 2, 1 - alpha)


def _noise_m(problem: Problem) -> float:
    """Return the rms of the encoder's steps and of the noise of the scene; its effects precede the device."""
    device, listed = problem.device, {effect.kind: effect for effect in problem.scene.effects}

    def told(kind: str, key: str, default: float) -> float:
        value: float | None = getattr(listed[kind], key) if kind in listed else 0.0
        return default if value is None else value

    step = told("encoder", "resolution_m", device.encoder_resolution_m)
    return math.hypot(step / math.sqrt(12), told("noise", "rms_m", device.position_noise_rms_m))
