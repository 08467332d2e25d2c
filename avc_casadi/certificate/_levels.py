"""Levels L0 to L4: passivity of frozen gains, each level on the rows that have gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.certificate._certificate import (
    Level,
    LevelResult,
)
from avc_casadi.loop import device_corners
from avc_casadi.passivity import RELATIVE_TOLERANCE, SampledLoop, WorstMargin, llewellyn_margin, worst_margin
from avc_casadi.support import SILENT, BoolArray, FloatArray, Progress, chunks

if TYPE_CHECKING:
    from avc_casadi.problem import Model, Problem


# Rows that Llewellyn's condition is judged on at a time.
_ROWS_AT_ONCE = 4000


@dataclass(frozen=True)
class Rows:
    """The gains under judgement; b, k and b_p hold the present rows alone, shape (p,).

    Attributes:
        problem: the problem.
        frequency_hz: of all rows, shape (n,).
        present: which rows have gains, shape (n,).
        b: coupling damping of the present rows.
        k: coupling stiffness.
        contact: contact damping.
    """

    problem: Problem
    frequency_hz: FloatArray
    present: BoolArray
    b: FloatArray
    k: FloatArray
    contact: FloatArray

    def spread(self, values: FloatArray, missing: float = np.nan) -> FloatArray:
        """Put values of the present rows into an array of all rows."""
        whole = np.full(len(self.present), missing)
        whole[self.present] = values
        return whole


def passivity_level(rows: Rows, level: Level, model: Model, progress: Progress = SILENT) -> LevelResult:
    """Judge L0 (own frequency), L1 (band), L2 or L3 (all frequencies) in the model named."""
    if level in {"L0", "L1"}:
        low, high, where = own_frequencies(rows, level)
    else:
        low, high = np.zeros(len(rows.b)), np.full(len(rows.b), np.inf)
        where = "at every frequency up to Nyquist"
    worst = _worst_of(
        [worst_margin(loop, rows.b, rows.k, rows.contact, low, high, progress=progress) for loop in _loops(rows, model)]
    )
    hold = "the paper's hold" if model == "paper" else "the sampled-data hold"
    # Poles and residue belong to claims on a rendering as a whole; L0 and L1 are claims on Re Z_h alone.
    whole = level in {"L2", "L3"}
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


def own_frequencies(rows: Rows, level: Level) -> tuple[FloatArray, FloatArray, str]:
    """Return between which frequencies L0 or L1 judges each present row, and how that is said.

    A table of one row runs at every frequency of the problem: each of them is its own.
    """
    factor = rows.problem.stability.band_factor if level == "L1" else 1.0
    own = rows.frequency_hz[rows.present]
    if len(rows.present) > 1:
        where = f"from 1/{factor:g} to {factor:g} times its own frequency" if level == "L1" else "at its own frequency"
        return own / factor, own * factor, f"{where} for each frozen row"
    every = rows.problem.frequencies_hz()
    low, high = every.min() / factor, every.max() * factor
    where = f"from {low:.4g} to {high:.4g} Hz, where the one row runs"
    return np.full(len(own), low), np.full(len(own), high), where


def llewellyn_level(rows: Rows, model: Model, progress: Progress = SILENT) -> LevelResult:
    """Judge L4: the coupling alone protects any passive environment from any passive hand."""
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
    return level_result(rows, "L4", model, claim, margin >= -tolerance, margin, frequency, tolerance)


def _loops(rows: Rows, model: Model) -> list[SampledLoop]:
    """Return the loop at each end of the range of the delay."""
    delays = {corner.delay_samples for corner in device_corners(rows.problem.device, ("delay_samples",))}
    loop = SampledLoop.of(rows.problem, model)
    return [replace(loop, delay_samples=delay) for delay in sorted(delays)]


def _worst_of(found: list[WorstMargin]) -> WorstMargin:
    """Take the lowest margin of each row; poles and DC stiffness of a rendering do not depend on the delay."""
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
    """Say why no row is judged; a level that is not judged is not met."""
    nothing = np.full(len(rows.b), np.nan)
    result = level_result(rows, level, model, "", np.zeros(len(rows.b), bool), nothing, nothing, nothing)
    return replace(result, claim=f"Not judged: {why}", refused=why)


def _faults(worst: WorstMargin) -> list[str]:
    return [
        "a pole outside the unit circle" if not stable else f"a negative DC stiffness of {dc:.4g} N/m" if dc < 0 else ""
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
    """Sum up the present rows: the worst is the lowest margin among those that fail, or else among all."""
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
        fault = (faults[worst] if faults else "") or f"a margin of {margin[worst]:.4g} N.s/m {where}"
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
