"""Evidence for a model and uncertainty of its parameters, from blocks and records, not from the error alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Fit, Window, judged
from avc_casadi.identification.linear import PARTS
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.terms import LOOP_RATIO, PLAY, lag_of

# A richer model must better the held-out error by this many standard errors, and by this share of it.
SURE = 3.0
WORTH = 2e-3


@dataclass(frozen=True)
class Trial:
    """Result of trying a term.

    Attributes:
        term: its name.
        taken: whether it was accepted.
        held_out_change: relative change of the held-out squared error; negative is better.
        standard_errors: that change in its own standard errors.
        why: reason in words.
        inseparable: whether it is confounded with the rest of the model although the evidence supports it.
    """

    term: str
    taken: bool
    held_out_change: float
    standard_errors: float
    why: str
    inseparable: bool = False

    @property
    def worth(self) -> bool:
        """Whether the held-out error falls."""
        return -self.held_out_change > WORTH


def _curvature(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return J'J of all blocks, and the root of its diagonal, which scales the parameters to one size."""
    whole = np.sum([block.curvature for block in fit.blocks], axis=0)
    return whole, np.sqrt(np.maximum(np.diag(whole), 1e-300))


def held_out(fit: Fit) -> FloatArray:
    """Return the leave-one-out squared prediction error of each block, shape (blocks,), m^2.

    The fit without a block is one Gauss-Newton step from the fit with all, or from a point beside it.
    """
    whole, scale = _curvature(fit)
    gradient = np.sum([block.gradient for block in fit.blocks], axis=0)
    squares = []
    for block in fit.blocks:
        rest = (whole - block.curvature) / scale / scale[:, None]
        step = -np.linalg.lstsq(rest, (gradient - block.gradient) / scale, rcond=1e-10)[0] / scale
        squares.append(block.square + 2 * block.gradient @ step + step @ block.curvature @ step)
    return np.array(squares) * fit.unit_m**2


def _sure(gain: FloatArray) -> float:
    """Return a mean divided by its standard error."""
    return float(np.mean(gain)) / (float(np.std(gain, ddof=1) / np.sqrt(gain.size)) or 1e-300)


def compared(simple: Fit, rich: Fit, term: str) -> Trial:
    """Return whether a richer model predicts held-out data better, as a trial.

    Args:
        simple: without the term.
        rich: with it, on the same blocks.
        term: its name.
    """
    one, other = held_out(simple), held_out(rich)
    gain = one - other
    size = float(np.sum(one))
    # Where a simple model fails in a few blocks, their gains differ by orders of magnitude: then the logarithm decides.
    # Where the device stands still both errors may be 0.
    least = 1e-12 * size / one.size or 1e-300
    sure = max(_sure(gain), _sure(np.log((one + least) / (other + least))))
    change = -float(np.sum(gain)) / (size or 1.0)
    taken = sure > SURE and -change > WORTH
    if taken:
        why = "the error on held-out stretches falls"
    elif change < 0:
        why = "the error on held-out stretches falls too little to be sure"
    else:
        why = "the error on held-out stretches does not fall"
    return Trial(term, taken, change, sure, why)


LEVEL = 0.95
_DRAWS = 500
_SEED = 20
# Fewer records than this give no estimate of the spread between them.
_ENOUGH_RECORDS = 3
# The means over a sample of a curved and of a linear course differ by a twelfth of the curvature, by Simpson's rule;
# friction changes by twice its level where the motor reverses.
_BENT = 6.0
# Least discretisation error of parameters identified from a resonance inside a sample, or from an amplifier's lag:
# calibrated on errors against a simulation in steps of 1/200 sample.
_LEAST = {
    "resonance.frequency_hz": 1e-3,
    "resonance.damping_ratio": 3e-2,
    "resonance.mass_ratio": 4e-2,
    "amplifier_bandwidth_hz": 1e-2,
    LOOP_RATIO: 1e-2,
}
# The instant at which backlash is taken up is known to half a sample.
_TAKEN_UP = 0.5
_IN_PROPORTION = ("damping_ns_per_m", "coulomb_friction_n", "stiffness_n_per_m")


