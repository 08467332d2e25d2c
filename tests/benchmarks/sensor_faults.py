"""The exported C of a hundred couplings behind sensors that fail: force outside of the wall, and energy given.

python tests/benchmarks/sensor_faults.py [OUT]

Devices and walls drawn at random; laws of six kinds, each softened until it is deployable; a released device without
dry friction by `tests/faulty_sensor.c`, at rest outside or thrown at the wall. Overwrites OUT (default
tests/benchmarks/results/sensor_faults.json) and RESULTS_sensor_faults.md beside this file after every coupling; what
OUT holds already is not computed again. A million glitches in three minutes on one core.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from faulty_sensor import KINDS, SHARE, FaultySensor

import avc_casadi as avc
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling, schedule_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime
from avc_hardware import export_c
from avc_hardware.codegen.sensor_rule import SensorBounds

HERE = Path(__file__).parent
RESULTS, PAGE = HERE / "results" / "sensor_faults.json", HERE / "RESULTS_sensor_faults.md"
SEED = 2611
LAWS = ("spring", "contact damper", "observer between steps", "state feedback", "table", "guard")
COUPLINGS = 102
GLITCHES, RUNS, SECONDS = 10_500, 60, 0.5
# An error that a hand might have made, as no rule can tell: no claim is made of it.
SMALL = "small error"
ROWS = (*KINDS, SMALL)


def drawn(index: int) -> Problem:
    """Draw a device and a wall."""
    random = np.random.default_rng([SEED, index])

    def log(low: float, high: float) -> float:
        return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.3g}")

    device = {
        "sample_time_s": log(0.25e-3, 2e-3),
        "mass_kg": log(0.05, 0.5),
        "damping_ns_per_m": log(0.1, 5.0),
        "encoder_resolution_m": log(1e-6, 60e-6),
        "delay_samples": int(random.integers(0, 3)),
        "max_force_n": log(3.0, 30.0),
    }
    return Problem(
        device=device,
        environment={"damping_ns_per_m": 0.0, "stiffness_n_per_m": log(500.0, 2e4)},
        coupling=avc.load_problem("reference-r1").coupling,
        stability={"model": "sampled-data", "scope": "hands"},
        frequency={"stop_hz": min(450.0, 0.45 / device["sample_time_s"])},
    )


def softer(problem: Problem) -> Iterator[tuple[Problem, float]]:
    """Yield walls and stiffnesses, softer and softer."""
    for halvings in np.arange(0.0, 10.0, 0.5):
        wall = float(f"{problem.environment.stiffness_n_per_m / 2**halvings:.3g}")
        yield problem.changed(environment={"stiffness_n_per_m": wall}), wall


def candidate(law: str, problem: Problem, wall: float, random: np.random.Generator) -> Coupling:
    """Return a coupling of a kind to a wall; its damper is drawn within what a sample allows."""
    device = problem.device
    contact = float(random.uniform(0.05, 0.5)) * device.mass_kg / device.sample_time_s
    rigid = Gains(0.0, 1e8, contact)
    if law == "spring":
        return Coupling.constant(problem, Gains(0.0, 2 * wall), law)
    if law == "contact damper":
        return Coupling.constant(problem, rigid, law)
    if law == "observer between steps":
        lightest = device.mass_kg + problem.hands.mass_kg[0]
        return Coupling.constant(problem, rigid, law, Runtime(observer_mass_kg=lightest))
    if law == "guard":
        return Coupling.constant(problem, rigid, law, Runtime(guard="passivity-controller"))
    if law == "state feedback":
        space = Space(device, problem.hands)
        feedback = space.law(space.starts[0], wall)
        return Coupling.constant(problem, Gains(0.0, 1e8), law, Runtime(state_feedback=feedback))
    hz = np.geomspace(1.0, 0.4 / device.sample_time_s, 6)
    k, b_p = wall * random.uniform(1.0, 4.0, 6), contact * random.uniform(0.5, 1.0, 6)
    rows = GainTable(np.stack([hz, np.zeros(6), k, b_p], axis=1))
    runtime = Runtime("zero-crossing")
    return Coupling(problem, schedule_of(problem, rows, law), rows, runtime)


def made(index: int) -> Coupling:
    """Return the stiffest of a kind that is deployable.

    Raises:
        RuntimeError: none is.
    """
    law, problem = LAWS[index % len(LAWS)], drawn(index)
    for softened, wall in softer(problem):
        try:
            coupling = candidate(law, softened, wall, np.random.default_rng([SEED, index, 1]))
        except np.linalg.LinAlgError:
            continue
        if deployable(coupling).passed:
            return coupling
    raise RuntimeError(f"no wall of {law} is deployable")


def cell(index: int) -> dict[str, Any]:
    coupling = made(index)
    device, wall = coupling.problem.device, coupling.wall.stiffness_n_per_m
    bench, bounds = FaultySensor(device, export_c(coupling)), SensorBounds.of(device)
    least = bounds.outside_m
    found: dict[str, Any] = {}
    for kind in ROWS:
        many = kind in {"glitch", "no number", "elsewhere"}
        runs = round(GLITCHES / 2 / (SHARE * SECONDS / device.sample_time_s)) if many and kind == "glitch" else RUNS
        sizes = (1e-6, least) if kind == SMALL else (1.01 * least, 1e6)
        name = "glitch" if kind == SMALL else kind
        options: dict[str, Any] = {"sizes_m": sizes, "seconds": SECONDS}
        rest = bench.meets(name, runs, SEED + index, thrown=False, **options)
        law, spring = (
            bench.meets(name, runs, SEED + index, thrown=True, spring_n_per_m=k, **options) for k in (0.0, wall)
        )
        found[kind] = {
            "faults": int(rest.faults.sum() + law.faults.sum()),
            "runs": 2 * runs,
            "outside_n": float(rest.outside_n.max()),
            "given_at_rest_j": float(rest.given_j.max()),
            "given_j": float(law.given_j.max()),
            "spring_j": float(spring.given_j.max()),
            "more_than_spring": int((law.given_j > spring.given_j).sum()),
        }
    return {"law": coupling.method, "wall_n_per_m": wall, "kinds": found}


TEXT = """# No force outside, whatever the sensor says

