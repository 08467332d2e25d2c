"""Saturation and work: whether the force limit bounds an oscillation, and whether the force feeds it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, worst_mode
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation, TracedOscillation
from avc_casadi.model.device import Device

# A force within this share of its limit is saturated.
_TOP = 0.999
# Without a declared limit, a force that recurs is one: in this share of an oscillation over so many steps, over fewer
# of which all forces recur.
_AGAIN, _STEPS = 0.05, 14.0
# A command so much above the limit is no rounding, and so large a share of them no outlier.
_ABOVE, _SELDOM = 1.01, 1e-3


# A limit recurs in so many samples, so many times more often than the usual one of as many other forces; that of an
# output with few levels is one of them, and so is that of a relay.
_FEW, _MORE_OFTEN, _LEVELS = 8, 5, 20


def force_limit(log: Log, limit_n: float | None) -> float | None:
    """Return the force limit that a log reaches, or None: the declared one, or a force that stays as positions change.

    Args:
        log: on its tick grid.
        limit_n: of the device; None where none was declared.
    """
    size = np.abs(log.force_n)
    most = float(size.max(initial=0.0))
    if limit_n is not None and most > _TOP * limit_n:
        return limit_n
    top = size > _TOP * most
    others, counts = np.unique(size[~top & log.touching], return_counts=True)
    if top.sum() < _FEW or others.size < _LEVELS or np.ptp(log.position_m[top]) <= _ONE_COUNT * log.encoder_m:
        return None
    return most if top.sum() > _MORE_OFTEN * np.median(counts) else None


def limited(log: Log, swing: TracedOscillation, limit_n: float | None) -> TracedOscillation:
    """Return an oscillation with its largest force, and the share of it in which the force saturates.

    Args:
        log: on its tick grid.
        swing: the oscillation.
        limit_n: of the device; None where none was declared.
    """
    size = np.abs(log.force_n[swing.first : swing.last])
    largest = float(size.max(initial=0.0))
    if swing.found.kind == "none" or not largest:
        return swing
    share = float(np.mean(size > _TOP * (largest if limit_n is None else limit_n)))
    if limit_n is None and not (share > _AGAIN and swing.found.steps > _STEPS and force_limit(log, None)):
        share = 0.0
    return replace(swing, found=replace(swing.found, largest_force_n=largest, at_force_limit_share=share))


GROWN = 4.0
"""Growth in factors of e after which a loop cannot be the cause of an oscillation of constant amplitude."""
_ALWAYS = 0.97
_TOP_EVEN = 0.999
# A position that toggles has its largest force at one of its counts, which is no limit.
_ONE_COUNT = 1.5
_FEW_STEPS = 3.0
# Between two counts quantisation turns a motion of up to a count into a force of this share of it, and stabilises a
# loop there that is unstable without it.
_LEAST_GAIN = 0.5


def exceeded(log: Log, limit_n: float) -> bool:
    """Return whether a log commands more than the declared force limit."""
    return bool(np.mean(np.abs(log.force_n) > _ABOVE * limit_n) > _SELDOM)


def unlimited(log: Log, found: Oscillation, limit_n: float | None) -> bool:
    """Return whether an oscillation neither leaves contact nor reaches a largest force.

    Args:
        log: on its tick grid.
        found: the oscillation.
        limit_n: force limit of the device, None where none was declared.
    """
    size = np.abs(log.force_n)
    top = size > _TOP_EVEN * size.max()
    cut = limit_n is not None and size.max() >= _TOP_EVEN * limit_n
    limited = np.mean(top) > 1 - _ALWAYS and (cut or np.ptp(log.position_m[top]) > _ONE_COUNT * log.encoder_m)
    return bool(found.contact_share > _ALWAYS and not limited)


def fed(log: Log, swing: TracedOscillation, device: Device) -> bool:
    """Return whether the commanded force does the work that sustains an oscillation, rather than a hand.

    In a self-sustained oscillation the force does the work that damping and friction dissipate; where a hand moves the
    device in a wall, the force absorbs work, or does no more than by its delay. The threshold is half of it. Only over
    whole cycles does a spring give back what it took.

    Args:
        log: on its tick grid.
        swing: the oscillation.
        device: as declared, or assumed.
    """
    late = round(float(device.delay_samples))
    above = log.position_m[swing.first : swing.last] > log.position_m[swing.first : swing.last].mean()
    rises = swing.first + np.flatnonzero(above[1:] & ~above[:-1]) + 1
    if rises.size < 2:
        return False
    first, last = int(rises[0]), int(rises[-1])
    part = slice(first, last + 1)
    moved = np.diff(log.position_m[part])
    acts = -log.force_n[np.maximum(np.arange(first, last) - late, 0)]
    speed = moved / log.ticks.period_s
    takes = float(np.sum(device.damping_ns_per_m * speed * moved + device.coulomb_friction_n * np.abs(moved)))
    return float(np.sum(acts * moved)) > takes / 2


def outgrows(answer: Hypothesis, law: Law, log: Log, found: Oscillation, limit_n: float | None) -> bool:
    """Return whether a loop would long have grown beyond the few counts over which a log oscillates evenly.

    Args:
        answer: device and hand.
        law: from position to force.
        log: on its tick grid.
        found: the oscillation.
        limit_n: force limit of the device, None where none was declared.
    """
    few = found.kind == "limit cycle" and found.steps < _FEW_STEPS
    if not few or not unlimited(log, found, limit_n):
        return False
    grows = worst_mode(answer, law, stiffness=_LEAST_GAIN, damping=_LEAST_GAIN).growth_per_s
    return math.isfinite(grows) and grows * (found.ends_s - found.begins_s) > GROWN
