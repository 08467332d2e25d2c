"""What each rule of the search of `recommend` is worth: left out, one at a time, on devices drawn at random.

    OPENBLAS_NUM_THREADS=1 nice -n 15 python tests/benchmarks/ablation_recommend.py --count 8

Overwrites results/ablation_recommend.json and RESULTS_ablation_recommend.md after every search and goes on where it
stopped. A rule whose function a device never calls with all rules is not left out there; nor are rules of declared
ranges and of `[robustness]`, which these devices do not have.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from left_out import noted, replaced
from random_devices import drawn
from studied import about, computed, cpu_seconds, expected_n_per_m, made_by, rounded, table

from avc_casadi.claims.stability.stiffest_wall import stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.rank import best_of
from avc_casadi.recommendation.search_schedule import judged_candidates
from avc_casadi.recommendation.shaken import shaken
from avc_casadi.simulation.population.coupling_trial import try_coupling, try_on_devices
from avc_casadi.simulation.population.operators import draw_hands, people_of

SEED, HANDS, OWN_SEED, FRESH_SEED = 91_204, 100, 0, 5_309
OUT = Path(__file__).parent / "results" / "ablation_recommend.json"
PAGE = Path(__file__).parent / "RESULTS_ablation_recommend.md"
ALL = "all rules"
SCHEDULE, GENERATE = "recommendation.search_schedule", "recommendation.generate"
EVALUATE = "recommendation.evaluate"
LAWS, KNOWN = "design.robust.cma_continuation", "design.robust.known_laws"
REFINEMENT = "design.robust.refinement"
# What a user would notice: a share of the stiffness, a difference of impedance error; or one hand.
STIFFER, NEARER = 0.03, 0.02


class Rule(NamedTuple):
    """What is left out: names of modules and what makes a stand-in of each, where one of the functions is called."""

    words: str
    calls: str
    stands_in: dict[str, Callable[[Any], Any]]


def _is(value: Any) -> Callable[[Any], Any]:
    return lambda _: value


def _returns(value: Any) -> Callable[[Any], Any]:
    return lambda _: lambda *_args, **_named: value


def _one_climb(original: Any) -> Any:
    return lambda evaluator, robust, wall, _climbs, **how: original(evaluator, robust, wall, range(1), **how)


def _fewer_softer(original: Any) -> Any:
    return lambda *args, **how: original(*args, **{"softer": 4} | how)


def _without_friction(original: Any) -> Any:
    def screening(self: Any, **how: Any) -> Any:
        self._rough = False
        return original(self, **how)

    return screening


def _first_alone(_: Any) -> Any:
    return lambda alternatives, *_args, **_named: (alternatives[:1], True)


CONTINUATIONS = f"{GENERATE}.continuation"
SOFTENED, LAW, REFINES = f"{SCHEDULE}.softened_to", f"{SCHEDULE}._behind_laws", f"{GENERATE}.refined"
RULES = {
    "closer": Rule(
        "halve the way to the next stiffer wall", f"{SCHEDULE}._closer", {f"{SCHEDULE}._closer": _returns(None)}
    ),
    "halved": Rule("halve it three times, not once", f"{SCHEDULE}._closer", {f"{SCHEDULE}._MOST_HALVED": _is(1)}),
    "safer": Rule(
        "still softer springs where nobody settles",
        SOFTENED,
        {f"{SCHEDULE}.SAFER": _is(()), f"{GENERATE}.SAFER": _is(())},
    ),
    "tuned": Rule(
        "tuned gains at last", f"{SCHEDULE}.tuned_candidates", {f"{SCHEDULE}.tuned_candidates": _returns(())}
    ),
    "reserves": Rule(
        "tuned with three times the reserve", f"{GENERATE}._tuned", {f"{GENERATE}._RESERVES": _is((1.0,))}
    ),
    "shares": Rule("five dampers a wall, not two", f"{GENERATE}._dampings", {f"{GENERATE}._SHARES": _is((0.5, 0.1))}),
    "of_stiffest": Rule(
        "three springs below the limit, not one", f"{GENERATE}._softened", {f"{GENERATE}.OF_STIFFEST": _is((0.9,))}
    ),
    "observers": Rule(
        "springs and dampers behind an observer",
        f"{SCHEDULE}.behind_observers",
        {f"{SCHEDULE}.behind_observers": _returns(())},
    ),
    "may_win": Rule(
        "springs that cannot win left out",
        f"{EVALUATE}.Evaluator.may_win",
        {f"{EVALUATE}.Evaluator.may_win": _returns(True)},
    ),
    "laws": Rule("laws behind an observer at all", LAW, {LAW: _returns(None)}),
    "known": Rule("laws known from other devices", f"{GENERATE}._known", {f"{GENERATE}._known": _returns(None)}),
    "climb": Rule("a second continuation where one does not hold the wall", LAW, {LAW: _one_climb}),
    "refine": Rule(
        "nearer laws than the nearest of those found",
        f"{GENERATE}.RobustCandidates.refined",
        {f"{GENERATE}.RobustCandidates.refined": _returns([])},
    ),
    "rough": Rule(
        "some screening hands with dry friction",
        f"{EVALUATE}.Evaluator.screening",
        {f"{EVALUATE}.Evaluator.screening": _without_friction},
    ),
    "generations": Rule("20 generations of a refinement, not 10", REFINES, {f"{REFINEMENT}._REFINED": _is(10)}),
    "narrower": Rule("laws drawn nearer after none was", REFINES, {f"{REFINEMENT}._NARROWER": _is(1.0)}),
    "most_laws": Rule(
        "three laws kept a wall, not one", LAW, {f"{LAWS}.MOST_LAWS": _is(1), f"{KNOWN}.MOST_LAWS": _is(1)}
    ),
    "wider": Rule("a search that narrowed is widened", CONTINUATIONS, {f"{LAWS}._WIDER": _is(1.0)}),
    "faster": Rule("larger steps after an easy wall", CONTINUATIONS, {f"{LAWS}._FASTER": _is(1.0)}),
    "softer": Rule("12 softer first walls, not 4", CONTINUATIONS, {CONTINUATIONS: _fewer_softer}),
    "off_file": Rule("laws settle on devices off their file", REFINES, {f"{EVALUATE}.off_file": _returns(())}),
    "one_in": Rule("loose hands in two stages", LAW, {f"{EVALUATE}._ONE_IN": _is(1)}),
    "learn": Rule(
        "hands that moved are asked first",
        f"{EVALUATE}.Evaluator._learn",
        {f"{EVALUATE}.Evaluator._learn": _returns(None)},
    ),
    "likeliest": Rule(
        "screening of equally stiff ones", f"{EVALUATE}.likeliest", {f"{EVALUATE}.likeliest": _first_alone}
    ),
    "replace": Rule(
        "restless ones forgotten", f"{EVALUATE}.Evaluator._replace", {f"{EVALUATE}.Evaluator._replace": _returns(None)}
    ),
    "most_tried": Rule(
        "five equally stiff ones tried, not one", f"{EVALUATE}.likeliest", {f"{EVALUATE}._MOST_TRIED": _is(1)}
    ),
    "as_near": Rule(
        "couplings 1 % apart are as near", f"{EVALUATE}.best_of", {"recommendation.rank._AS_NEAR": _is(0.0)}
    ),
    "slow": Rule(
        "a slow observer's stiffness is that of the press",
        f"{EVALUATE}.best_of",
        {"recommendation.rank._SLOW": _is(0.0)},
    ),
}


def searched(problem: Problem) -> dict[str, Any]:
    """Search as `recommend` does; what a user notices of the best, and processor time."""
    cpu, people = cpu_seconds(), people_of(problem.hands, HANDS, OWN_SEED)
    limit = stiffest_wall(problem.device, with_released(hand_corners(problem.hands)))
    found = judged_candidates(problem, people, OWN_SEED, limit, lean_on_friction=False)
    cpu = cpu_seconds() - cpu
    if not found.judged:
        return {"cpu_s": cpu, "method": None}
    best = best_of(found.judged)
    fresh = draw_hands(problem.hands, HANDS, FRESH_SEED)
    tried, felt = try_coupling(best.coupling, fresh, FRESH_SEED), expected_n_per_m(best.coupling)
    lighter = problem.device.model_copy(update={"mass_kg": 0.9 * problem.device.mass_kg})
    off = try_on_devices(best.coupling, fresh, [lighter], FRESH_SEED)
    return {
        "cpu_s": cpu,
        "method": best.coupling.method,
        "felt_n_per_m": felt,
        "errors": shaken(best.coupling, felt, (1.0, 10.0)).error.tolist(),
        "settled": int(tried.stable_without_friction.sum()),
        "settled_lighter": int(off.stable_without_friction.sum()),
        "quiet": int(tried.quiet.sum()),
    }


def everything(index: int) -> dict[str, Any]:
    """Search with all rules; which of their functions are called."""
    called: set[str] = set()

    problem = drawn(index, SEED)
    with noted({rule.calls for rule in RULES.values()}, called):
        searched(problem)
    # What is compiled once is compiled now: times compare.
    return searched(problem) | {"called": sorted(called), "wall_n_per_m": problem.environment.stiffness_n_per_m}


def without(index: int, rule: str) -> dict[str, Any]:
    """Search without one rule."""
    with replaced(RULES[rule].stands_in):
        return searched(drawn(index, SEED))


TEXT = """# What each rule of the search of `recommend` is worth

