"""The wall of figure 5 before many simulated people: how many come to rest, and how real it feels.

nice -n 10 python tests/benchmarks/reach.py [PEOPLE] [OUT]

Overwrites OUT (default tests/benchmarks/results/reach.json) after every cell and goes on where it stopped.
"""

import time
from functools import partial
from pathlib import Path

from script_arguments import PRINTED, script_arguments
from studied import about, run_campaign
from studies.reach import reach, with_observer

import avc_casadi as avc
from avc_casadi.design.constant.static_tuned import tuned_margin
from avc_casadi.design.tuning import tuned
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.trial import Conditions

SEED = 2026
WALL = "ve7"
# Damping in reserve, N.s/m: enough for these people; and enough for a coarse encoder and a search for the worst.
LEAST_MARGIN, MARGIN = 2.0, 6.0


def cells(people):
    problem = avc.load_problem(WALL)
    coarse = with_observer(problem, Conditions(encoder_m=20e-6))
    cases = {
        "no friction": (Conditions(), LEAST_MARGIN),
        "as declared (0.2 N, 2 um)": (Conditions.declared(problem), LEAST_MARGIN),
        "no friction, 20 um, observer": (coarse, MARGIN),
        "0.2 N, 20 um, observer": (with_observer(problem, Conditions(0.2, 20e-6)), MARGIN),
        "no friction, 20 um, no observer": (Conditions(encoder_m=20e-6), MARGIN),
        "no friction, margin 6": (Conditions(), MARGIN),
        "as declared, margin 6": (Conditions.declared(problem), MARGIN),
    }
    for case, (conditions, margin) in cases.items():
        for scheduled in (False, True):
            name = f"{'schedule' if scheduled else 'static-tuned'}, set A, {case}"
            yield name, partial(_cell, problem, scheduled, margin, "A", people, conditions)
    for scheduled, wall, sample_time_s in ((False, 107e3, 1e-3), (True, 107e3, 1e-3), (False, 1.6e6, 0.25e-3)):
        stiffer = walled(problem, wall, sample_time_s)
        coupling = "schedule" if scheduled else "static-tuned"
        name = f"{coupling}, set A, no friction, {wall:g} N/m at {1e3 * sample_time_s:g} ms"
        yield name, partial(_cell, stiffer, scheduled, tuned_margin(stiffer), "A", people, Conditions())
    for population, many in (("B", people // 10), ("arm", 1)):
        for case in ("no friction", "as declared (0.2 N, 2 um)"):
            conditions, margin = cases[case]
            name = f"static-tuned, set {population}, {case}"
            yield name, partial(_cell, problem, False, margin, population, many, conditions)


def walled(problem, stiffness_n_per_m, sample_time_s):
    """A stiffer wall with the damper of figure 5, at another sample time; the gain box reaches as far beyond it."""
    wall = problem.environment.model_copy(update={"stiffness_n_per_m": stiffness_n_per_m})
    device = problem.device.model_copy(update={"sample_time_s": sample_time_s})
    ends = {
        "damping_ns_per_m": (0.0, 1e3 * problem.environment.damping_ns_per_m),
        "stiffness_n_per_m": (0.0, 1e2 * stiffness_n_per_m),
    }
    box = problem.coupling.model_copy(update=ends)
    return problem.model_copy(update={"environment": wall, "device": device, "coupling": box})


def _cell(problem, scheduled, margin, population, people, conditions):
    started = time.perf_counter()
    gains = tuned(problem, scheduled=scheduled, margin_ns_per_m=margin)
    found = reach(problem, gains, draw_population(population, people, SEED), conditions, population=population)
    return found | {"margin_ns_per_m": margin, "seconds": round(time.perf_counter() - started, 1)}


def main(people, out):
    made = about(f"python tests/benchmarks/reach.py {people}", SEED) | {"wall": WALL}
    document = run_campaign(dict(cells(people)), out, made, PRINTED)
    for name, cell in document["cells"].items():
        low = cell["stable_low"]
        print(f"{name}: {cell['stable']} of {cell['people']} (at least {100 * low:.2f} %)", cell["stiffness_share"])


if __name__ == "__main__":
    arguments = script_arguments(__doc__, people=10_000, out=Path(__file__).parent / "results" / "reach.json")
    arguments.out.parent.mkdir(exist_ok=True)
    main(arguments.people, arguments.out)
