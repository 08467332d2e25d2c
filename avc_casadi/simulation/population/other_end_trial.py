"""Common results of trials of couplings to a virtual tool and of teleoperators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular, short


@dataclass(frozen=True, eq=False, repr=False)
class OtherEndTrial(Tabular):
    """Results by simulated hand; every array has shape (hands,)."""

    seed: int
    by_motion: dict[str, BoolArray]
    stiffness_n_per_m: FloatArray
    tap_force_n: FloatArray

    @property
    def stable(self) -> BoolArray:
        """Settled in every motion."""
        return np.asarray(np.all(list(self.by_motion.values()), axis=0))

    @property
    def hands(self) -> int:
        """Number of hands."""
        return len(self.stable)

    @property
    def settled(self) -> bool:
        """Whether all hands settle."""
        return bool(np.all(self.stable))

    def to_dict(self) -> Columns:
        """Return the results by hand as columns, each of shape (hands,)."""
        return {
            "hand": np.arange(self.hands),
            "stable": self.stable,
            **self._more_columns(),
            "stiffness_n_per_m": self.stiffness_n_per_m,
            "tap_force_n": self.tap_force_n,
        }

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        felt = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        found: dict[str, Any] = plain(
            {
                "hands": self.hands,
                "seed": self.seed,
                "motions": list(self.by_motion),
                "settled": int(self.stable.sum()),
                "settled_by_motion": {name: int(runs.sum()) for name, runs in self.by_motion.items()},
                **self._more(),
                "rendered_stiffness_n_per_m": float(np.median(felt)) if len(felt) else None,
                "tap_force_n": float(self.tap_force_n.max()),
            }
        )
        return found

    def _more_columns(self) -> Columns:
        return {}

    def _more(self) -> dict[str, Any]:
        return {}

    def _summary(self) -> str:
        return f"{int(self.stable.sum())} of {self.hands} hands settle; {short(self.stiffness_n_per_m)} rendered"
