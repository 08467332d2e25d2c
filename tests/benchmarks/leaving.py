"""The force that still acts outside the wall after a press: recommended with and without preference for a short one.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/leaving.py --count 12

Overwrites results/leaving.json and RESULTS_leaving.md after every device and goes on where it stopped. The first
devices of a larger count are those of a smaller one; some ten seconds of processor time each.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from drawn_devices import drawn
from studied import about, computed, made_by, table

from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import stiffest_wall
from avc_casadi.recommendation import rank
from avc_casadi.recommendation.candidates import judge_all
from avc_casadi.recommendation.evaluator import Evaluator
from avc_casadi.recommendation.rank import Candidate
from avc_casadi.recommendation.rendered import NOTICED_LATE_S, leaving_contact
from avc_casadi.recommendation.request import Request

SEED, OTHER_SEED, HANDS = 9173, 7041, 100
OUT = Path(__file__).parent / "results" / "leaving.json"
PAGE = Path(__file__).parent / "RESULTS_leaving.md"
BEFORE, NOW = "without the preference", "with it"


def cell(index: int, seed: int) -> dict[str, Any]:
    """Judge the candidates for a drawn device once, and choose among them in both ways."""
    problem = drawn(index, seed)
    evaluator = Evaluator(problem, Request(hands=HANDS))
    judge_all(problem, evaluator, stiffest_wall(PlantFamily.of(problem)))
    judged = evaluator.candidates
    found: dict[str, Any] = {"wall_n_per_m": problem.environment.stiffness_n_per_m, "candidates": len(judged)}
    found[NOW] = _figures(evaluator.best())
    evaluator.candidates = judged
    with mock.patch.object(rank, "_without_late_push", lambda candidates: candidates):
        found[BEFORE] = _figures(evaluator.best())
    return found


def _figures(chosen: Candidate | None) -> dict[str, Any] | None:
    if chosen is None:
        return None
    return {
        "method": chosen.coupling.method,
        "order": chosen.order,
        "error": chosen.error,
        "distance": chosen.distance,
        "safety": chosen.safety,
        "leaving": vars(leaving_contact(chosen.coupling)),
    }


TEXT = """# What still pushes a hand that has left the wall

{made_by}

{count} devices with a wall each, drawn as in [random devices](RESULTS_random_devices.md), half of them with seed
{other_seed}. The candidates of `avc recommend` are judged once. The best is chosen with the preference for a force that
ends as the hand leaves the wall, and without it. The table has the force outside, as in `felt.leaving`: a hand presses
with 5 N, rests, and withdraws to 10 mm outside within 0.5 s ([how](../../avc_casadi/recommendation/README.md)). The
error is that of the impedance at the handle from 1 to 30 Hz, without encoder steps.

{summary}

{rows}
"""


def write_page(document: dict[str, Any]) -> None:
    cells = {name: one for name, one in document["cells"].items() if one.get(NOW) is not None}
    pushing = {
        way: sum(one[way]["leaving"]["lasting_s"] > NOTICED_LATE_S for one in cells.values()) for way in (BEFORE, NOW)
    }
    others = {name: one for name, one in cells.items() if one[BEFORE]["order"] != one[NOW]["order"]}
    summary = (
        f"Of {len(cells)} devices with a coupling {pushing[BEFORE]} push for more than "
        f"{1e3 * NOTICED_LATE_S:.0f} ms without the preference, {pushing[NOW]} with it. Another coupling is chosen on "
        f"{len(others)}{': ' if others else ''}{', '.join(others)}."
    )
    rows = []
    for name, one in cells.items():
        parts = [_told(one[BEFORE]), _told(one[NOW]) if name in others else "the same"]
        rows.append([name, f"{one['wall_n_per_m'] / 1e3:.3g}", *parts])
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            count=len(document["cells"]),
            other_seed=OTHER_SEED,
            summary=summary,
            rows=table(("device", "wall, kN/m", BEFORE, NOW), rows),
        ),
        encoding="utf-8",
    )


def _told(chosen: dict[str, Any]) -> str:
    leaving = chosen["leaving"]
    pushes = f"{leaving['force_n']:.1f} N, {1e3 * leaving['lasting_s']:.0f} ms, {1e3 * leaving['outside_m']:.2f} mm"
    return f"{chosen['method']}, error {100 * chosen['error']:.0f} %: {pushes if leaving['lasting_s'] else 'none'}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=12, help="devices of each seed, default 12")
    count = parser.parse_args().count
    command = "OPENBLAS_NUM_THREADS=1 python tests/benchmarks/leaving.py --count N"
    cells = {f"device-{index}": partial(cell, index, SEED) for index in range(count)}
    cells |= {f"{OTHER_SEED}-{index}": partial(cell, index, OTHER_SEED) for index in range(count)}
    computed(cells, OUT, about(command, SEED), write_page)


if __name__ == "__main__":
    main()
