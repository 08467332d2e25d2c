"""Whether several logs are of one device: what each asks for alone, about what was found of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi.files.rotary_keys import power_at_handle
from avc_casadi.identification.fit import Fit
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.uncertainty import moves_of

# Logs differ that ask for values so many standard errors apart, and this share of the value.
_SURE, _SHARE = 6.0, 0.05
_FEWEST_BLOCKS = 5
_COMPARED = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n")


def unlike_notes(fit: Fit, predictor: Predictor, names: Sequence[str], radius_m: float) -> list[str]:
    """Say that logs do not agree; nothing where they do.

    Args:
        fit: of all logs, at its best.
        predictor: of their records.
        names: of the logs.
        radius_m: how far the handle goes for a unit of the position.
    """
    unlike = _differences(fit, predictor, names, {key: radius_m ** -power_at_handle(key) for key in _COMPARED})
    if not unlike:
        return []
    between = f"the logs do not agree ({'; '.join(unlike)}): the values are between those of two devices"
    why = "Something may have been on it (--added-mass), or the force been scaled otherwise"
    return [f"{between}. {why}; identify each alone"]


def _differences(fit: Fit, predictor: Predictor, names: Sequence[str], unit_of: dict[str, float]) -> list[str]:
    """Say which numbers two logs ask for differently.

    A Gauss-Newton step from what was found of all, with the curvature of each log alone, is what that log asks for.
    """
    asked = [_asked(fit, {at for at, log in enumerate(predictor.logs) if log == place}) for place in range(len(names))]
    told = []
    for index, one in enumerate(fit.structure.free):
        if one.name not in _COMPARED:
            continue
        ends = [
            (step[index], error[index], name) for (step, error), name in zip(asked, names, strict=True) if step.size
        ]
        if len(ends) < 2:
            continue
        (low, below, first), (high, above, last) = min(ends), max(ends)
        values = [fit.structure.outward(one, float(fit.search[index] + step)) for step in (low, high)]
        apart = values[1] - values[0]
        if high - low > _SURE * np.hypot(below, above) and apart > _SHARE * abs(
            fit.structure.outward(one, fit.search[index])
        ):
            some = [number(value * unit_of.get(one.name, 1.0), 3) for value in values]
            told.append(f"{one.name} {some[0]} by {first} alone and {some[1]} by {last}")
    return told


def _asked(fit: Fit, records: set[int]) -> tuple[FloatArray, FloatArray]:
    """Return the step that some records ask for and its standard error, each of shape (free,); empty of too few."""
    blocks = tuple(block for block in fit.blocks if block.record in records)
    if len(blocks) < _FEWEST_BLOCKS:
        return np.zeros(0), np.zeros(0)
    moves = moves_of(replace(fit, blocks=blocks))
    return moves.sum(axis=0), np.sqrt(len(blocks)) * moves.std(axis=0, ddof=1)
