"""The dead zone of observer laws: what its width, memory and thresholds do, and what `recommend` answers with it.

OPENBLAS_NUM_THREADS=1 nice python tests/benchmarks/dead_zone.py --count 12

Overwrites results/dead_zone.json and RESULTS_dead_zone.md after every cell and goes on where it stopped. Cells "before"
are kept: `--before`, with the package of commit aece7f02, measured them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from drawn_devices import drawn
from studied import about, computed, cpu_seconds, made_by, table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracle"))

from hardware_bench import export_c
from whole_device import WholeDevice, held, people, rests_as_tried

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.program import program_answers
from avc_casadi.model.problem import Hands, Problem
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_casadi.recommendation.evaluator import MOST_MOTIONS
from avc_casadi.recommendation.rank import impedance_error
from avc_casadi.recommendation.rendered import frequency_sweep
from avc_casadi.simulation.population.motions import LONGER_S
from avc_casadi.simulation.population.operators import loose_grips, people_of
from avc_casadi.simulation.population.trial import residual_speeds

OUT = Path(__file__).parent / "results" / "dead_zone.json"
PAGE = Path(__file__).parent / "RESULTS_dead_zone.md"
NAMED = ("figure5", "reference-r1", "reference-r2", "reference-r3", "heavy and coarse")
CHOSEN_SEED, CONFIRMED_SEED = 77001, 91823
"""Devices on which the numbers were chosen, and others."""
HANDS, TRIED, ENOUGH = 60, 200, 0.97
"""Hands, and loose grips, with each dead zone; hands with the exported C; share of the grips that must rest."""
MOVED_HZ = (1.0, 3.0, 10.0)
STRIKE_M_PER_S = 0.3
# Looser than [hands]: 20 to 100 g, 0.5 to 3 N.s/m, 20 to 200 N/m.
LOOSER = Hands(mass_kg=(0.02, 0.1), damping_ns_per_m=(0.5, 3.0), stiffness_n_per_m=(20.0, 200.0))


@dataclass(frozen=True)
class DeadZone:
    """A dead zone to compare: half width in encoder steps; the range at which it opens and is open in half widths."""

    label: str
    steps: float
    opens: float = 1.0
    open: float = 4.0
    memory_s: float = 0.6
    smoothed_hz: float = 15.0  # infinite: not smoothed
    shift: float = 0.0  # of the wall's face, in half widths

    def of(self, law: StateFeedback, problem: Problem) -> StateFeedback:
        """Return a law with this dead zone."""
        half_m, t = self.steps * problem.device.encoder_resolution_m, problem.device.sample_time_s
        zone = {
            "dead_zone_m": half_m,
            "face_m": self.shift * half_m,
            "opens_m": self.opens * half_m,
            "open_m": self.open * half_m,
            "kept": math.exp(-t / self.memory_s),
            "smoothing": math.exp(-2 * math.pi * self.smoothed_hz * t),
        }
        return law.model_copy(update=zone)


COMPARED = (
    DeadZone("always closed, 0.75 steps, face shifted (before)", 0.75, 0.0, 0.0, shift=1.0),
    DeadZone("always closed, 1.5 steps", 1.5, 0.0, 0.0),
    # Opens where the range of counts is 1 step over the zone's width, open from 4 on.
    DeadZone("1.5 steps, range of counts not smoothed, 0.3 s", 1.5, 2 + 1 / 1.5, 2 + 4 / 1.5, 0.3, math.inf),
    DeadZone("1 step", 1.0),
    DeadZone("1.25 steps", 1.25),
    DeadZone("1.5 steps", 1.5),
    DeadZone("2 steps", 2.0),
    DeadZone("3 steps", 3.0),
    DeadZone("1.25 steps, memory 0.3 s", 1.25, memory_s=0.3),
    DeadZone("1.25 steps, memory 1 s", 1.25, memory_s=1.0),
    DeadZone("1.25 steps, not smoothed", 1.25, smoothed_hz=math.inf),
    DeadZone("1.25 steps, smoothed at 30 Hz", 1.25, smoothed_hz=30.0),
    DeadZone("1.25 steps, open at 2 half widths", 1.25, open=2.0),
    DeadZone("1.25 steps, open at 6 half widths", 1.25, open=6.0),
    DeadZone("1.25 steps, face shifted", 1.25, shift=1.0),
)
CONFIRMED = (COMPARED[0], *COMPARED[3:8])


def problem_of(name: str) -> Problem:
    """Return a problem of the study."""
    if name == "heavy and coarse":  # all else is that of reference-r1
        device = {"mass_kg": 0.32, "encoder_resolution_m": 61e-6, "max_force_n": 15.0}
        return avc.load_problem("reference-r1").changed(device=device, environment={"stiffness_n_per_m": 12700.0})
    seed, _, index = name.partition(" ")
    return drawn(int(index), int(seed)) if index else avc.load_problem(name)


def led_errors(coupling: Coupling) -> list[float]:
    """Return the impedance error to a handle led in a sine, encoder and dead zone counted."""
    return [float(error) for error in frequency_sweep(coupling, coupling.static_stiffness_n_per_m, MOVED_HZ).error]


def compared(name: str, zones: tuple[DeadZone, ...]) -> dict[str, Any]:
    """Return error in motion and hands at rest without friction of the program's first law with each dead zone."""
    problem = problem_of(name)
    answers = program_answers(problem)
    if not answers:
        return {"error": "no law"}
    coupling = answers[0].coupling
    if not np.isfinite(led_errors(coupling)).all():
        return {"error": "diverges behind a motion that is imposed"}
    law = coupling.runtime.state_feedback
    assert law is not None
    groups = people_of(problem.hands, HANDS, 3), loose_grips(problem.hands, HANDS, 3)
    found: dict[str, Any] = {"linear": answers[0].performance.error, "zones": {}}
    for zone in zones:
        runtime = Runtime(state_feedback=zone.of(law, problem))
        one = Coupling.constant(problem, coupling.table.at_rest, "robust", runtime)
        rests = [int((residual_speeds(one, group, MOST_MOTIONS, friction=False) < 1).sum()) for group in groups]
        found["zones"][zone.label] = [max(led_errors(one)), *rests]
    return found