@dataclass(frozen=True, eq=False)
class Spread:
    """Uncertainty of the coordinates of a fit.

    Attributes:
        covariance: shape (free, free).
        half_width: of the stated interval, shape (free,).
        correlation: shape (free, free).
        degrees: of freedom of the t distribution.
        source: in words.
        beyond: shift of the estimate under other assumed values, down and up, shape (2, free).
    """

    covariance: FloatArray
    half_width: FloatArray
    correlation: FloatArray
    degrees: int
    source: str
    beyond: FloatArray


def spread_of(fit: Fit, others: Sequence[Fit]) -> Spread:
    """Return the uncertainty of a fit.

    Block bootstrap: each draw moves the estimate by a Gauss-Newton step; from three records on, the spread between
    records is taken where it is larger. The shift under other observers is added where it is significant: there the
    disturbance, or the model, is not as assumed. So is the discretisation error inside a sample.

    Args:
        fit: the fitted model.
        others: the same point under faster and slower observers.
    """
    gradients = np.array([block.gradient for block in fit.blocks])
    curvatures = np.array([block.curvature for block in fit.blocks])
    whole, scale = _curvature(fit)
    free, count = scale.size, len(fit.blocks)
    random = np.random.default_rng(_SEED)
    # At a bound the gradient does not vanish; it is no measure of the spread.
    gradients = gradients - gradients.mean(axis=0)
    moves = []
    for _ in range(_DRAWS):
        drawn = random.integers(0, count, count)
        curvature = curvatures[drawn].sum(axis=0) / scale / scale[:, None]
        moves.append(-np.linalg.lstsq(curvature, gradients[drawn].sum(axis=0) / scale, rcond=1e-12)[0] / scale)
    covariance = np.atleast_2d(np.cov(np.array(moves).T)) * count / max(1, count - 1)
    repeats = ", each with its repeats" if fit.repeated else ""
    degrees, source = max(1, count - 1), f"{count} stretches drawn anew{repeats}"
    records = sorted({block.record for block in fit.blocks})
    if len(records) >= _ENOUGH_RECORDS:
        each = []
        for record in records:
            mine = [index for index, block in enumerate(fit.blocks) if block.record == record]
            each.append(gradients[mine].sum(axis=0))
        inverse = np.linalg.pinv(whole / scale / scale[:, None], rcond=1e-12) / scale / scale[:, None]
        between = inverse @ (np.cov(np.array(each).T).reshape(free, free) * len(records)) @ inverse
        if scale @ (np.diag(between) * scale) > scale @ (np.diag(covariance) * scale):
            covariance, degrees = between, len(records) - 1
            source = f"differences between {len(records)} records"
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    bias = np.max([_beyond_chance(fit, other) for other in others], axis=0) if others else np.zeros(free)
    half = stats.t.ppf(0.5 + LEVEL / 2, degrees) * deviation
    outer = np.outer(deviation, deviation)
    correlation = np.divide(covariance, outer, out=np.eye(free), where=outer > 0)
    half = half + bias + _inside_a_sample(fit) + _by_the_clock(fit)
    return Spread(covariance, half, correlation, degrees, source, np.zeros((2, free)))


def _inside_a_sample(fit: Fit) -> FloatArray:
    """Return the discretisation error of each coordinate, shape (free,).

    The linear part is exact. Dry friction assumes a velocity that decays evenly over a sample: the error is of second
    order in damping, of first order in a resonance. It matters in samples in which the motor reverses, weighted by
    friction relative to the force; the excess of breakaway friction is gone, where it falls steeply with the speed,
    before the sample ends. Without friction, and as the sample time falls, the error vanishes. An amplifier's lag and
    the delay shift in opposite directions.
    """
    values, period = fit.values, fit.sample_time_s
    force, excess = fit.structure.units["coulomb_friction_n"], values["breakaway_excess_n"]
    dry = (values["coulomb_friction_n"] + excess) / force
    falls = (excess / values["stribeck_speed_m_per_s"] / values["mass_kg"] * period) ** 2
    angle = 0.0
    if fit.structure.present("resonance.frequency_hz"):
        angle = 2 * np.pi * values["resonance.frequency_hz"] * period
    bend = (values["damping_ns_per_m"] / values["mass_kg"] * period) ** 2 + angle**2
    share = fit.turning * (dry * bend + excess / force * min(falls, _BENT)) / _BENT
    # A pole and a zero move by this share of their distance from the origin.
    moved = {
        "mass_kg": share,
        "delay_samples": share / angle if angle else share,
        "resonance.frequency_hz": share,
        "resonance.damping_ratio": share / values["resonance.damping_ratio"],
        "resonance.mass_ratio": 4 * share / values["resonance.mass_ratio"],
    }
    if fit.structure.present("amplifier_bandwidth_hz"):
        order, ratio = fit.structure.amplifier_order, values[LOOP_RATIO]
        lag = lag_of(order, ratio) / (2 * np.pi * values["amplifier_bandwidth_hz"] * period)
        moved["delay_samples"] += lag * sum(
            _LEAST[key] for key in ("amplifier_bandwidth_hz", LOOP_RATIO) if fit.structure.present(key)
        )
    if fit.structure.present(PLAY):
        # The ends of the backlash are known to the residual of encoder and noise, its instants to a part of a sample.
        moved["delay_samples"] += _TAKEN_UP * fit.taking_up
        moved[PLAY] = math.sqrt(fit.noise_share) * fit.rms_m / fit.structure.units[PLAY]
    return np.array(
        [
            share * abs(q) if one.name in _IN_PROPORTION else max(moved.get(one.name, 0.0), _LEAST.get(one.name, 0.0))
            for one, q in zip(fit.structure.free, fit.search, strict=True)
        ]
    )


