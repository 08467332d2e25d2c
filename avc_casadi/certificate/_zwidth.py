"""The K-B region of Colgate and Brown: walls B + K/s rendered without coupling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loop import Hand, hand_set, no_hand
from avc_casadi.passivity import SampledLoop, fractions, passive_limit_n_per_m, worst_margin
from avc_casadi.problem import as_problem, whole_delay
from avc_casadi.stability import linear_stability
from avc_casadi.support import SILENT, BoolArray, Columns, Comparable, FloatArray, Progress, Tabular, short

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from avc_casadi.problem import Device, Model, Problem

    Condition = Callable[[FloatArray, FloatArray], BoolArray]

_DAMPINGS = 61
_SCAN = 60
_BISECTIONS = 40


@dataclass(frozen=True, eq=False)
class Curve(Comparable):
    """Largest stiffness of a wall at each wall damping for one claim.

    Attributes:
        key: short name.
        claim: what holds below the curve.
        delay_samples: delay of the loop.
        stiffness_n_per_m: K, shape (n,); not a number where no stiffness meets the claim.
    """

    key: str
    claim: str
    delay_samples: int
    stiffness_n_per_m: FloatArray

    def __repr__(self) -> str:
        return f"Curve({self.key}: {short(self.stiffness_n_per_m, 'N/m')})"


@dataclass(frozen=True, eq=False, repr=False)
class ZWidth(Tabular):
    """The K-B region of a device.

    Attributes:
        problem: name of the problem.
        damping_ns_per_m: wall damping B, shape (n,); the first is 0.
        curves: one for each claim.
        encoder_limit_n_per_m: 2 f_c/Delta: above it quantisation makes more energy than dry friction takes away; None
            where friction or resolution is not known.
        passive_limit_n_per_m: 2 b_d/((1 + d) T).
        hands: how many hands the last claim was tried with.
    """

    problem: str
    damping_ns_per_m: FloatArray
    curves: tuple[Curve, ...]
    encoder_limit_n_per_m: float | None
    passive_limit_n_per_m: float
    hands: int

    def to_dict(self) -> Columns:
        """Return B and the largest K of each claim as columns, each of shape (n,)."""
        curves = {f"{curve.key}_stiffness_n_per_m": curve.stiffness_n_per_m for curve in self.curves}
        return {"damping_ns_per_m": self.damping_ns_per_m, **curves}

    def _summary(self) -> str:
        spans = ", ".join(f"{curve.key} {short(curve.stiffness_n_per_m)}" for curve in self.curves)
        return f"{self.problem!r}, B {short(self.damping_ns_per_m, 'N.s/m')}; largest K in N/m: {spans}"


def zwidth(problem: Problem | str | Path, progress: Progress = SILENT) -> ZWidth:
    """Compute the region for the problem's device and hands; its environment and coupling do not enter.

    Where the device has no delay the passive region of one sample of delay stands beside the others. Passive regions
    are convex in (B, K); the stable ones are followed from soft walls up to the first unstable one.

    Args:
        problem: the problem; or a problem file, or a name of the catalogue.
        progress: told of the curves.

    Raises:
        UnsupportedError: a fractional delay.

    Example:
        >>> region = avc.zwidth("figure5")
        >>> round(region.passive_limit_n_per_m)
        4000
    """
    problem = as_problem(problem)
    device = problem.device
    mass = device.mass_kg + max(problem.hands.mass_kg)
    top = 2 * max(mass / device.sample_time_s, 2 * device.damping_ns_per_m, 1e-3)
    damping = np.concatenate([[0.0], np.geomspace(1e-4 * top, top, _DAMPINGS - 1)])
    scan = np.geomspace(1e-6, 1.0, _SCAN) * 64 * top / device.sample_time_s
    hands = hand_set(problem.hands)
    delay = whole_delay(device.delay_samples, "the passive region of zwidth")
    late = delay or 1
    at = "" if delay == 0 else f", {delay} samples of delay"

    def passive(model: Model, samples: int) -> Condition:
        return lambda b, k: _passive(device, model, samples, b, k)

    def stable(some: Hand) -> Condition:
        return lambda b, k: _stable(device, some, b, k)

    claims = [
        ("passive-paper", f"passive, paper's hold{at}", delay, passive("paper", delay)),
        ("passive-sampled-data", f"passive, sampled-data{at}", delay, passive("sampled-data", delay)),
    ]
    if delay == 0:
        claim = "passive, sampled-data, 1 sample of delay"
        claims.append(("passive-delayed", claim, late, passive("sampled-data", late)))
    claims += [
        ("stable-released", f"linearly stable without a hand{at}", delay, stable(no_hand())),
        ("stable-hands", f"linearly stable with every hand{at}", delay, stable(hands)),
    ]
    curves: list[Curve] = []
    for key, claim, samples, met in claims:
        progress.advance(len(curves), len(claims), claim)
        curves.append(Curve(key, claim, samples, _largest(damping, scan, met)))
    friction, resolution = device.coulomb_friction_n, device.encoder_resolution_m
    return ZWidth(
        problem=problem.name,
        damping_ns_per_m=damping,
        curves=tuple(curves),
        encoder_limit_n_per_m=2 * friction / resolution if friction > 0 and resolution > 0 else None,
        passive_limit_n_per_m=passive_limit_n_per_m(device.damping_ns_per_m, device.sample_time_s, delay),
        hands=len(hands),
    )


def _passive(device: Device, model: Model, delay_samples: int, damping: FloatArray, stiffness: FloatArray) -> BoolArray:
    loop = SampledLoop(device.damping_ns_per_m, damping, stiffness, device.sample_time_s, delay_samples, model)
    return worst_margin(loop, np.inf, 1.0).passive


def _stable(device: Device, hands: Hand, damping: FloatArray, stiffness: FloatArray) -> BoolArray:
    loop = SampledLoop(
        device.damping_ns_per_m, damping, stiffness, device.sample_time_s, device.delay_samples, "sampled-data"
    )
    return linear_stability(device, fractions(loop, np.inf, 1.0), 0.0, hands).stable


def _largest(damping: FloatArray, scan: FloatArray, meets: Callable[[FloatArray, FloatArray], BoolArray]) -> FloatArray:
    """Upper end of the first stretch of stiffnesses that meet a claim, found on a scan and bisected, shape (n,)."""
    met = np.zeros((len(damping), len(scan)), dtype=bool)
    going_on = np.arange(len(damping))
    for column, stiffness in enumerate(scan):
        met[going_on, column] = meets(damping[going_on], np.full(len(going_on), stiffness))
        going_on = np.flatnonzero(met[:, column] | ~met[:, :column].any(axis=1))
        if not going_on.size:
            break
    first = np.argmax(met, axis=1)
    after = np.arange(len(scan))[None, :] > first[:, None]
    leaves = after & ~met
    last = np.where(leaves.any(axis=1), np.argmax(leaves, axis=1) - 1, len(scan) - 1)
    inside, outside = scan[last], scan[np.minimum(last + 1, len(scan) - 1)]
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        fits = meets(damping, middle)
        inside, outside = np.where(fits, middle, inside), np.where(fits, outside, middle)
    return np.asarray(np.where(met.any(axis=1), inside, np.nan))
