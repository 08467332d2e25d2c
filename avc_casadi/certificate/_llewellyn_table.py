"""The largest coupling stiffness that Llewellyn's condition allows, against the coupling's damping."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.certificate._device_levels import ideal, what_is_declared
from avc_casadi.loop import device_corners
from avc_casadi.passivity import SampledLoop, largest_llewellyn_stiffness
from avc_casadi.problem import whole_delay
from avc_casadi.support import Columns, FloatArray, Tabular, short

if TYPE_CHECKING:
    from avc_casadi.problem import Model, Problem


_RATIOS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.175, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 7.5, 7.9, 8.0)


@dataclass(frozen=True, eq=False, repr=False)
class LlewellynTable(Tabular):
    """k_c T/b_d against b_c/b_d for both holds, each of shape (n,); not a number where nothing is allowed.

    Attributes:
        damping_ratio: b_c/b_d.
        paper: with the printed hold.
        sampled_data: with hold 1/z; without delay 2 (1 - b_c/b_d).
        delay_samples: delay of the device, the longest of its range.
    """

    damping_ratio: FloatArray
    paper: FloatArray
    sampled_data: FloatArray
    delay_samples: int

    def to_dict(self) -> Columns:
        """Return the table as columns, each of shape (n,)."""
        return {
            "damping_ratio": self.damping_ratio,
            "paper_kc_t_over_b_d": self.paper,
            "sampled_data_kc_t_over_b_d": self.sampled_data,
        }

    def _summary(self) -> str:
        return f"b_c/b_d {short(self.damping_ratio)}: k_c T/b_d {short(self.paper)} with the paper's hold"


def llewellyn_table(problem: Problem, damping_ratio: FloatArray | None = None) -> LlewellynTable:
    """Tabulate the largest stiffness, the least over the range of the delay; environment and mass do not enter.

    Args:
        problem: device.
        damping_ratio: b_c/b_d, shape (n,); None takes 16 values from 0 to 8.

    Raises:
        UnsupportedError: a device without damping, or with a fractional delay, an amplifier or a resonance.
    """
    device = problem.device
    if device.damping_ns_per_m == 0:
        raise UnsupportedError("Llewellyn's condition (6) allows no coupling where device.damping_ns_per_m is 0")
    ratio = np.array(_RATIOS) if damping_ratio is None else damping_ratio
    ends = {corner.delay_samples for corner in device_corners(device, ("delay_samples",))} | {device.delay_samples}
    delays = [whole_delay(end, "Llewellyn's table") for end in sorted(ends)]
    if not ideal(device):
        raise UnsupportedError(
            f"Llewellyn's table knows no {what_is_declared(device)}: it is that of a rigid device with an ideal "
            "amplifier; level L4 judges gains on the device as declared"
        )
    scale = device.sample_time_s / device.damping_ns_per_m
    models: tuple[Model, ...] = ("paper", "sampled-data")
    found = []
    for model in models:
        loops = [replace(SampledLoop.of(problem, model), delay_samples=delay) for delay in delays]
        each = [largest_llewellyn_stiffness(loop, ratio * device.damping_ns_per_m) * scale for loop in loops]
        found.append(np.min(each, axis=0))
    return LlewellynTable(ratio, found[0], found[1], max(delays))
