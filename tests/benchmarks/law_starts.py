"""Laws of devices drawn at random, for the table in which searches of other devices begin; and what it is worth.

python tests/benchmarks/law_starts.py --solve COUNT [--first I]   searches laws
python tests/benchmarks/law_starts.py --write                     chooses among them for the table of the package
python tests/benchmarks/law_starts.py --check COUNT               recommends on fresh devices with it and without

Solving adds to results/law_starts.json what is not there yet, a device at a time, so that it may be stopped; it takes
about 10 s of processor a device, with a refinement three times as long as that of `recommend`. Writing tries every law
on every device, half a second of processor each, and overwrites avc_casadi/design/robust/known_laws.csv. A check
overwrites RESULTS_law_starts.md. Devices are those of `random_devices.py` with other seeds, a force limit for one half,
and walls of 0.4 to 8 times what spring and damper hold (1.1 to 8 times for those of the first seed).
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import random_devices
from studied import about, made_by, table, write_rows

import avc_casadi as avc
from avc_casadi.claims.stability.stiffest_wall import stiffest_wall
from avc_casadi.design.robust import known_laws, refinement
from avc_casadi.design.robust.known_laws import KnownLaws, known_points
from avc_casadi.design.robust.lqg import Space
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.recommendation.evaluate import Evaluator
from avc_casadi.recommendation.generate import residual_speed_at
from avc_casadi.recommendation.rank import best_of
from avc_casadi.recommendation.search_schedule import judged_candidates
from avc_casadi.simulation.population.operators import people_of

HERE = Path(__file__).parent
SOLVED = HERE / "results" / "law_starts.json"
TABLE = HERE.parents[1] / "avc_casadi" / "design" / "robust" / "known_laws.csv"
FIRST_SEED, SEED, CHECKED_SEED, HANDS = 777001, 880001, 777002, 100
# Walls over what spring and damper hold, of each seed.
WALLS = {FIRST_SEED: (1.1, 8.0), SEED: (0.4, 8.0), CHECKED_SEED: (1.1, 8.0)}
FORCES_N, SOFTEST, STIFFEST = (3.0, 40.0), 200.0, 2e5
# Generations of a refinement, and its narrowing.
REFINED = {"_REFINED": 60, "_REFINED_FREE": 60, "_NARROWER": 0.9}
# Distance beyond its own law's at which a device is as if no law of the table held its wall.
NOT_HELD = 1.0
Row = dict[str, Any]


def drawn(index: int, seed: int) -> avc.Problem | None:
    """Draw a device and a wall that needs a law; None where that is beyond what devices are for."""
    problem, random = random_devices.drawn(index, seed), np.random.default_rng([seed + 111000, index])
    limit = stiffest_wall(problem.device, with_released(hand_corners(problem.hands)))
    wall = limit.stiffness_n_per_m * float(np.exp(random.uniform(*np.log(WALLS[seed]))))
    force = {"max_force_n": float(f"{np.exp(random.uniform(*np.log(FORCES_N))):.3g}")} if random.random() < 0.5 else {}
    if not SOFTEST < wall < STIFFEST:
        return None
    return problem.changed(environment={"stiffness_n_per_m": float(f"{wall:.4g}")}, device=force)


def solved(index: int) -> Row:
    """Search a law as `recommend` does; its numbers relative to where searches begin."""
    problem = drawn(index, SEED)
    row: Row = {"seed": SEED, "index": index}
    if problem is None:
        return row
    limit = stiffest_wall(problem.device, with_released(hand_corners(problem.hands)))
    people = people_of(problem.hands, HANDS, 0)
    with mock.patch.multiple(refinement, **REFINED):
        found = judged_candidates(problem, people, 0, limit, lean_on_friction=False)
    best = best_of(found.judged) if found.judged else None
    law = None if best is None or best.safety > 0 else best.coupling.runtime.state_feedback
    space = Space(problem.device, problem.hands)
    pairs = ((step, one) for step in found.steps for one in step.candidates)
    for step, one in (pair for pair in pairs if pair[1].law is law):
        away = np.round(one.logarithms - space.starts[0], 2).tolist()
        row["numbers"] = dict(zip((knob.name for knob in space.knobs), away, strict=True))
        row["reached_n_per_m"] = float(f"{step.stiffness_n_per_m:.5g}")
        row["distance"] = round(one.cost.distance, 3)
    return row


def useful(rows: list[Row]) -> list[Row]:
    """Choose laws by what each brings the other devices, the one that brings them most first, until none brings more.

    A device gains the distance from its wall by which a law is nearer than those chosen before; the law that was found
    on it is not tried there.
    """
    devices = [row for row in rows if row["seed"] == SEED]
    least = np.array([[row["distance"] + NOT_HELD for row in devices]])
    distance = np.minimum(np.array([_distances(row, rows) for row in devices]).T, least)
    left, chosen = least[0], list[Row]()
    while True:
        gain = np.maximum(0.0, left - distance).sum(axis=1)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            return sorted(chosen, key=lambda row: (int(row["seed"]), int(row["index"])))
        chosen.append(rows[best])
        left = np.minimum(left, distance[best])


def _distances(device: Row, rows: list[Row]) -> list[float]:
    """Return the distance of the laws found on other devices before the wall that this one reached.

    Infinite where some screening hands do not settle.
    """
    problem, names = drawn(device["index"], device["seed"]), set(device["numbers"])
    assert problem is not None
    jury = Evaluator(problem, people_of(problem.hands, HANDS, 0), 0, lean_on_friction=False, executor=None)
    some = [place for place, row in enumerate(rows) if set(row["numbers"]) == names and row is not device]
    told = [{name: str(value) for name, value in rows[place]["numbers"].items()} for place in some]
    found = np.full(len(rows), np.inf)
    with mock.patch.multiple(known_laws, _rows=mock.Mock(return_value=told), MOST_LAWS=len(rows)):
        laws = KnownLaws(problem, residual_speed_at(problem, jury.screening()))
        points = known_points(Space(problem.device, problem.hands))[-len(some) :]
        places = {point.tobytes(): place for point, place in zip(points, some, strict=True)}
        step = laws.before(min(device["reached_n_per_m"], problem.environment.stiffness_n_per_m))
    for one in () if step is None else step.candidates:
        if (place := places.get(one.logarithms.tobytes())) is not None:
            found[place] = one.cost.distance
    return found.tolist()


def write_table(rows: list[Row]) -> None:
    """Write the numbers of laws; columns that a device has not are empty."""
    some = [{name: f"{value:g}" for name, value in row["numbers"].items()} for row in rows]
    names = max(some, key=len)
    with TABLE.open("w", encoding="utf-8", newline="") as text:
        writer = csv.DictWriter(text, list(names), lineterminator="\n", restval="")
        writer.writeheader()
        writer.writerows(some)


def checked(index: int) -> Row | None:
    """Recommend on a fresh device with the table, and without."""
    problem = drawn(index, CHECKED_SEED)
    if problem is None:
        return None
    at_once = KnownLaws(problem).before(problem.environment.stiffness_n_per_m)
    row: Row = {"index": index, "known": at_once is not None}
    for told in ("with", "without"):
        rows = known_laws._rows() if told == "with" else ()
        with mock.patch.object(known_laws, "_rows", lambda rows=rows: rows):
            began = time.process_time()
            found = avc.recommend(problem)
            seconds = time.process_time() - began
        felt = found.felt()
        row[told] = {
            "cpu_s": round(seconds, 1),
            "share": felt["share_of_wall"],
            "error": felt.get("complex_error", {}),
            "at_rest": None if found.trial is None else found.trial.counts()["at_rest_without_friction"],
        }
    return row


def page(made: dict[str, Any], rows: list[Row], laws: int, found: int) -> str:
    """Return the results page."""

    def told(one: Row) -> list[str]:
        error = [f"{100 * one['error'][hz]:.3g}" if hz in one["error"] else "-" for hz in ("1", "10")]
        share = "-" if one["share"] is None else f"{100 * one['share']:.3g}"
        return [f"{one['cpu_s']:.3g}", share, *error, f"{one['at_rest']}"]

    cells = [
        [str(row["index"]), "yes" if row["known"] else "no", *told(row["with"]), *told(row["without"])] for row in rows
    ]
    head = ["device", "known law holds", *(f"{what}{end}" for end in ("", ", without") for what in _COLUMNS)]
    seconds, errors = ({key: [row[key] for row in rows] for key in ("with", "without")} for _ in range(2))
    cpu = {key: np.median([one["cpu_s"] for one in some]) for key, some in seconds.items()}
    at_1 = {key: np.median([one["error"].get("1", np.nan) for one in some]) for key, some in errors.items()}
    at_10 = {key: np.median([one["error"].get("10", np.nan) for one in some]) for key, some in errors.items()}
    known = sum(row["known"] for row in rows)
    return _TEXT.format(
        made_by=made_by(made),
        laws=laws,
        found=found,
        count=len(rows),
        known=known,
        table=table(head, cells),
        **{f"cpu_{key}": f"{value:.3g}" for key, value in cpu.items()},
        **{f"one_{key}": f"{100 * value:.3g}" for key, value in at_1.items()},
        **{f"ten_{key}": f"{100 * value:.3g}" for key, value in at_10.items()},
    )


_COLUMNS = ("CPU, s", "at rest, % of the wall", "error at 1 Hz, %", "at 10 Hz, %", "of 100 settle")
_TEXT = """# Searches that begin at laws known from other devices