def recommended(name: str) -> dict[str, Any]:
    """Return what is recommended, what it costs, how a led handle feels it, and who rests with the exported C."""
    problem = problem_of(name)
    before = cpu_seconds()
    found = avc.recommend(problem)
    seconds = cpu_seconds() - before
    assert found.coupling is not None
    assert found.trial is not None
    law = found.coupling.runtime.state_feedback
    step_m = problem.device.encoder_resolution_m
    return {
        "cpu_s": round(seconds, 1),
        "linear": impedance_error(found.coupling),
        "led": led_errors(found.coupling),
        "steps": None if law is None else law.dead_zone_m / step_m,
        "pressed_share": found.trial.stiffness / problem.environment.stiffness_n_per_m,
        "rests": dict(at_rest(problem, found.coupling, found.trial.longest_s + LONGER_S)),
    }


def at_rest(problem: Problem, coupling: Coupling, longest_s: float) -> Iterator[tuple[str, int]]:
    """Yield how many of 200 hands rest in a plant of other code that runs the exported C."""
    bench = WholeDevice(problem.device, export_c(coupling))
    for group, hands in (("hands", problem.hands), ("looser", LOOSER)):
        drawn_hands = people(hands, TRIED - 8, 29)
        for word, friction in (("with friction", None), ("without", 0.0)):
            runs: dict[str, Any] = {"friction": friction, "longest_s": longest_s}
            yield f"{group} {word}", int(rests_as_tried(bench, problem.device, drawn_hands, **runs).sum())
            changed = {} if friction is None else {"friction": friction}
            ends = [bench.meets(held(hand, STRIKE_M_PER_S), longest_s, **changed) for hand in drawn_hands]
            rests = [max(end.motor_speed, end.handle_speed) < 5e-3 for end in ends]
            yield f"{group} struck {word}", sum(rests)


_PAGE = """\
# The dead zone that opens in motion

{made}

{named}

*Linear*: largest impedance error from 1 to 30 Hz without encoder steps. *Led*: that of a handle led in a sine at 1, 3
and 10 Hz, encoder and dead zone counted. *Pressed*: median stiffness of a press over the wall's. *At rest*: of 200
hands those that rest with the exported C in a plant of other code (`tests/oracle/whole_device.c`) after press, taps and
hold, and after a strike at 0.3 m/s, with the declared friction and without; who still moves is watched 12 s longer than
in a trial. *Looser* hands (20 to 100 g, 0.5 to
3 N.s/m, 20 to 200 N/m) are no part of `[hands]`. *Before* is commit aece7f02. *Heavy and coarse* is reference-r1 with
320 g, 61 um, 15 N and a wall of 12.7 kN/m.

What was compared, with the program's first law on {chosen} devices drawn at random (`drawn_devices.drawn`, seed
{chosen_seed}); of {hands} hands and {hands} loose grips, none with friction, after {motions} ({motion_names}).
*All rest*: devices on which all hands do and 97 % of the loose grips, as `recommend` asks:

{compared}

The same on {confirmed} others (seed {confirmed_seed}), on which nothing was chosen. {ladder}

{confirmed_table}
"""


