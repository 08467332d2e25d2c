"""End stops and walls in a log: a stiffness that acts beyond a place only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Block, Fit, Window
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.record import Record
from avc_casadi.identification.uncertainty import SURE, compared

# Shares of the samples beyond a stop that are tried at either end of the travel.
_BEYOND = (0.5, 0.3, 0.2, 0.12, 0.07, 0.04, 0.02, 0.01, 0.005)
_SIDES = {1, -1}
# A stop betters the held-out error by this share of it, beside a spring over the whole travel.
_WORTH = 0.05


@dataclass(frozen=True)
class Stop:
    """A one-sided stiffness.

    Attributes:
        side: 1 at the positive end of the travel, -1 at the other.
        place_m: where it begins.
        stiffness_n_per_m: to a first approximation.
        share: of the samples that lie beyond it.
    """

    side: int
    place_m: float
    stiffness_n_per_m: float
    share: float


def stops_of(predictor: Predictor, fit: Fit, window: Window) -> list[Stop]:
    """Return the stops that the log runs into, one at most at either end of its travel.

    The force of each candidate at the measured positions is one more column of the fit, beside that of a spring over
    the whole travel: what is as stiff everywhere (a hand, a spring) is no stop.

    Args:
        predictor: of the records.
        fit: of them.
        window: of the fit.
    """
    positions = np.concatenate([record.position_m for record in predictor.records])
    found = predictor.predict(fit.structure, fit.search, fit.observer)
    errors = [one.error_m[window.skip :] / fit.unit_m for one in found]
    slopes = [one.slopes[window.skip :] / fit.unit_m for one in found if one.slopes is not None]

    def column(side: int, place_m: float) -> list[FloatArray]:
        """Return the change of the error by a stiffness of 1 N/m beyond a place; 0 is a spring over the travel."""
        pushed = [_pushed(record, side, place_m, fit.values["delay_samples"]) for record in predictor.records]
        some = predictor.of(pushed).predict(fit.structure, fit.search, fit.observer, slopes=False)
        return [one.error_m[window.skip :] / fit.unit_m - error for one, error in zip(some, errors, strict=True)]

    taken = [column(0, float(positions.mean()))]
    best: list[Stop] = []
    while len(best) < len(_SIDES):
        before, _ = _with(fit, window, errors, slopes, taken)
        tried = []
        for side in _SIDES - {one.side for one in best}:
            for share in _BEYOND:
                place = side * float(np.quantile(side * positions, 1 - share))
                more = column(side, place)
                rich, stiffness = _with(fit, window, errors, slopes, [*taken, more])
                tried.append((compared(before, rich, "stop"), Stop(side, place, stiffness, share), more))
        trial, one, more = min(tried, key=lambda each: each[0].held_out_change)
        if trial.standard_errors < SURE or -trial.held_out_change < _WORTH or one.stiffness_n_per_m <= 0:
            break
        best.append(one)
        taken.append(more)
    return best


def _pushed(record: Record, side: int, place_m: float, delay_samples: float) -> Record:
    """Return a record whose force is one beyond a place at 1 N/m; it acts at once, and so is commanded before."""
    beyond = record.position_m - place_m
    force = -(beyond if side == 0 else side * np.maximum(side * beyond, 0.0))
    at = np.arange(force.size)
    return replace(record, force_n=record.force_n + np.interp(at + delay_samples, at, force))


def _with(
    fit: Fit, window: Window, errors: list[FloatArray], slopes: list[FloatArray], columns: list[list[FloatArray]]
) -> tuple[Fit, float]:
    """Return the fit with more columns, at the same point, and the last one's Gauss-Newton step."""
    blocks = []
    for index, (error, slope) in enumerate(zip(errors, slopes, strict=True)):
        whole = np.column_stack([slope, *(column[index] for column in columns)])
        for part in window.parts(index, error.size):
            e, j = error[part], whole[part]
            blocks.append(Block(index, e.size, float(e @ e), j.T @ e, j.T @ j))
    rich = replace(fit, blocks=tuple(blocks))
    curvature = np.sum([block.curvature for block in blocks], axis=0)
    scale = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    gradient = np.sum([block.gradient for block in blocks], axis=0)
    step = -np.linalg.lstsq(curvature / scale / scale[:, None], gradient / scale, rcond=1e-10)[0] / scale
    return rich, float(step[-1])
