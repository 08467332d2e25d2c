"""Who tries a coupling before everybody does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.trial import ends_of

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.robust import Unrest
    from avc_casadi.loop import Hand
    from avc_casadi.runtime import StateFeedback
    from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class AskedFirst:
    """People who press, tap, hold and strike.

    Attributes:
        few: with whom somebody is likely to move, if anybody does.
        others: who only try what these rest with.
        friction: whether the declared dry friction may help.
    """

    few: Hand
    others: Hand
    friction: bool

    def ends(self, coupling: Coupling) -> Unrest:
        """Prepare to ask how fast they end with laws of the structure of one: all of them where the few rest."""
        few, others = (
            ends_of(coupling, people, friction=self.friction, strike=True) for people in (self.few, self.others)
        )

        def unrest(laws: Sequence[StateFeedback]) -> FloatArray:
            first = few(laws)
            found = np.concatenate([first, np.resize(first.T, (others.people, len(laws))).T], axis=1)
            rest = np.flatnonzero((first < 1).all(axis=1)).tolist()
            if rest:
                found[rest, first.shape[1] :] = others([laws[row] for row in rest])
            return found

        return unrest
