"""What each property of a real device costs each kind of design: one property more on each rung, six walls.

nice -n 10 python tests/benchmarks/realism_ladder.py

Overwrites results/realism_ladder.json and RESULTS_realism_ladder.md after every cell and goes on where it stopped.
About ten minutes of processor time.
"""

from __future__ import annotations

import argparse
from functools import cache, partial
from pathlib import Path
from typing import Any

from studied import about, computed, cpu_seconds, expected_n_per_m, felt_n_per_m, made_by, rounded, table
from studies.designs import design

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.problem import Boundaries, GainBox, Impedance, Problem, Realism, Stability
from avc_casadi.recommendation.recommend import Recommendation
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of

SEED = 2026
PEOPLE = 100
OUT = Path(__file__).parent / "results" / "realism_ladder.json"
PAGE = Path(__file__).parent / "RESULTS_realism_ladder.md"

WALLS_KN_PER_M = (3, 6, 10, 20, 50, 100)
# The order in which they are computed: a study that is stopped spans the range.
_FIRST = (6, 20, 3, 10, 100, 50)
IDEAL = {"mass_kg": 0.1, "damping_ns_per_m": 2.0, "sample_time_s": 1e-3}
RUNGS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "+ friction 0.2 N": {"coulomb_friction_n": 0.2},
    "+ encoder 20 um": {"encoder_resolution_m": 2e-5},
    "+ one sample of delay": {"delay_samples": 1},
    "+ amplifier 1 kHz": {"amplifier_bandwidth_hz": 1000.0},
    "+ resonance 150 Hz": {"resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.5}},
    "+ force limit 8 N": {"max_force_n": 8.0},
}
# A spring that no hand tells from a rigid joint, for designs that ask for an infinite one.
RIGID_N_PER_M = 1e8
DESIGNS = {
    "recommend": "recommended",
    "leaning": "leaning on friction",
    "static-tuned": "constant gains tuned for the ideal device",
    "closed-form": "the paper's closed form",
    "direct": "the paper's optimum, at rest",
}


def on_rung(rung: str, wall_kn_per_m: float) -> Problem:
    """Return a wall on the device with the properties up to a rung."""
    device = dict(IDEAL)
    for name, values in RUNGS.items():
        device |= values
        if name == rung:
            break
    wall = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=1e3 * wall_kn_per_m)
    box = avc.load_problem("reference-r1").coupling
    return Problem(device=device, environment=wall, coupling=box, stability={"model": "sampled-data", "scope": "hands"})


@cache
def ideal_gains(wall_kn_per_m: float, name: str) -> Gains | str:
    """Return the gains that a design of the ideal device ends with at rest, or why there are none."""
    problem = on_rung("ideal", wall_kn_per_m)
    if name != "static-tuned":
        paper = {"coupling": GainBox(), "stability": Stability(), "realism": Realism()}
        wall = problem.environment
        problem = problem.changed(**paper, boundaries=Boundaries(upper=wall, lower=wall))
    found = design(problem, name)
    if found.gains is None:
        return found.reason
    b, k, contact = vars(found.gains).values()
    return Gains(0.0, RIGID_N_PER_M, contact) if found.gains.rigid else Gains(b, k, contact)


def cell(rung: str, wall_kn_per_m: float) -> dict[str, Any]:
    problem = on_rung(rung, wall_kn_per_m)
    people = people_of(problem.hands, PEOPLE, SEED)
    started = cpu_seconds()
    found = avc.recommend(problem, hands=PEOPLE, seed=SEED)
    seconds = cpu_seconds() - started
    outcome = {"recommend": _recommended(found), "leaning": _recommended(_leaning(problem, found))}
    for name in ("static-tuned", "closed-form", "direct"):
        gains = ideal_gains(wall_kn_per_m, name)
        if isinstance(gains, str):
            outcome[name] = {"reason": gains}
        else:
            tried = Coupling.constant(problem, gains, name)
            outcome[name] = _fared(tried, try_coupling(tried, people, SEED)) | {"gains": vars(gains)}
    return {"designs": outcome, "recommend_cpu_s": round(seconds, 1)}


def _leaning(problem: Problem, found: Recommendation) -> Recommendation:
    """Recommend again where leaning on friction makes a wall stiffer."""
    own = 0.0 if found.coupling is None else expected_n_per_m(found.coupling)
    if (found.with_friction_n_per_m or 0.0) <= 1.01 * own:
        return found
    return avc.recommend(problem, hands=PEOPLE, seed=SEED, lean_on_friction=True)


def _recommended(found: Recommendation) -> dict[str, Any]:
    if found.coupling is None:
        return {"reason": found.reason}
    return _fared(found.coupling, found.trial) | {"method": found.coupling.method}


def _fared(coupling: Coupling, trial: Any) -> dict[str, Any]:
    return {
        "people": trial.hands,
        "at_rest": int(trial.stable.sum()),
        "at_rest_without_friction": int(trial.stable_without_friction.sum()),
        "at_rest_by_motion": {name: int(rest.sum()) for name, rest in trial.by_motion.items()},
        "quiet": int(trial.quiet.sum()),
        "at_force_limit": int(trial.at_force_limit.sum()),
        "felt_n_per_m": felt_n_per_m(trial),
        "expected_n_per_m": expected_n_per_m(coupling),
    }


