"""The estimators of the interaction frequency by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

from avc_casadi._errors import UnsupportedError
from avc_casadi.runtime._adaptive_notch import adaptive_notch_step
from avc_casadi.runtime._fused import fused_step
from avc_casadi.runtime._signal import EstimatorSettings
from avc_casadi.runtime._spectral_peak import spectral_peak_step
from avc_casadi.runtime._step import Step
from avc_casadi.runtime._zero_crossing import zero_crossing_step

EstimatorMethod = Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"]

ESTIMATORS: Mapping[str, Callable[[float, EstimatorSettings], Step]] = {
    "zero-crossing": zero_crossing_step,
    "spectral-peak": spectral_peak_step,
    "adaptive-notch": adaptive_notch_step,
    "fused": fused_step,
}


def estimator_step(method: str, sample_time_s: float, settings: EstimatorSettings | None = None) -> Step:
    """Return one tick of an estimator: velocity_m_per_s -> frequency_hz, valid.

    At rest the frequency is undefined: `valid` is 0 and the frequency is 0, never the last one.

    Args:
        method: a key of `ESTIMATORS`.
        sample_time_s: T.
        settings: what is taken for motion; None for the usual.

    Raises:
        UnsupportedError: an unknown method.
    """
    if method not in ESTIMATORS:
        raise UnsupportedError(f'estimator "{method}" is unknown; allowed: {", ".join(ESTIMATORS)}')
    return ESTIMATORS[method](sample_time_s, settings or EstimatorSettings())
