"""The contact law that runs: the one that the problem asks for, where it has a surface to act on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from avc_casadi.problem import Contact

FIRST_CONTACT: Contact = "gated"
"""The contact law before there were two: that of files which name none, and part of no name that was given then."""


def contact_law(asked: Contact, wall_stiffness_n_per_m: float, stiffness_n_per_m: ArrayLike) -> Contact:
    """Return the contact law that runs at a wall.

    Dampers alone know no place: clipped last they would be felt in free space, wherever the device moves towards the
    wall. Without a spring in the wall, or in the coupling at any frequency, the law is therefore gated.

    Args:
        asked: of the problem.
        wall_stiffness_n_per_m: k_e.
        stiffness_n_per_m: k of all gains that may run; infinite for a rigid coupling.
    """
    springs = wall_stiffness_n_per_m > 0 and bool(np.all(np.asarray(stiffness_n_per_m) > 0))
    return asked if springs else "gated"
