"""A multiplier of Zames and Falb with few taps, found by a linear programme.

With the loop L = P C1 - C2 from the clipped force back to what is clipped, and a clip whose slope lies in [0, 1],

    Re{(1 - sum h_i exp(-j omega i)) (1 + L)} > 0  at every angle, for every hand,   h_i >= 0, sum h_i < 1

proves that the loop comes to rest from any state, whatever the target where the hand rests: Zames and Falb 1968,
in discrete time Willems and Brockett 1968; the loop must be stable while the clip gives nothing. One multiplier serves
all hands at once. (Turner and Drummond 2021, Carrasco and Heath 2019 on multipliers with finite response.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.proof._disc import Disc, Moving, turned
from avc_casadi.support import ComplexArray, FloatArray

if TYPE_CHECKING:
    from collections.abc import Mapping

# What the taps leave of 1, so that the multiplier is strict.
_LEFT = 1e-4
LAGS = tuple(lag for lag in range(-5, 6) if lag)


@dataclass(frozen=True)
class Multiplier:
    """1 - sum of h_i exp(-j omega i).

    Attributes:
        taps: h_i by lag i, each positive.
    """

    taps: Mapping[int, float]

    @property
    def valid(self) -> bool:
        """Whether it is one: no tap negative or at lag 0, their sum below 1 whatever the rounding."""
        values = list(self.taps.values())
        return 0 not in self.taps and all(0 <= value < 1 for value in values) and sum(values) < 1 - 1e-12

    def at(self, omega: FloatArray) -> ComplexArray:
        """Return it at angles, in plain numbers."""
        found = np.ones(np.shape(omega), dtype=np.complex128)
        for lag, tap in self.taps.items():
            found -= tap * np.exp(-1j * lag * np.asarray(omega))
        return found

    def over(self, omega: Moving) -> Moving:
        """Enclose it over angles."""
        ones = np.ones_like(omega.value.radius)
        found = Moving(Disc.around(ones, 0 * ones), {})
        for lag, tap in self.taps.items():
            found = found - turned(omega * lag) * tap
        return found


def search(omega: FloatArray, loop: ComplexArray) -> tuple[Multiplier, float]:
    """Find the taps with the largest t in Re{M (1 + L)} >= t |1 + L|.

    Args:
        omega: angles of the points, shape (p,).
        loop: L there, shape (p,); many hands may share an angle.

    Returns:
        The multiplier and t; there is none where t is not positive, as where the programme was not solved.
    """
    import casadi as ca  # noqa: PLC0415

    around = 1 + loop
    way = around / np.maximum(np.abs(around), 1e-300)
    lags = np.array(LAGS)
    rows = np.column_stack([-(np.exp(-1j * omega[:, None] * lags) * way[:, None]).real, -np.ones(len(omega))])
    matrix = np.vstack([rows, [*np.ones(len(lags)), 0.0]])
    low = np.append(-way.real, -np.inf)
    high = np.append(np.full(len(omega), np.inf), 1 - _LEFT)
    solver = ca.conic("multiplier", "highs", {"a": ca.Sparsity.dense(*matrix.shape)}, _QUIET)
    found = solver(
        g=np.append(np.zeros(len(lags)), -1.0),
        a=ca.DM(matrix),
        lba=low,
        uba=high,
        lbx=np.append(np.zeros(len(lags)), -1.0),
        ubx=np.ones(len(lags) + 1),
    )
    if not solver.stats()["success"]:
        return Multiplier({}), -np.inf
    values = np.asarray(found["x"]).ravel()
    taps = {lag: float(tap) for lag, tap in zip(LAGS, values[:-1], strict=True) if tap > _NO_TAP}
    return Multiplier(taps), float(values[-1])


_NO_TAP = 1e-9
_QUIET: dict[str, Any] = {"error_on_fail": False, "highs": {"output_flag": False}}