def shown(found: dict[str, Any]) -> str:
    """Return hands at rest in press/tap/hold, one number where they agree, and what is felt in kN/m."""
    if "reason" in found:
        return "none"
    counts = list(found["at_rest_by_motion"].values())
    rest = str(counts[0]) if len(set(counts)) == 1 else "/".join(map(str, counts))
    felt = found["felt_n_per_m"]
    kn = "-" if felt is None or not counts[0] else rounded(felt / 1e3, 2)
    free = found["at_rest_without_friction"]
    star = f" ({free} without friction)" if free != found["at_rest"] else ""
    return f"{rest}{star}; {kn}"


TEXT = """# What each property of a real device costs each kind of design

{made_by}

A device of 0.1 kg and 2 N.s/m at 1 kHz gets one property more on each rung; the last one is `reference-r1`. Each cell:
how many of 100 hands (default set, corners first) settle in press/tap/hold, one number where all agree, in
brackets how many do in all motions without the dry friction where that differs; then the median stiffness felt, kN/m,
by hands that rest in a press without leaning on the force limit (-: none; an encoder leaves up to half a step of depth
open, so that it may exceed the wall). **Recommended** is `avc recommend` for the
device of the rung; **leaning on friction** the same with `lean_on_friction=True`. The other three are designed for the
ideal device, as all designs of 0.1.0 were, and simulated with the properties of the rung: `static-tuned` with contact
damper, the paper's closed form as a rigid coupling with its damper, the paper's optimum (`direct`, series) with the
gains of a hand at rest. Before 6 and 10 kN/m those are a damper of 10 000 N.s/m without a spring: it creeps, and what
is felt at the end of a press of 3 s says little.

{summary}

{tables}
"""


def stiffest(cells: dict[str, Any], rung: str, name: str, key: str) -> float:
    """Return the most that is felt on a rung with all 100 hands at rest in every motion, kN/m; 0 for none."""
    felt = [
        found["felt_n_per_m"]
        for wall in WALLS_KN_PER_M
        if (one := cells.get(f"{rung} | {wall} kN/m")) is not None
        and (found := one["designs"][name]).get(key) == PEOPLE
        and found["felt_n_per_m"] is not None
    ]
    return max(felt, default=0.0) / 1e3


def summary(document: dict[str, Any]) -> str:
    """Say what the tables show, from their numbers."""
    cells = {name: one for name, one in document["cells"].items() if "error" not in one}

    def most(rung: str, name: str, key: str) -> str:
        return rounded(stiffest(cells, rung, name, key), 2) if stiffest(cells, rung, name, key) else "no wall"

    def both(rung: str, name: str) -> str:
        with_friction, free = (stiffest(cells, rung, name, key) for key in ("at_rest", "at_rest_without_friction"))
        return f"{rounded(with_friction, 2)} / {rounded(free, 2)}" if with_friction else "none"

    def held(name: str, key: str = "at_rest") -> int:
        return sum(one["designs"][name].get(key) == PEOPLE for one in cells.values())

    first, *_, last = RUNGS
    tuned, ours = "static-tuned", "recommend"
    said = (
        f"What it shows: gains made for the ideal device hold {most(first, tuned, 'at_rest')} kN/m there and, with all "
        f"that reference-r1 declares, {most(last, tuned, 'at_rest')} kN/m by the grace of friction and "
        f"{most(last, tuned, 'at_rest_without_friction')} without it; what is recommended holds "
        f"{most(last, ours, 'at_rest_without_friction')} without friction and {most(last, 'leaning', 'at_rest')} "
        "leaning on it."
    )
    counts = ", ".join(
        f"{told} {held(name)} ({held(name, 'at_rest_without_friction')} without friction too)"
        for name, told in DESIGNS.items()
    )
    failed = len(document["cells"]) - len(cells)
    return (
        f"{said}\n\nStiffest that is felt before any of the walls with all 100 hands at rest in every motion, kN/m, "
        "with the declared friction / without:\n\n"
        + table(("device", *DESIGNS.values()), ([rung, *(both(rung, name) for name in DESIGNS)] for rung in RUNGS))
        + f"\n\nCells of {len(cells)} ({len(RUNGS) * len(WALLS_KN_PER_M)} planned, {failed} ended with an error) in "
        f"which all 100 hands rest in every motion: {counts}."
    )


def write_page(document: dict[str, Any]) -> None:
    parts = []
    for wall in WALLS_KN_PER_M:
        rows = []
        for rung in RUNGS:
            found = document["cells"].get(f"{rung} | {wall} kN/m")
            if found is not None and "error" in found:
                rows.append([rung, found["error"], *[""] * (len(DESIGNS) - 1)])
            elif found is not None:
                rows.append([rung, *(shown(found["designs"][name]) for name in DESIGNS)])
        if rows:
            parts.append(f"## {wall} kN/m\n\n" + table(("device", *DESIGNS.values()), rows))
    text = TEXT.format(made_by=made_by(document["about"]), summary=summary(document), tables="\n\n".join(parts))
    PAGE.write_text(text, encoding="utf-8")


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    cells = {f"{rung} | {wall} kN/m": partial(cell, rung, wall) for wall in _FIRST for rung in RUNGS}
    computed(cells, OUT, about("python tests/benchmarks/realism_ladder.py", SEED), write_page)


if __name__ == "__main__":
    main()
