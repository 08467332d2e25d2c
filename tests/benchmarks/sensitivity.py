"""What friction, encoder, device, delay and lost samples do to each coupling at the wall of figure 5.

nice -n 10 python tests/benchmarks/sensitivity.py [PEOPLE] [OUT]

The designs are made for the nominal device; the simulated one differs. Also finds the least friction at which everybody
comes to rest before each wall, beside the passive limit 2 b_d/T and the encoder's 2 f_c/Delta (Abbott and Okamura
2005), and the worst hand and motion of a search with and without a guard. Overwrites OUT (default
sensitivity.json where it is run: what the page says of it is recorded, the cells are not kept) after every cell and
goes on where it stopped.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

from script_arguments import PRINTED, script_arguments
from studied import about, run_campaign
from studies.designs import design
from studies.table1.adversary import WIDER_BOUNDS, worst_case

import avc_casadi as avc
from avc_casadi.model.effects import ObserverEffect
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.population.trial import Conditions, all_motions

SEED = 2026
WALL = "ve7"
WALLS = ("ve4", "ve5", "ve6", "ve7")
COUPLINGS = ("none", "static", "direct", "closed-form", "static-tuned-series", "static-tuned", "schedule")
FRICTIONS_N = (0.0, 0.05, 0.1, 0.2)
ENCODERS_M = (2e-6, 20e-6, 50e-6)
MOST_FRICTION_N = 3.2


def grid(problem, designs, people):
    """One change at a time, and every friction with every encoder."""
    declared = Conditions.declared(problem)
    lightest = problem.device.mass_kg + problem.hands.mass_kg[0]
    changes = {}
    for friction in FRICTIONS_N:
        for encoder in ENCODERS_M:
            changes[f"friction {friction:g} N, encoder {1e6 * encoder:g} um"] = (
                1.0,
                1.0,
                Conditions(friction, encoder),
            )
    for encoder in ENCODERS_M:
        observed = Conditions(0.0, encoder, observer=ObserverEffect(mass_kg=lightest))
        changes[f"friction 0 N, encoder {1e6 * encoder:g} um, observer"] = (1.0, 1.0, observed)
    for share in (0.5, 1.5):
        changes[f"device mass x {share:g}"] = (share, 1.0, declared)
        changes[f"device damping x {share:g}"] = (1.0, share, declared)
    for delay in (1, 2):
        changes[f"delay {delay}"] = (1.0, 1.0, replace(declared, delay_samples=delay))
    for dropped in (0.01, 0.05):
        changes[f"dropped {dropped:g}"] = (1.0, 1.0, replace(declared, dropped_share=dropped))
    for case, (mass, damping, conditions) in changes.items():
        for name, found in designs.items():
            yield f"{case}: {name}", partial(_share, found, mass, damping, people, conditions)


def _share(found, mass, damping, people, conditions):
    device = found.problem.device
    changed = device.model_copy(
        update={"mass_kg": mass * device.mass_kg, "damping_ns_per_m": damping * device.damping_ns_per_m}
    )
    stable = all_motions(found.problem.model_copy(update={"device": changed}), found.in_force, people, conditions)
    low, high = exact_interval(int(stable.sum()), len(stable))
    return {"stable": int(stable.sum()), "people": len(stable), "stable_low": low, "stable_high": high}


def least_friction(people):
    """Least friction at which everybody is at rest."""
    for wall in WALLS:
        problem = avc.load_problem(wall)
        for name in COUPLINGS:
            yield f"least friction, {wall}: {name}", partial(_least_friction, problem, name, people)


def _least_friction(problem, name, people):
    found, declared = design(problem, name), Conditions.declared(problem)
    device = problem.device

    def holds(friction):
        return bool(all_motions(found.problem, found.in_force, people, replace(declared, friction_n=friction)).all())

    low, high = 0.0, MOST_FRICTION_N
    if holds(0.0):
        high = 0.0
    elif not holds(high):
        high = None
    else:
        while high - low > 0.05 * high + 0.005:
            middle = (low + high) / 2
            low, high = (low, middle) if holds(middle) else (middle, high)
    return {
        "people": len(people),
        "least_friction_n": high,
        "tried_up_to_n": MOST_FRICTION_N,
        "passive_limit_n_per_m": 2 * device.damping_ns_per_m / device.sample_time_s,
        "encoder_limit_n_per_m": None if high is None else 2 * high / device.encoder_resolution_m,
        "stiffness_n_per_m": problem.environment.stiffness_n_per_m,
    }


def adversary(problem, designs):
    """The worst that a search finds."""
    declared = Conditions.declared(problem)
    cases = {"no friction": Conditions(), "as declared": declared}
    for name in ("static-tuned", "schedule"):
        for case, conditions in cases.items():
            for guarded in (False, True):
                for box, bounds in (("set A", None), ("wider", WIDER_BOUNDS)):
                    tried = replace(conditions, guarded=guarded)
                    full = f"adversary, {box}, {case}{', guard' if guarded else ''}: {name}"
                    yield full, partial(_worst, designs[name], tried, bounds)


def _worst(found, conditions, bounds):
    return worst_case(found.problem, found.in_force, conditions, SEED, bounds).document()


def main(count, out):
    problem = avc.load_problem(WALL)
    people = draw_population("A", count, SEED)
    designs = {name: design(problem, name) for name in COUPLINGS}
    made = about(f"python tests/benchmarks/sensitivity.py {count}", SEED) | {"wall": WALL}
    cells = dict((*adversary(problem, designs), *grid(problem, designs, people), *least_friction(people)))
    run_campaign(cells, out, made, PRINTED)


if __name__ == "__main__":
    arguments = script_arguments(__doc__, people=200, out=Path("sensitivity.json"))
    main(arguments.people, arguments.out)
