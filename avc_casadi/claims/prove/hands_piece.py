"""The stored part of a proof over hands: cells without a zero, and one loop whose eigenvalues are counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.prove.frozen_loop import FrozenGains, FrozenLoop
from avc_casadi.claims.prove.zero_exclusion import Cells, cells_of, cover_of, excludes

_CLEAR_TURN = 3.0
_TURN_TOLERANCE = 1e-3
# Digits of a stored half plane's angle; the few cells that are near enough to mind keep all.
_ANGLE_DIGITS = 3
TOP = float(np.nextafter(np.pi, 4.0))
"""Where the upper half of the unit circle ends, rad: the function repeats there."""


@dataclass(frozen=True)
class Piece:
    """What was proved for delays between two whole numbers of samples; rows of cells as in `Enclosed` functions.

    Attributes:
        whole_delay: samples of delay, less the fraction.
        fraction: of the delay; None where it is a row of the cells.
        low: lower corner of the box, shape (v,): angle, rad; all mass that moves, kg; damping; stiffness; fraction.
        high: upper corner.
        cells: cells that fill the box, none of which holds a zero.
        member: cells along the unit circle at one point of the box.
    """

    whole_delay: int
    fraction: float | None
    low: FloatArray
    high: FloatArray
    cells: Cells
    member: Cells

    def replays(self, gains: FrozenGains) -> bool:
        """Whether the cells prove it once more."""
        loop = FrozenLoop(gains, self.whole_delay, self.fraction)
        cells, member = (replace(one, row=np.zeros(len(one), dtype=np.intp)) for one in (self.cells, self.member))
        inside = (member.low[1:] >= self.low[1:, None]) & (member.high[1:] <= self.high[1:, None])
        thin = member.low[1:] == member.high[1:]
        whole = self.low[0] == 0.0 and self.high[0] == TOP
        return bool(
            whole
            and inside.all()
            and thin.all()
            and (member.low[1:] == member.low[1:, :1]).all()
            and cover_of(self.low, self.high, cells.low, cells.high) is not None
            and excludes(loop, cells).all()
            and excludes(loop, member).all()
            and all_inside(loop, member)
        )

    def document(self, gains: FrozenGains) -> dict[str, Any]:
        """Return JSON values; `from_document` reads them. Cells are stored as the cuts that make them."""
        loop = FrozenLoop(gains, self.whole_delay, self.fraction)
        point = self.member.low[1:, 0]
        ends = np.array([0.0, *point]), np.array([TOP, *point])
        return {
            "whole_delay": self.whole_delay,
            "fraction": self.fraction,
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "cells": _cells_document(loop, self.low, self.high, self.cells),
            "point": point.tolist(),
            "member": _cells_document(loop, *ends, self.member),
        }

    @classmethod
    def from_document(cls, found: Mapping[str, Any]) -> Piece:
        """Read what `document` gives.

        Raises:
            ValueError: what stands there is no cover.
        """
        low, high, point = (np.array(found[name], dtype=np.float64) for name in ("low", "high", "point"))
        fraction = found["fraction"]
        return cls(
            int(found["whole_delay"]),
            None if fraction is None else float(fraction),
            low,
            high,
            _cells_from(low, high, found["cells"]),
            _cells_from(np.array([0.0, *point]), np.array([TOP, *point]), found["member"]),
        )


def all_inside(loop: FrozenLoop, line: Cells) -> bool:
    """Whether the argument of F grows by 2 pi along the cells: all eigenvalues lie inside the unit circle."""
    order = np.argsort(line.low[0], kind="stable")
    low, high = line.low[:, order], line.high[:, order]
    if not len(line) or low[0, 0] != 0.0 or high[0, -1] != TOP or (low[0, 1:] != high[0, :-1]).any():
        return False
    points = np.concatenate([low, high[:, -1:]], axis=1)
    value = loop.at(points, np.zeros(points.shape[1], dtype=np.intp))
    number = value.real.middle + 1j * value.imag.middle
    # Both ends of a cell lie in one half plane: the argument between them is the principal one.
    turn = np.angle(number[1:] * np.conj(number[:-1]))
    whole = abs(float(turn.sum()) - 2 * np.pi) < _TURN_TOLERANCE
    return bool(np.isfinite(turn).all() and (np.abs(turn) < _CLEAR_TURN).all() and whole)


def _cells_document(loop: FrozenLoop, low: FloatArray, high: FloatArray, cells: Cells) -> dict[str, Any]:
    cover = cover_of(low, high, cells.low, cells.high)
    if cover is None:
        raise ValueError("the cells do not fill their box")
    first = replace(cells, row=np.zeros(len(cells), dtype=np.intp))
    angle = np.angle(cells.direction)
    short = np.round(angle, _ANGLE_DIGITS)
    angle = np.where(excludes(loop, replace(first, direction=_turned(short))), short, angle)
    return {"cuts": cover.cuts, "half_plane_rad": angle[cover.order].tolist()}


def _cells_from(low: FloatArray, high: FloatArray, found: Mapping[str, Any]) -> Cells:
    lows, highs = cells_of(low, high, found["cuts"])
    angle = np.array(found["half_plane_rad"], dtype=np.float64)
    if angle.shape != lows.shape[1:]:
        raise ValueError(f"{lows.shape[1]} cells with {len(angle)} half planes")
    return Cells(lows, highs, _turned(angle), np.zeros(len(angle), dtype=np.intp))


def _turned(angle: FloatArray) -> ComplexArray:
    return np.asarray(np.exp(1j * angle))
