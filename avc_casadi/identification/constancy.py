"""Whether a log is of one device throughout: its thirds, each identified alone (after Chow's test, by intervals)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi._util.units import spoken_key
from avc_casadi.identification.device import SEARCHED
from avc_casadi.identification.fit import Fit, Window, fit, slowest_observer
from avc_casadi.identification.model import Doubt
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.record import Record
from avc_casadi.identification.uncertainty import spread_of
from avc_casadi.model.quantity import power_at_handle

_PARTS = 3
# A piece of a record with fewer samples is left out, and a part of so few tells nothing.
_SHORTEST, _FEWEST = 200, 600
# Parts differ where their estimates are so many of their intervals apart; by this share of the value it is a doubt,
# less is in the interval.
_APART, _SHARE = 1.5, 0.05


def differences_of_thirds(
    predictor: Predictor, whole: Fit, half_width: Sequence[float], radius_m: float
) -> tuple[FloatArray, list[Doubt]]:
    """Return by how much intervals fall short of the thirds of each log, and the doubt where these differ.

    What changes midway (a hand takes hold, a cable rubs) leaves an average that no third has, and a prediction error
    that may well be white.

    Args:
        predictor: of the records.
        whole: the fit of them.
        half_width: of the interval of each coordinate, shape (free,).
        radius_m: travel of the handle per unit of position.

    Returns:
        Shifts down and up, in search coordinates, shape (2, free), and doubts.
    """
    beyond = np.zeros((2, whole.search.size))
    told: dict[str, str] = {}
    for log in sorted(set(predictor.logs)):
        some = [record for record, of in zip(predictor.records, predictor.logs, strict=True) if of == log]
        parts = _parts(some)
        if any(sum(piece.position_m.size for piece in part) < _FEWEST for part in parts):
            continue
        fits = [_alone(predictor, whole, part) for part in parts]
        at, half = np.array([one.search for one in fits]), np.array([spread_of(one, ()).half_width for one in fits])
        apart = np.max(
            [
                np.abs(at[a] - at[b]) / (np.hypot(half[a], half[b]) + 1e-300)
                for a, b in itertools.combinations(range(_PARTS), 2)
            ],
            axis=0,
        )
        short = np.array([whole.search - (at - half).min(axis=0), (at + half).max(axis=0) - whole.search]) - half_width
        beyond = np.maximum(beyond, np.where(apart > _APART, short, 0.0))
        for index, one in enumerate(whole.structure.free):
            values = [whole.structure.outward(one, float(q)) for q in at[:, index]]
            size = abs(whole.structure.outward(one, float(whole.search[index])))
            if one.name in SEARCHED and apart[index] > _APART and np.ptp(values) > _SHARE * size:
                by = radius_m ** -power_at_handle(one.name)
                shown = ", ".join(number(value * by, 3) for value in values)
                told[one.name] = (
                    f"{spoken_key(one.name)} {shown}{f' in {some[0].whole}' if len(set(predictor.logs)) > 1 else ''}"
                )
    if not told:
        return beyond, []
    why = "the thirds of the log differ"
    note = (
        f"{why} ({'; '.join(told.values())}, one after the other): something changed on the way (a hand took hold, a "
        "cable rubs), or the model lacks what only some of it excites; the value is between those of several devices. "
        "Better: a log in which nothing changes, or each part of it alone"
    )
    return beyond, [Doubt(why, note)]


def _parts(records: Sequence[Record]) -> list[list[Record]]:
    """Return the samples of a log in thirds, in order, each of pieces of its records."""
    sizes = [record.position_m.size for record in records]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    edges = np.linspace(0, starts[-1], _PARTS + 1).astype(int)
    parts: list[list[Record]] = []
    for first, last in itertools.pairwise(edges):
        part = []
        for record, start, size in zip(records, starts, sizes, strict=False):
            low, high = max(0, int(first - start)), min(size, int(last - start))
            if high - low >= _SHORTEST:
                part.append(
                    replace(
                        record,
                        position_m=record.position_m[low:high],
                        force_n=record.force_n[low:high],
                        begins_s=record.begins_s + low * record.sample_time_s,
                        log=record.whole,
                    )
                )
        parts.append(part)
    return parts


def _alone(predictor: Predictor, whole: Fit, part: Sequence[Record]) -> Fit:
    some = predictor.of(part)
    window = Window.of([record.position_m.size for record in part], some.sample_time_s)
    observer = Observer(max(whole.observer.rate_per_s, slowest_observer(some)))
    return fit(some, whole.structure, whole.values, observer, window, steps=10, tolerance=1e-5)