{made_by}

{couplings} couplings ({laws}) to devices drawn at random (0.25 to 2 ms, 0.05 to 0.5 kg, encoders of 1 to 60 um, 0 to
2 samples of delay, limits of 3 to 30 N), each the stiffest of its kind that is deployable. `export_c` of each runs a
released device without dry friction, `tests/faulty_sensor.c`, which shares no code with the project. In half of the
runs the device rests 0.1 to 20 mm outside, in the others it is thrown at the wall at 0.02 to 0.5 m/s. Faults come in
2 % of the samples: *glitch* and *elsewhere* (1 to 20 samples) are off by up to 1e6 m and by no less than what no hand
does in a sample (the header of each coupling tells it); *no number* is NaN, infinite or 3e38; *stuck* repeats a
position for 1 to 20 samples; *dropped* calls no step, and the force is held; *clipped* is a depth of 0 outside, all
the time; *jitter* are samples of 0.75 to 1.25 of the sample time, all the time. *Sound* is without a fault.

Energy given to the device is that of the force along its way, the most at any moment: a passive wall has none to
give. Beside it stands a plain spring as stiff as the wall, within the same force limit, that takes the same positions
as they come: what a passive law gives that believes its sensor.

{table}

{faults} faults in {runs} runs, {glitches} of them glitches of one sample. Outside, {outside}. Of {cases} cases of a
coupling and a kind of fault (but small errors) the coupling gave more than the spring at most did in {above}.

What remains. *Stuck* while a force is held looks like a hand that holds still, and a *small error* (1 um to
what a hand might do) from a hand: both are taken for true, by the coupling and by the spring, and give what a wall
gives whose face is there. A device that is thrown gets energy from a sound sensor too, by sampling, delay and
encoder: the row *sound* tells how much.
"""
_HEAD = (
    "fault",
    "faults",
    "force outside, N, at most",
    "couplings with any",
    "energy given at rest, mJ, at most",
    "energy given when thrown, mJ, at most",
    "median of couplings",
    "a plain spring, mJ, at most",
    "median",
    "couplings above the spring",
)


def write_page(document: dict[str, Any]) -> None:
    cells = [one for one in document["cells"].values() if "kinds" in one]
    rows, every, above = [], [], 0
    for kind in ROWS:
        found = [one["kinds"][kind] for one in cells]
        every += found
        more = sum(one["given_j"] > one["spring_j"] for one in found)
        above += more * (kind != SMALL)
        law, spring = (1e3 * np.array([one[key] for one in found]) for key in ("given_j", "spring_j"))
        outside = np.array([one["outside_n"] for one in found])
        rows.append(
            (
                kind,
                sum(one["faults"] for one in found),
                f"{outside.max():.3g}",
                int((outside > 0).sum()),
                f"{1e3 * max(one['given_at_rest_j'] for one in found):.3g}",
                *(f"{value:.3g}" for value in (law.max(), np.median(law), spring.max(), np.median(spring))),
                more,
            )
        )
    outside = max(one["kinds"][kind]["outside_n"] for one in cells for kind in KINDS)
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            couplings=len(cells),
            laws=", ".join(f"{sum(one['law'] == law for one in cells)} {law}" for law in LAWS),
            table=table(_HEAD, rows),
            faults=sum(one["faults"] for one in every),
            runs=sum(one["runs"] for one in every),
            glitches=sum(one["kinds"]["glitch"]["faults"] for one in cells),
            outside="the force was 0 N at every sample" if outside == 0 else f"the force was {outside:.3g} N at most",
            cases=len(cells) * len(KINDS),
            above=above,
        ),
        encoding="utf-8",
    )


def main() -> None:
    arguments = script_arguments(__doc__, out=RESULTS)
    told = about("python tests/benchmarks/sensor_faults.py", SEED)
    cells = {f"{index} {LAWS[index % len(LAWS)]}": partial(cell, index) for index in range(COUPLINGS)}
    computed(cells, arguments.out, told, write_page)


if __name__ == "__main__":
    main()