def page(document: dict[str, Any]) -> None:
    """Write the page of the results."""
    cells = document["cells"]
    chosen, others = (
        [cell for name, cell in cells.items() if name.startswith(f"{seed} ") and "zones" in cell]
        for seed in (CHOSEN_SEED, CONFIRMED_SEED)
    )
    named = [
        _named_row(name, when, cells[f"{when} {name}"])
        for name in NAMED
        for when in ("before", "now")
        if "linear" in cells.get(f"{when} {name}", {})
    ]
    head = ("problem", "", "half width, steps", "linear, %", "led, %", "pressed, %")
    rests = ("at rest: hands", "struck", "looser", "struck", "processor, s")
    text = _PAGE.format(
        made=made_by(document["about"]),
        named=table((*head, *rests), named),
        chosen=len(chosen),
        chosen_seed=CHOSEN_SEED,
        hands=HANDS,
        motions=f"{len(MOST_MOTIONS)} motions",
        motion_names=", ".join(MOST_MOTIONS),
        compared=_compared_table(chosen, COMPARED),
        confirmed=len(others),
        confirmed_seed=CONFIRMED_SEED,
        ladder=_ladder(others),
        confirmed_table=_compared_table(others, CONFIRMED),
    )
    joined = (part if part.startswith("|") else part.replace("\n", " ") for part in text.strip().split("\n\n"))
    PAGE.write_text("\n\n".join(joined) + "\n", encoding="utf-8")


def _named_row(name: str, when: str, cell: dict[str, Any]) -> list[str]:
    rests = cell["rests"]
    counts = [f"{rests[f'{group} with friction']}, {rests[f'{group} without']}" for group in _GROUPS]
    steps = "-" if cell["steps"] is None else f"{cell['steps']:.3g}"
    led = ", ".join(f"{100 * error:.1f}" for error in cell["led"])
    linear, pressed = f"{100 * cell['linear']:.1f}", f"{100 * cell['pressed_share']:.0f}"
    return [name, when, steps, linear, led, pressed, *counts, f"{cell['cpu_s']:.0f}"]


_GROUPS = ("hands", "hands struck", "looser", "looser struck")


def _accepted(figures: list[float]) -> bool:
    return figures[1] == HANDS and figures[2] >= ENOUGH * HANDS


def _compared_table(cells: list[dict[str, Any]], zones: tuple[DeadZone, ...]) -> str:
    head = ("dead zone", "led over linear error: mean, %", "largest, %", "hands, %", "loose grips, %", "all rest")
    rows = []
    for zone in zones:
        figures = [(cell["zones"][zone.label], cell["linear"]) for cell in cells if zone.label in cell["zones"]]
        if not figures:
            continue
        added = [100 * max(0.0, found[0] - linear) for found, linear in figures]
        shares = [np.mean([found[place] for found, _ in figures]) / HANDS * 100 for place in (1, 2)]
        accepted = sum(_accepted(found) for found, _ in figures)
        told = (f"{np.mean(added):.2f}", f"{max(added):.1f}", *(f"{share:.1f}" for share in shares))
        rows.append([zone.label, *told, f"{accepted} of {len(figures)}"])
    return table(head, rows)


def _ladder(cells: list[dict[str, Any]]) -> str:
    """Say on how many devices one of the widths brings all to rest, beside that of before."""
    before, *widths = CONFIRMED
    count = sum(_accepted(cell["zones"][before.label]) for cell in cells)
    now = sum(any(_accepted(cell["zones"][zone.label]) for zone in widths) for cell in cells)
    return f"All rest with one of the widths on {now} of {len(cells)}, before on {count}."


def main() -> None:
    """Compute what is missing, and write results and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=24, help="devices drawn of each seed, default 24")
    parser.add_argument("--before", action="store_true", help="measure what another package recommends, and print it")
    parser.add_argument("names", nargs="*", help="problems of --before, default all")
    given = parser.parse_args()
    if given.before:
        for name in given.names or NAMED:
            sys.stdout.write(json.dumps({f"before {name}": recommended(name)}) + "\n")
            sys.stdout.flush()
        return
    made = about("python tests/benchmarks/dead_zone.py --count N", CHOSEN_SEED)
    kept = json.loads(OUT.read_text("utf-8"))
    cells: dict[str, Any] = {
        name: partial(dict, cell) for name, cell in kept["cells"].items() if name.startswith("before")
    }
    if kept["about"] != made:
        OUT.unlink()
    cells |= {f"now {name}": partial(recommended, name) for name in NAMED}
    cells |= {
        f"{CHOSEN_SEED} {index}": partial(compared, f"{CHOSEN_SEED} {index}", COMPARED) for index in range(given.count)
    }
    cells |= {
        f"{CONFIRMED_SEED} {index}": partial(compared, f"{CONFIRMED_SEED} {index}", CONFIRMED)
        for index in range(given.count)
    }
    computed(cells, OUT, made, page)


if __name__ == "__main__":
    main()