{made_by}

{count} devices with a wall each, drawn as for [RESULTS_random_devices](RESULTS_random_devices.md) with a seed of their
own, {hands} hands. Each rule is left out once on each device that uses it, and what is then best is judged by 100 fresh
hands without dry friction, on the device and on one 10 % lighter. **Noticed** is a stiffness at rest that differs by
3 %, an impedance error at 1 or 10 Hz that differs by 0.02, or another number of hands that settle. Times are processor
times of the search, on a machine that others use too.

## Devices, with all rules

{devices}

## Rules

{rules}

{conclusion}"""


def noticed(every: dict[str, Any], one: dict[str, Any]) -> list[str]:
    """Say what a user would notice without a rule."""
    if every["method"] is None or one["method"] is None:
        return [] if every["method"] == one["method"] else [f"{one['method'] or 'nothing'} recommended"]
    found = []
    ratio = one["felt_n_per_m"] / every["felt_n_per_m"]
    if abs(ratio - 1) > STIFFER:
        found.append(f"{ratio:.3g} times as stiff")
    for hz, old, new in zip((1, 10), every["errors"], one["errors"], strict=False):
        if abs(new - old) > NEARER:
            found.append(f"error at {hz} Hz {100 * old:.3g} to {100 * new:.3g} %")
    for key, words in (("settled", "hands"), ("settled_lighter", "hands on the lighter device")):
        if one[key] != every[key]:
            found.append(f"{every[key]} to {one[key]} {words}")
    return found


def write_page(document: dict[str, Any]) -> None:
    """Write the table of the rules; what was concluded from it stands below and is kept."""
    cells = document["cells"]
    whole = {name.split(":")[0]: cell for name, cell in cells.items() if name.endswith(ALL) and "error" not in cell}
    devices = [
        [
            name,
            rounded(one["wall_n_per_m"]),
            one["method"],
            rounded(one.get("felt_n_per_m")),
            " / ".join(f"{100 * error:.3g}" for error in one.get("errors", ())),
            one.get("settled", "-"),
            one.get("settled_lighter", "-"),
            f"{one['cpu_s']:.0f}",
        ]
        for name, one in whole.items()
    ]
    rules = []
    for key, rule in RULES.items():
        left = {name: cells[f"{name}: {key}"] for name in whole if f"{name}: {key}" in cells}
        told, slower = [], []
        for name, one in left.items():
            if "error" in one:
                told.append(f"{name}: {one['error']}")
                continue
            told += [f"{name}: {words}" for words in noticed(whole[name], one)]
            slower.append(one["cpu_s"] / whole[name]["cpu_s"])
        time = f"{np.median(slower):.2f}" if slower else "-"
        rules.append([rule.words, len(left), "; ".join(told) or ("nothing" if left else "not called"), time])
    conclusion = PAGE.read_text(encoding="utf-8").partition("## What goes")[2] if PAGE.exists() else ""
    head = ("device", "wall, N/m", "by", "at rest, N/m", "error at 1 / 10 Hz, %", "settle of 100", "lighter", "s")
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            count=len(whole),
            hands=HANDS,
            devices=table(head, devices),
            rules=table(("rule", "left out on", "noticed without it", "time, median"), rules),
            conclusion=f"## What goes{conclusion}" if conclusion else "",
        ),
        encoding="utf-8",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=8, help="devices; default 8")
    count = parser.parse_args().count
    made = about("OPENBLAS_NUM_THREADS=1 python tests/benchmarks/ablation_recommend.py --count N", SEED)
    for index in range(count):
        computed({f"{index}: {ALL}": partial(everything, index)}, OUT, made, write_page)
        called = json.loads(OUT.read_text(encoding="utf-8"))["cells"][f"{index}: {ALL}"].get("called", ())
        rules = (key for key, rule in RULES.items() if rule.calls in called)
        computed({f"{index}: {key}": partial(without, index, key) for key in rules}, OUT, made, write_page)


if __name__ == "__main__":
    main()