def _by_the_clock(fit: Fit) -> FloatArray:
    """Return the shift of each coordinate by errors of the log's clock, shape (free,)."""
    pairs = zip(fit.structure.free, fit.search, strict=True)
    return np.array([fit.clock * (1.0 if one.kind == "log" else abs(q)) for one, q in pairs])


def _beyond_chance(fit: Fit, other: Fit) -> FloatArray:
    """Return the shift of the estimate under another observer, less its chance part."""
    low, high = fit.structure.bounds()
    # Each block's contribution to the two steps; the scatter of their difference gives the chance part of the shift.
    moves = moves_of(other) - moves_of(fit)
    shift = np.clip(fit.search + moves.sum(axis=0), low, high) - fit.search
    chance = 2.0 * np.sqrt(len(moves)) * moves.std(axis=0, ddof=1)
    return np.asarray(np.sqrt(np.maximum(shift**2 - chance**2, 0.0)))


def moves_of(fit: Fit) -> FloatArray:
    """Return the Gauss-Newton step by each block, shape (blocks, free); they add up.

    Args:
        fit: a point, with its blocks.
    """
    whole, scale = _curvature(fit)
    gradients = np.array([block.gradient for block in fit.blocks]).T / scale[:, None]
    return np.asarray(-(np.linalg.lstsq(whole / scale / scale[:, None], gradients, rcond=1e-10)[0] / scale[:, None]).T)


def sensitivity(fit: Fit) -> tuple[FloatArray, float]:
    """Return correlations of the normalised sensitivities, shape (free, free), and their collinearity index.

    The index is 1/sqrt of the smallest eigenvalue: from about 20 on, two or more parameters are nearly confounded.
    """
    whole, scale = _curvature(fit)
    normal = whole / scale / scale[:, None]
    smallest = float(np.linalg.eigvalsh(normal)[0])
    return normal, 1 / np.sqrt(max(smallest, 1e-16))


_TIMES = 2
# The error falls with the square of the number of parts: doubling it shows three quarters of the limit; the rest is
# taken as the uncertainty of this law.
_WHOLE = _TIMES**2 / (_TIMES**2 - 1.0)
_UNSURE = 1.0 / _TIMES**2


def richardson(predictor: Predictor, fit: Fit, spread: Spread, window: Window) -> tuple[Fit, Spread]:
    """Extrapolate a fit to infinitely fine parts of a sample (Richardson), and widen its interval by the remainder."""
    if not (fit.structure.present("amplifier_bandwidth_hz") and fit.structure.present("coulomb_friction_n")):
        return fit, spread
    fine = predictor.of(predictor.records, parts=_TIMES * PARTS)
    close = judged(fine, fit.structure, fit.search, fit.observer, window)
    low, high = fit.structure.bounds()
    move = (moves_of(close) - moves_of(fit)).sum(axis=0)
    search = np.clip(fit.search + _WHOLE * move, low, high)
    moved = np.abs(search - fit.search)
    return replace(fit, search=search), replace(spread, half_width=spread.half_width + _UNSURE * moved)
