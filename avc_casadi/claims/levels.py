"""Passivity of frozen gains, each level on the rows that have gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress, chunks
from avc_casadi.claims.certificate import LevelResult
from avc_casadi.claims.passivity.llewellyn import llewellyn_margin
from avc_casadi.claims.passivity.worst_frequency import RELATIVE_TOLERANCE, WorstMargin, worst_margin
from avc_casadi.claims.passivity.worst_port import CouplingSlack, PortWorst, RenderingSlack, perceived_worst, port_worst
from avc_casadi.loops.sampled_loop import Fractions, SampledLoop, fractions
from avc_casadi.loops.wall import RADIUS_TOLERANCE, linear_stability, rigid
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, least_damped
from avc_casadi.model.hands import Hand

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import Level
    from avc_casadi.claims.registry import Judged, PassivityClaim, Where
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Model, Problem


# Rows of Llewellyn's condition at a time.
_ROWS_AT_ONCE = 4000


@dataclass(frozen=True)
class Rows:
    """The gains under judgement; b, k and b_p of the present rows alone, shape (p,)."""

    problem: Problem
    frequency_hz: FloatArray
    present: BoolArray
    b: FloatArray
    k: FloatArray
    contact: FloatArray

    def spread(self, values: FloatArray, missing: float = np.nan) -> FloatArray:
        """Return values of the present rows in an array of all rows."""
        whole = np.full(len(self.present), missing)
        whole[self.present] = values
        return whole


def judge_passivity(judged: Judged, claim: PassivityClaim) -> LevelResult:
    """Judge a claim of passivity on the rows; a device for which it is not available does not meet it."""
    rows, stated = judged.rows, judged.problem.stability.model
    if judged.behind_feedback:
        why = "the level knows gains alone, and these run behind an observer with state feedback"
        return not_judged(rows, claim.name, stated, why)
    model = claim.hold or stated
    try:
        if not ideal(rows.problem.device):
            return _with_device(rows, claim, model, judged.progress)
        # Re Z_h grows with the device's damping, so that the lower end of its range covers the others.
        lean = replace(rows, problem=least_damped(rows.problem))
        if claim.any_environment:
            return llewellyn_level(lean, claim.name, model, judged.progress)
        return passivity_level(lean, claim.name, model, claim.where, judged.progress)
    except UnsupportedError as refusal:
        return not_judged(rows, claim.name, model, str(refusal))


def _with_device(rows: Rows, claim: PassivityClaim, model: Model, progress: Progress) -> LevelResult:
    """Judge on a device that is not `ideal`."""
    if claim.where != "all":
        return _own_frequency(rows, claim.name, model, claim.where)
    if model == "paper":
        what = what_is_declared(rows.problem.device)
        raise UnsupportedError(
            f"{claim.name} with the paper's hold has no proof on a device with {what}: that hold "
            "gives no loop from sample to sample; L3 judges the device as declared, and L4 with stability.model = "
            '"sampled-data"'
        )
    return _all_frequencies(rows, claim.name, progress, any_environment=claim.any_environment)


def passivity_level(rows: Rows, level: Level, model: Model, where_: Where, progress: Progress = SILENT) -> LevelResult:
    """Judge Re Z_h >= 0 at frequencies in a given model; at all frequencies the poles too."""
    whole = where_ == "all"
    if where_ != "all":
        low, high, where = own_frequencies(rows, where_)
    else:
        low, high = np.zeros(len(rows.b)), np.full(len(rows.b), np.inf)
        where = "at every frequency up to Nyquist"
    worst = _worst_of(
        [worst_margin(loop, rows.b, rows.k, rows.contact, low, high, progress=progress) for loop in _loops(rows, model)]
    )
    hold = "the paper's hold" if model == "paper" else "the sampled-data hold"
    # Poles and residue are conditions of a rendering as a whole; other claims are on Re Z_h alone.
    passed = worst.passive if whole else worst.margin_ns_per_m >= -worst.tolerance_ns_per_m
    claim = f"Re Z_h >= 0 {where}, under {hold}"
    if whole:
        claim = f"each frozen row is passive with this environment {where}, under {hold}"
    return level_result(
        rows,
        level,
        model,
        claim,
        passed,
        worst.margin_ns_per_m,
        worst.frequency_hz,
        worst.tolerance_ns_per_m,
        faults=_faults(worst) if whole else None,
    )


def own_frequencies(rows: Rows, where_: Where) -> tuple[FloatArray, FloatArray, str]:
    """Return the band in which each present row is judged, or its own frequency, and its description.

    A table of one row runs at every frequency of the problem: each counts as its own.
    """
    factor = rows.problem.stability.band_factor if where_ == "band" else 1.0
    own = rows.frequency_hz[rows.present]
    if len(rows.present) > 1:
        where = "at its own frequency"
        if where_ == "band":
            where = f"from 1/{factor:g} to {factor:g} times its own frequency"
        return own / factor, own * factor, f"{where} for each frozen row"
    every = rows.problem.frequencies_hz()
    low, high = every.min() / factor, every.max() * factor
    where = f"from {low:.4g} to {high:.4g} Hz, where the one row runs"
    return np.full(len(own), low), np.full(len(own), high), where


def llewellyn_level(rows: Rows, level: Level, model: Model, progress: Progress = SILENT) -> LevelResult:
    """Judge whether the coupling alone protects any passive environment from any passive hand."""
    margin, frequency = np.full(len(rows.b), np.inf), np.zeros(len(rows.b))
    for loop in _loops(rows, model):
        found = [
            llewellyn_margin(loop, rows.b[some], rows.k[some], rows.contact[some])
            for some in chunks(len(rows.b), _ROWS_AT_ONCE, progress, "Llewellyn")
        ]
        left, at = (np.concatenate(column) for column in zip(*found, strict=True))
        frequency, margin = np.where(left < margin, at, frequency), np.minimum(left, margin)
    tolerance = RELATIVE_TOLERANCE * (rows.problem.device.damping_ns_per_m + rows.contact + np.abs(margin))
    tolerance = np.where(np.isfinite(margin), tolerance, 0.0)
    hold = "the paper's hold" if model == "paper" else "the sampled-data hold"
    claim = f"each frozen row meets Llewellyn's condition (6) for any passive environment, under {hold}"
    return level_result(rows, level, model, claim, margin >= -tolerance, margin, frequency, tolerance)


def _loops(rows: Rows, model: Model) -> list[SampledLoop]:
    """Return the loop at each end of the range of the delay."""
    delays = {corner.delay_samples for corner in device_corners(rows.problem.device, ("delay_samples",))}
    loop = SampledLoop.of(rows.problem, model)
    return [replace(loop, delay_samples=delay) for delay in sorted(delays)]


def _worst_of(found: list[WorstMargin]) -> WorstMargin:
    """Return the lowest margin of each row; poles and DC stiffness of a rendering do not depend on the delay."""
    worst = found[0]
    for other in found[1:]:
        lower = other.margin_ns_per_m < worst.margin_ns_per_m
        worst = replace(
            worst,
            margin_ns_per_m=np.where(lower, other.margin_ns_per_m, worst.margin_ns_per_m),
            frequency_hz=np.where(lower, other.frequency_hz, worst.frequency_hz),
            tolerance_ns_per_m=np.where(lower, other.tolerance_ns_per_m, worst.tolerance_ns_per_m),
        )
    return worst


def not_judged(rows: Rows, level: Level, model: Model, why: str) -> LevelResult:
    """Return a level with the reason why no row is judged; it is not met."""
    nothing = np.full(len(rows.b), np.nan)
    result = level_result(rows, level, model, "", np.zeros(len(rows.b), bool), nothing, nothing, nothing)
    return replace(result, claim=f"Not judged: {why}", refused=why)


def _faults(worst: WorstMargin) -> list[str]:
    return [
        "a pole outside the unit circle" if not stable else f"a negative DC stiffness of {dc:.4g}" if dc < 0 else ""
        for stable, dc in zip(worst.poles_stable, worst.dc_stiffness_n_per_m, strict=True)
    ]


def level_result(
    rows: Rows,
    level: Level,
    model: Model,
    claim: str,
    passed: BoolArray,
    margin: FloatArray,
    frequency: FloatArray,
    tolerance: FloatArray,
    faults: list[str] | None = None,
) -> LevelResult:
    """Summarise the present rows: the worst is the lowest margin among those that fail, or else among all."""
    row_passed = rows.spread(passed.astype(np.float64), 0.0) > 0
    missing = int(np.count_nonzero(~rows.present))
    failed = int(np.count_nonzero(~passed))
    if len(passed) == 0:
        nothing, claim = rows.spread(margin), f"Not met: none of {missing} rows has gains"
        return LevelResult(level, False, np.nan, np.nan, model, claim, 0.0, None, row_passed, nothing, nothing)
    worst = int(np.argmin(np.where(passed, np.inf, margin) if failed else margin))
    row = int(np.flatnonzero(rows.present)[worst])
    if failed:
        where = f"at {frequency[worst]:.5g} Hz" if frequency[worst] > 0 else "towards zero frequency"
        fault = (faults[worst] if faults else "") or f"a margin of {margin[worst]:.4g} {where}"
        own = f"the row of {rows.frequency_hz[row]:.5g} Hz"
        claim = f"Not met by {failed} of {len(passed)} rows: {own} has {fault}"
    if missing:
        claim = (
            f"{claim}; {missing} rows have no gains" if failed else f"Not met: {missing} rows have no gains; {claim}"
        )
    finite = np.isfinite(margin[worst])
    return LevelResult(
        level=level,
        passed=failed == 0 and missing == 0,
        margin_ns_per_m=float(margin[worst]) if finite else np.nan,
        frequency_hz=float(frequency[worst]),
        model=model,
        claim=claim,
        tolerance_ns_per_m=float(tolerance[worst]),
        row=row,
        row_passed=row_passed,
        row_margin_ns_per_m=rows.spread(margin),
        row_frequency_hz=rows.spread(frequency),
    )


def ideal(device: Device) -> bool:
    """Return whether a device is rigid, with an ideal amplifier and whole samples of delay: levels in closed form."""
    delays = [corner.delay_samples for corner in device_corners(device, ("delay_samples",))]
    return rigid(device) and all(delay == int(delay) for delay in delays)


def what_is_declared(device: Device) -> str:
    """Return the properties that make the device not ideal, in words."""
    found = {
        "device.amplifier_bandwidth_hz": device.amplifier_bandwidth_hz is not None,
        "device.resonance": device.resonance is not None,
    }
    named = [key for key, there in found.items() if there]
    if any(corner.delay_samples % 1 for corner in device_corners(device, ("delay_samples",))):
        named.append("part of a sample of delay (device.delay_samples)")
    return " and ".join(named)


def _own_frequency(rows: Rows, level: Level, model: Model, where_: Where) -> LevelResult:
    low, high, where = own_frequencies(rows, where_)
    parts = fractions(SampledLoop.of(rows.problem, model), rows.b, rows.k)
    corners = device_corners(rows.problem.device, LINEAR_KEYS)
    worst = perceived_worst(corners, parts, rows.contact, low, high, model)
    hold = "the paper's hold" if model == "paper" else "the sampled-data hold"
    claim = f"Re Z_h >= 0 {where}, under {hold}, with the device as declared{_at_corners(corners)}"
    return _result(rows, level, model, claim, worst, worst.passed, None)


def _all_frequencies(rows: Rows, level: Level, progress: Progress, *, any_environment: bool) -> LevelResult:
    # A constant coupling repeats one row.
    (b, k, contact), back = np.unique(np.stack([rows.b, rows.k, rows.contact]), axis=1, return_inverse=True)
    back = back.ravel()
    parts = fractions(SampledLoop.of(rows.problem, "sampled-data"), b, k)
    corners = device_corners(rows.problem.device, LINEAR_KEYS)
    time = rows.problem.device.sample_time_s
    slack = CouplingSlack(b, k, contact, time) if any_environment else RenderingSlack(parts, contact)
    worst = port_worst(corners, slack, len(b), progress).pick(back)
    stiffness = (parts.integral / time)[back]
    sound = stable_with_one_hand(corners, parts, contact)[back]
    # For any passive wall the DC stiffness of this one is no condition.
    sound &= (stiffness >= 0) | any_environment
    faults = [
        _fault(bool(lacks), 0.0 if any_environment else float(dc))
        for lacks, dc in zip(~worst.passed, stiffness, strict=True)
    ]
    claim = "each frozen row meets Llewellyn's condition (6) for any passive environment"
    if not any_environment:
        claim = "each frozen row is passive with this environment at every frequency up to Nyquist"
    claim += f", under the sampled-data hold, with the device as declared{_at_corners(corners)}"
    return _result(rows, level, "sampled-data", claim, worst, worst.passed & sound, faults)


def _result(
    rows: Rows, level: Level, model: Model, claim: str, worst: PortWorst, passed: BoolArray, faults: list[str] | None
) -> LevelResult:
    margin = worst.margin_ns_per_m
    return level_result(rows, level, model, claim, passed, margin, worst.frequency_hz, worst.tolerance_ns_per_m, faults)


def _at_corners(corners: list[Device]) -> str:
    return "" if len(corners) == 1 else f" at {len(corners)} corners of [device.range]"


def _fault(lacks_damping: bool, dc_n_per_m: float) -> str:
    """Return what fails besides a lack of damping at the handle, in words."""
    if lacks_damping:
        return ""
    if dc_n_per_m < 0:
        return f"a negative DC stiffness of {dc_n_per_m:.4g}"
    return "a pole outside the unit circle"


def stable_with_one_hand(corners: list[Device], parts: Fractions, contact: FloatArray) -> BoolArray:
    """Return whether each row is stable with one passive hand, and so with any where the port is passive."""
    stable = np.array(parts.stable, dtype=bool)
    for device in corners:
        time = device.sample_time_s
        mass = max(device.mass_kg, device.damping_ns_per_m * time, 1e-6)
        hand = Hand(*(np.array([value]) for value in (mass, mass / (10 * time), mass / (10 * time) ** 2)))
        radius = linear_stability(device, parts, contact, hand).radius[:, 0]
        stable &= radius < 1 - RADIUS_TOLERANCE
    return stable
