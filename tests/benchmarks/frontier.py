"""What stability costs in realism at the wall of figure 5, and what each ingredient of the design is worth.

nice -n 10 python tests/benchmarks/frontier.py [PEOPLE] [OUT]

Sweeps the damping in reserve for constant and scheduled gains in both structures, then takes the ingredients of the
schedule away one by one. Overwrites OUT (default tests/benchmarks/results/frontier.json) after every cell and goes on
where it stopped; overwrites tests/benchmarks/figures/frontier.png with its drawing.
"""

from functools import partial
from pathlib import Path

import numpy as np
from script_arguments import PRINTED, script_arguments
from studied import about, run_campaign
from studies.designs import design
from studies.error_curve import error_curve
from studies.reach import reach
from studies.table1.frontier_figure import draw_frontier

import avc_casadi as avc
from avc_casadi.claims.stability.stiffest_wall import damping_range, stiffest_wall
from avc_casadi.design.methods import solve
from avc_casadi.design.tuning import tuned, tuning_problem
from avc_casadi.model.effects import AdaptationEffect, EstimatorEffect
from avc_casadi.model.gains import gains_at
from avc_casadi.present.figures.layout import save_figure
from avc_casadi.simulation.population.operators import corner_subjects, draw_population
from avc_casadi.simulation.population.trial import Conditions

SEED = 2026
WALL = "ve7"
MARGINS = (-4.0, -2.0, 0.0, 1.0, 2.0, 4.0, 6.0)
BASE_MARGIN = 6.0
FREQUENCIES_HZ = np.geomspace(1.0, 200.0, 61)


def swept(problem, people):
    """Both designs at each margin, in both structures."""
    for structure in ("damped", "series"):
        for scheduled in (False, True):
            for margin in MARGINS:
                name = f"{'schedule' if scheduled else 'static-tuned'}, {structure}, margin {margin:g}"
                make = partial(tuned, problem, scheduled=scheduled, margin_ns_per_m=margin, structure=structure)
                yield name, partial(_cell, problem, make, people, Conditions())


def untuned(problem, people):
    """The couplings that nobody tunes."""
    for coupling in ("none", "static", "static-sampled", "direct", "closed-form"):
        found = design(problem, coupling)
        yield coupling, partial(_cell, found.problem, lambda found=found: found.in_force, people, Conditions())


def ablated(problem, people):
    """The schedule without one ingredient."""
    base = tuning_problem(problem, "damped", BASE_MARGIN)

    def variant(**tables):
        return base.model_copy(
            update={name: getattr(base, name).model_copy(update=change) for name, change in tables.items()}
        )

    series = tuning_problem(problem, "series", BASE_MARGIN)
    sampled_goal = base.model_copy(
        update={"boundaries": type(base.boundaries)(upper=base.environment, lower=base.environment)}
    )
    problems = {
        "whole": base,
        "without the contact damper": series,
        "without adaptation": base,
        "without margin": variant(stability={"margin_ns_per_m": 0.0}),
        "goal: the sampled wall": sampled_goal,
        "goal: the paper's bounds": base.model_copy(update={"boundaries": problem.boundaries}),
        "objective: magnitude": variant(realism={"objective": "magnitude"}),
        "scope: band": variant(stability={"scope": "band", "margin_ns_per_m": 0.0}),
        "scope: pointwise": variant(stability={"scope": "pointwise", "margin_ns_per_m": 0.0}),
        "model: paper": variant(stability={"scope": "band", "model": "paper", "margin_ns_per_m": 0.0}),
        "slope penalty 100 times": variant(schedule={"slope_penalty": 1e-2}),
        "slope penalty 0": variant(schedule={"slope_penalty": 0.0}),
    }
    for name, stated in problems.items():
        steady = name == "without adaptation"

        def make(stated=stated, steady=steady):
            table = solve(stated, "static-tuned" if steady else "schedule")
            if not table.usable.all():
                return None
            return gains_at(table) if steady else table

        yield f"ablation, {name}", partial(_cell, problem, make, people, Conditions())
    runtimes = {
        "estimator: zero-crossing": (EstimatorEffect(method="zero-crossing"), AdaptationEffect()),
        "estimator: spectral-peak": (EstimatorEffect(method="spectral-peak"), AdaptationEffect()),
        "estimator: adaptive-notch": (EstimatorEffect(method="adaptive-notch"), AdaptationEffect()),
        "gain changes not passive": (EstimatorEffect(), AdaptationEffect(passive=False)),
    }
    for name, runtime in runtimes.items():
        make = partial(tuned, problem, scheduled=True, margin_ns_per_m=BASE_MARGIN)
        yield f"ablation, {name}", partial(_cell, problem, make, people, Conditions(runtime=runtime))
    make = partial(tuned, problem, scheduled=True, margin_ns_per_m=BASE_MARGIN)
    yield "ablation, with a guard", partial(_cell, problem, make, people, Conditions(guarded=True))


def bounds(problem):
    """What no coupling can pass: the damping within which each wall is stable with everybody."""
    for population in ("A", "B"):
        yield f"limit, set {population}", partial(_limit, problem, population)


def _limit(problem, population):
    people = corner_subjects(population)
    fast = problem.device.model_copy(update={"sample_time_s": 0.25e-3})
    most = {f"{device.sample_time_s:g}": stiffest_wall(device, people) for device in (problem.device, fast)}
    nose = most[f"{problem.device.sample_time_s:g}"]
    # Dense where the range closes.
    walls = nose.stiffness_n_per_m * (1 - np.geomspace(0.98, 5e-4, 45))
    ranges = [*(damping_range(problem.device, people, float(wall)) for wall in walls), nose]
    passive = {key: 2 * problem.device.damping_ns_per_m / float(key) for key in most}
    return {
        "stiffness_n_per_m": [found.stiffness_n_per_m for found in ranges],
        "lowest_damping_ns_per_m": [_number(found.lowest_ns_per_m) for found in ranges],
        "highest_damping_ns_per_m": [_number(found.highest_ns_per_m) for found in ranges],
        "stiffest_n_per_m": {key: found.stiffness_n_per_m for key, found in most.items()},
        "stiffest_over_passive_limit": {key: found.stiffness_n_per_m / passive[key] for key, found in most.items()},
    }


def _cell(problem, make, people, conditions):
    gains = make()
    if gains is None:
        return {"infeasible": True}
    wall = avc.load_problem(WALL).environment
    found = reach(problem, gains, people, conditions, wall)
    curve = error_curve(problem, gains, FREQUENCIES_HZ, wall)
    return found | {"physical_error": list(curve.physical)}


def _number(value):
    return None if np.isnan(value) else float(value)


def main(people, out, figure):
    problem = avc.load_problem(WALL)
    subjects = draw_population("A", people, SEED)
    made = about(f"python tests/benchmarks/frontier.py {people}", SEED) | {
        "wall": WALL,
        "frequency_hz": list(FREQUENCIES_HZ),
    }
    cells = dict(
        (*bounds(problem), *untuned(problem, subjects), *swept(problem, subjects), *ablated(problem, subjects))
    )
    document = run_campaign(cells, out, made, PRINTED)
    save_figure(draw_frontier(document), figure)


if __name__ == "__main__":
    here = Path(__file__).parent
    figures = here / "figures"
    arguments = script_arguments(__doc__, people=500, out=here / "results" / "frontier.json")
    for folder in (arguments.out.parent, figures):
        folder.mkdir(exist_ok=True)
    main(arguments.people, arguments.out, figures / "frontier.png")
