"""The one thing that is fitted to the paper: how stiff the walls are, from its column without coupling alone.

The paper names VE2 to VE7 and counts how many of 10 hands they leave stable without coupling, 10, 10, 10, 4, 0, 0; it
gives no stiffness. A wall is calibrated to the stiffness at which the training people of set A are stable in the
expected share (count + 1/2)/11 (Jeffreys). VE4, VE5 and VE6 can be so fitted; VE7 is the wall of figure 5, and the soft
end is not decided by counts of 10 of 10.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.trial import Conditions, all_motions

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem

TRIALS_OF_THE_PAPER = 10
# Damping of the walls over their stiffness, as in figure 5: 10 N.s/m to 1e5 N/m.
WALL_LOSS_S = 1e-4


def expected_share(count: int, trials: int = TRIALS_OF_THE_PAPER) -> float:
    """Mean of the Jeffreys posterior of a share that showed `count` of `trials`."""
    return (count + 0.5) / (trials + 1)


def with_wall(problem: Problem, stiffness_n_per_m: float) -> Problem:
    """Put another wall of the same kind into a problem, its bounds scaled with it."""
    ratio = stiffness_n_per_m / problem.environment.stiffness_n_per_m

    def scaled(impedance: object) -> dict[str, float]:
        return {name: value * ratio for name, value in vars(impedance).items()}

    bounds = problem.boundaries
    return problem.changed(
        environment=scaled(problem.environment),
        boundaries={"upper": scaled(bounds.upper), "lower": scaled(bounds.lower), "measured": None},
    )


def share_without_coupling(problem: Problem, subjects: Hand | StylusHand) -> float:
    """Share of people who are stable without coupling in every motion."""
    return float(all_motions(problem, NO_COUPLING, subjects, Conditions.declared(problem)).mean())


def calibrated_stiffness(
    problem: Problem, count: int, *, people: int = 1000, seed: int = 0, ends_n_per_m: tuple[float, float] = (5e3, 2e5)
) -> float:
    """Stiffness at which the training people are stable without coupling in the share that a count suggests.

    Args:
        problem: a wall of the ladder; its device counts.
        count: how many of 10 the paper found stable.
        people: number of training people.
        seed: seed of their draw.
        ends_n_per_m: bracket; the share falls with stiffness.

    Returns:
        The stiffness, N/m, to 1 %.
    """
    subjects = draw_population("A", people, seed, "training")
    wanted = expected_share(count)
    low, high = ends_n_per_m
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        if share_without_coupling(with_wall(problem, middle), subjects) > wanted:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)
