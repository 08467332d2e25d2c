"""`recommend` on devices drawn at random: what it claims against fresh hands, and how stiff it is.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/random_devices.py --count 200

One thread for matrices, as `avc` sets it itself. Overwrites results/random_devices.json and RESULTS_random_devices.md
after every device and goes on where it stopped. The first devices of a larger count are those of a smaller one; about
ten seconds of processor time each. With --seed it draws others, prints their figures and overwrites nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "oracle"))

from drawn_devices import SEED, drawn
from hardware_bench import export_c  # found beside the tests
from studied import about, computed, cpu_seconds, expected_n_per_m, made_by, rendered_n_per_m, rounded, table
from whole_device import WholeDevice, people, rests_as_tried

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import stiffest_wall
from avc_casadi.recommendation.rank import impedance_error
from avc_casadi.simulation.population.operators import draw_hands, loose_grips
from avc_casadi.simulation.population.trial import CouplingTrial, exact_interval, try_coupling

# Of the hands that `recommend` tries, and of those it never saw.
OWN_SEED, FRESH_SEED = 0, 4711
PEOPLE, FRESH = 100, 200
# In the plant of other code; who still moves is watched for so long.
FOREIGN, LOOSE, LONGEST_S = 100, 50, 8.0
# As many processes as `avc recommend` has.
WORKERS = 2
OUT = Path(__file__).parent / "results" / "random_devices.json"
PAGE = Path(__file__).parent / "RESULTS_random_devices.md"

AS_STIFF = 0.01


def cell(index: int, seed: int = SEED) -> dict[str, Any]:
    problem = drawn(index, seed)
    wall, cpu = time.perf_counter(), cpu_seconds()
    found = avc.recommend(problem, hands=PEOPLE, seed=OWN_SEED, workers=WORKERS)
    wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
    plain = stiffest_wall(PlantFamily.of(problem))
    outcome: dict[str, Any] = {
        "device": problem.device.model_dump(exclude_unset=True),
        "wall_n_per_m": problem.environment.stiffness_n_per_m,
        "plain_n_per_m": plain.stiffness_n_per_m,
        "wall_s": round(wall, 1),
        "cpu_s": round(cpu, 1),
        "load": round(os.getloadavg()[0], 1),
        "reason": found.reason,
        "method": None,
    }
    if found.coupling is None or found.trial is None:
        return outcome
    fresh = try_coupling(found.coupling, draw_hands(problem.hands, FRESH, FRESH_SEED), FRESH_SEED)
    return outcome | {
        "method": found.coupling.method,
        "recommended_n_per_m": expected_n_per_m(found.coupling),
        "felt_n_per_m": rendered_n_per_m(found.trial),
        "claimed": _counts(found.trial),
        "fresh": _counts(fresh),
        "impedance_error": float(impedance_error(found.coupling)),
        "disk_margin": float(OpenLoop.of(found.coupling).least().disk),
        "plant": on_the_plant(found.coupling),
    }


def on_the_plant(coupling: Coupling) -> dict[str, int]:
    """Count who comes to rest with the exported C in a plant of other code (`tests/oracle/whole_device.c`).

    A hundred hands, corners first, and fifty loose grips: in the three motions of a trial, with the declared friction
    and without.
    """
    device, hands = coupling.problem.device, coupling.problem.hands
    bench = WholeDevice(device, export_c(coupling))
    drawn = people(hands, FOREIGN - 8, OWN_SEED)
    loose = [tuple(row) for row in np.array([*vars(loose_grips(hands, LOOSE, FRESH_SEED)).values()]).T]
    return {
        "at_rest": int(rests_as_tried(bench, device, drawn, longest_s=LONGEST_S).sum()),
        "without_friction": int(rests_as_tried(bench, device, drawn, friction=0.0, longest_s=LONGEST_S).sum()),
        "loose": int(rests_as_tried(bench, device, loose, longest_s=LONGEST_S).sum()),
        "loose_without_friction": int(rests_as_tried(bench, device, loose, friction=0.0, longest_s=LONGEST_S).sum()),
    }


def _counts(trial: CouplingTrial) -> dict[str, int]:
    return {
        "people": trial.hands,
        "at_rest": int(trial.stable.sum()),
        "without_friction": int(trial.stable_without_friction.sum()),
        "quiet": int(trial.quiet.sum()),
    }


def below(found: dict[str, Any], key: str) -> tuple[bool, bool]:
    """Whether fresh hands refute a claim."""
    claim, fresh = found["claimed"], found["fresh"]
    high = exact_interval(fresh[key], fresh["people"])[1]
    low = exact_interval(claim[key], claim["people"])[0]
    return high < claim[key] / claim["people"], fresh[key] / fresh["people"] < low


TEXT = """# `recommend` on devices drawn at random