{made_by}

{laws} laws stand in the package (`known_laws.csv`), each told by its numbers relative to the initial guess of searches.
They are those of {found} that searches found for devices drawn at random which brought another of these devices
anything: a law nearer to the wall that was reached there, with which all screening hands settle. A search looks whether
one of them holds the wanted wall at once; else it begins at the stiffest rung of a ladder of softer walls that one
holds. On 13 devices before walls that were not reached, continuations from there ended stiffer and nearer than those
from the initial guesses, whether 150 or 390 laws were known, and in half the time. A regression from the numbers of the
device to those of its law was tried and left: left out in turn, of 50 laws it explained half of the variance of one
number and next to nothing of the others, as many laws are as good and searches end at any of them.

On {count} fresh devices, each before a wall of 1.1 to 8 times what spring and damper hold, a known law held all linear
loops before that wall on {known}. Median of the time of the processor: {cpu_with} s with the table, {cpu_without} s
without; of the impedance error {one_with} and {one_without} % at 1 Hz, {ten_with} and {ten_without} % at 10 Hz.
The search with the table goes first on each device and compiles what both run, some seconds that are not the table's.

{table}
"""


def main() -> None:
    """Solve, write, or check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--solve", metavar="COUNT", type=int, help="devices to search laws for")
    what.add_argument("--write", action="store_true", help="choose among the laws, and write the table")
    what.add_argument("--check", metavar="COUNT", type=int, help="fresh devices to recommend on")
    parser.add_argument("--first", metavar="I", type=int, default=0, help="first of the devices")
    args = parser.parse_args()
    kept = json.loads(SOLVED.read_text(encoding="utf-8"))["rows"] if SOLVED.exists() else []
    if args.solve is not None:
        made = about("python tests/benchmarks/law_starts.py --solve N", SEED)
        for index in range(args.first, args.first + args.solve):
            if (SEED, index) not in {(row["seed"], row["index"]) for row in kept}:
                kept = sorted([*kept, solved(index)], key=lambda row: (int(row["seed"]), int(row["index"])))
                write_rows(SOLVED, made, kept)
        return
    if args.write:
        write_table(useful([row for row in kept if "numbers" in row]))
        return
    rows = [row for index in range(args.check) if (row := checked(args.first + index)) is not None]
    made = about("python tests/benchmarks/law_starts.py --check N", CHECKED_SEED)
    laws, found = len(known_laws._rows()), sum("numbers" in row for row in kept)
    (HERE / "RESULTS_law_starts.md").write_text(page(made, rows, laws, found), encoding="utf-8")


if __name__ == "__main__":
    main()
