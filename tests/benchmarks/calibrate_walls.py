"""Fit the walls VE4, VE5 and VE6 to the paper's column without coupling.

python tests/benchmarks/calibrate_walls.py [PEOPLE]

The paper names VE2 to VE7 and counts how many of 10 hands they leave stable without coupling; it gives no stiffness. A
wall is calibrated to the stiffness at which the training hands of set A are stable in the expected share
(count + 1/2)/11 (Jeffreys). VE7 is the wall of figure 5, and counts of 10 of 10 do not decide the soft end. Prints the
stiffness; problems/ve4.toml to ve6.toml hold the values to two digits. Overwrites no file.
"""

import math

from script_arguments import script_arguments

import avc_casadi as avc
from avc_casadi.design.comparison.table1 import PAPER
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.trial import Conditions, all_motions

FITTED = ("VE4", "VE5", "VE6")


def expected_share(count: int, trials: int = 10) -> float:
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
        boundaries={"upper": scaled(bounds.upper), "lower": scaled(bounds.lower)},
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


def main(people):
    device = avc.load_problem("ve7")
    for wall in FITTED:
        count = PAPER[wall].stable_without_coupling
        stiffness = calibrated_stiffness(device, count, people=people)
        in_use = avc.load_problem(wall.lower()).environment.stiffness_n_per_m
        print(f"{wall}: {count} of 10, share {expected_share(count):.3f}: {stiffness:.4g} N/m; in use {in_use:.4g} N/m")


if __name__ == "__main__":
    main(script_arguments(__doc__, people=500).people)