{made_by}

{count} devices with a wall each: T 0.25 to 2 ms, 0.05 to 0.5 kg, 0.1 to 5 N.s/m, encoder 1 to 60 um, amplifier 0.3 to
3 kHz, walls 0.5 to 50 kN/m (logarithms uniform); delay 0 to 3 samples, whole for one half; friction none for 30 %,
else up to 1 N; no resonance for 40 %, else 60 to 300 Hz with a damping ratio of 0.02 to 0.1 and a mass ratio of 0.2 to
0.6. No force limit, no ranges. `recommend` tries 100 hands of its own, corners among them; what it recommends is then
tried by 200 fresh ones of the default set. **Refuted**: the upper end of the exact 95 % interval of the fresh share
lies below the claimed share (of a claim of 100 of 100, a single fresh hand refutes it); **beyond the claim's
interval**: the fresh share lies below the lower end of the exact interval of the claim itself (96.4 % for 100 of 100).

## Claims against fresh hands

{claims}

## Accuracy, and the exported C in a plant of other code

{accuracy}

## Next to the limit of spring and damper

{plain}

## Time of `recommend`

{seconds}

{standing}Each device and its numbers: `results/random_devices.json`.
"""


def write_page(document: dict[str, Any]) -> None:
    every = document["cells"]
    crashed = {name: one for name, one in every.items() if "error" in one}
    cells = {name: one for name, one in every.items() if "error" not in one}
    found = {name: one for name, one in cells.items() if one["method"] is not None}
    rows = []
    for key, told in (("at_rest", "with friction"), ("without_friction", "without"), ("quiet", "quiet")):
        refuted = [below(one, key) for one in found.values()]
        whole = [one for one in found.values() if one["claimed"][key] == PEOPLE]
        rows.append(
            [
                told,
                len(found),
                len(whole),
                sum(one["fresh"][key] == FRESH for one in whole),
                sum(first for first, _ in refuted),
                sum(second for _, second in refuted),
                f"{sum(one['fresh'][key] for one in whole)} of {FRESH * len(whole)}",
            ]
        )
    claims = table(
        (
            "at rest",
            "devices",
            "claimed for all 100",
            "of these, all 200 fresh",
            "refuted",
            "beyond the claim's interval",
            "fresh hands at rest where all was claimed",
        ),
        rows,
    )
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            count=len(every),
            claims=claims,
            accuracy=_accuracy(found),
            plain=_plain_text(cells, found),
            seconds=_seconds(cells),
            standing=_standing(found, crashed),
        ),
        encoding="utf-8",
    )


def _plain_text(cells: dict[str, Any], found: dict[str, Any]) -> str:
    gain = [_gain(one) for one in found.values()]
    reached = sum(one["recommended_n_per_m"] >= (1 - AS_STIFF) * one["wall_n_per_m"] for one in found.values())
    methods: dict[str, int] = {}
    for one in cells.values():
        methods[str(one["method"])] = methods.get(str(one["method"]), 0) + 1
    said = ", ".join(f"{name} {count}" for name, count in sorted(methods.items(), key=lambda pair: -pair[1]))
    return (
        f"Recommended: {said}. The wall itself is reached on {reached} of {len(cells)}; the recommended wall is "
        f"{min(gain, default=np.nan):.2g} to {max(gain, default=np.nan):.2g} times what spring and damper can hold at "
        f"most, or the wall where that is less (median {np.median(gain) if gain else np.nan:.3g})."
    )


def _accuracy(found: dict[str, Any]) -> str:
    """Return errors, disk margins and who rests in the plant of other code."""
    if not found:
        return ""
    errors = 100 * np.array([cell["impedance_error"] for cell in found.values()])
    disks = np.array([cell["disk_margin"] for cell in found.values()])
    settled = {key: sum(cell["plant"][key] for cell in found.values()) for key in next(iter(found.values()))["plant"]}
    hands, loose = FOREIGN * len(found), LOOSE * len(found)
    return (
        f"Largest impedance error from 1 to 30 Hz, of the linear loop: median {np.median(errors):.3g} %, nine in ten "
        f"below {np.quantile(errors, 0.9):.3g} %. Least disk margin {disks.min():.3f}, median {np.median(disks):.3f}."
        "\n\n"
        f"At rest after the three motions of a trial, of {hands} hands: {settled['at_rest']} with the declared "
        f"friction, {settled['without_friction']} without. Of {loose} loose grips: {settled['loose']} with friction, "
        f"{settled['loose_without_friction']} without."
    )


def _gain(one: dict[str, Any]) -> float:
    """Recommended wall as a share of what spring and damper can hold at most, or of the wall where that is less."""
    return float(one["recommended_n_per_m"] / min(one["plain_n_per_m"], one["wall_n_per_m"]))


def _seconds(cells: dict[str, Any]) -> str:
    if not cells:
        return ""
    rows = []
    for key, told in (("cpu_s", "processor time, compilers and helper included"), ("wall_s", "wall time")):
        values = [one[key] for one in cells.values()]
        rows.append([told, f"{np.median(values):.1f}", f"{max(values):.1f}"])
    load = [one["load"] for one in cells.values()]
    shared = f"The machine was shared: load {min(load):g} to {max(load):g} on its cores, one process at low priority."
    return f"{table(('', 'median, s', 'worst, s'), rows)}\n\n{shared}"


def _standing(found: dict[str, Any], crashed: dict[str, Any]) -> str:
    lines = [f"- {name}: {one['error']}" for name, one in crashed.items()]
    for name, one in found.items():
        own = f"- {name}, {one['method']} {rounded(one['recommended_n_per_m'])} N/m, {_rest(one['claimed'])}"
        if one["claimed"]["at_rest"] < PEOPLE:
            lines.append(f"{own}: not everybody settles with what is recommended")
        if any(any(below(one, key)) for key in ("at_rest", "without_friction", "quiet")):
            lines.append(f"{own}: of {FRESH} fresh hands {_rest(one['fresh'])}")
    head = "## Devices that stand out\n\nAt rest / without friction / quiet, of the hands of `recommend` or fresh."
    return f"{head}\n\n{chr(10).join(lines)}\n\n" if lines else ""


def _rest(counts: dict[str, int]) -> str:
    return f"{counts['at_rest']} / {counts['without_friction']} / {counts['quiet']}"


def figures(count: int, seed: int) -> dict[str, Any]:
    """Return what devices of another seed say: refuted claims, and how stiff what is recommended is.

    Stiffness is told as the page does; the mean is geometric. A device without a recommendation, or whose cell failed,
    counts as one of 0 N/m, in the mean of 1 %.
    """
    cells = []
    for index in range(count):
        try:
            cells.append(cell(index, seed))
        except Exception as error:  # noqa: BLE001 - it is a result, as in the study
            cells.append({"error": f"device {index}: {type(error).__name__}: {error}", "method": None})
        print(f"{index + 1} of {count}", file=sys.stderr, flush=True)
    claims = [one for one in cells if one["method"] is not None]
    shares = [_gain(one) if one["method"] is not None else 0.0 for one in cells]
    return {
        "devices": count,
        "seed": seed,
        "recommended": len(claims),
        "refuted_with_friction": sum(any(below(one, "at_rest")) for one in claims),
        "refuted_without_friction": sum(any(below(one, "without_friction")) for one in claims),
        "median_to_plain_limit": float(np.median(shares)),
        "mean_to_plain_limit": float(np.exp(np.mean(np.log(np.maximum(shares, 0.01))))),
        "errors": [one["error"] for one in cells if "error" in one],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="devices; default 200")
    parser.add_argument("--seed", type=int, help=f"draws other devices than those of the study, {SEED}")
    asked = parser.parse_args()
    if asked.seed is not None:
        print(json.dumps(figures(asked.count, asked.seed)))
        return
    cells = {f"device {index}": partial(cell, index) for index in range(asked.count)}
    made = about("OPENBLAS_NUM_THREADS=1 python tests/benchmarks/random_devices.py --count N", SEED)
    computed(cells, OUT, made, write_page)


if __name__ == "__main__":
    main()
