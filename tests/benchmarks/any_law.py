"""Laws of every piece, drawn at random: exported C beside the simulation, hands in a plant of other code, compensation.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/any_law.py --write

40 laws are exported and called at 20 000 positions; 20 of them, half with gains that are too high, are tried by hands
in the simulator of the tests; 30 friction compensations are judged beside a device in small steps. About five minutes
of processor time. With --write it overwrites results/any_law.json and RESULTS_any_law.md.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "oracle"))

from exported import C99, Exported  # found beside the tests
from exported_bench import ran
from exported_law import MORE_WARNINGS, positions, rounding_n, sanitized, simulated
from hardware_bench import export_c
from plain_device import moved, pressed
from script_arguments import script_arguments
from stated_law import VELOCITIES, drawn_law, drawn_velocity
from studied import about, made_by, table, write_rows
from whole_device import WholeDevice, held

import avc_casadi as avc
from avc_casadi.files.problem_file import load_any
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Press
from avc_casadi.simulation.population.law_trial import law_setup, try_law
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.setup import judge

SEED = 8800
EXPORTED, TRIED, COMPENSATED = 40, 20, 30
SAMPLES, ARM_SAMPLES = 20_000, 300
_LASTING = 0.9
"""A motion that keeps at least this share of its size from one second to the next swings."""
HANDS = 24
SPEEDS_M_PER_S = (0.07, 0.3)
SECONDS, REST_M_PER_S = 4.25, 5e-3
OUT = Path(__file__).parent / "results" / "any_law.json"
PAGE = Path(__file__).parent / "RESULTS_any_law.md"


def of_export(index: int) -> dict[str, Any]:
    """Compare the C of a law with the simulation, and its bits under sanitizers and on ARM."""
    problem = load_any(drawn_law(SEED + index))
    way = positions(problem, SEED + index, SAMPLES)
    forces, expected = Exported(problem, compiler=C99, flags=MORE_WARNINGS).forces(way), simulated(problem, way)
    few = forces[:ARM_SAMPLES].tobytes()
    arm = all(
        ran(board, problem, way[None, :ARM_SAMPLES]).forces.tobytes() == few for board in ("Cortex-M0", "Cortex-M4F")
    )
    return {
        "kind": "export",
        "index": index,
        "pieces": pieces_of(problem),
        "error_n": float(np.abs(forces - expected).max()),
        "digits": float(np.abs(forces - expected).max() / rounding_n(problem, way)),
        "largest_n": float(np.abs(expected).max()),
        "sanitized": forces.tobytes() == sanitized(problem, way).tobytes(),
        "arm": arm,
    }


def pieces_of(problem: Problem) -> list[str]:
    """Return the keys of a law that are not the usual ones."""
    law = problem.law
    assert law is not None
    usual = {key: field.default for key, field in type(law).model_fields.items()}
    named = [key for key in usual if getattr(law, key) != usual[key] and key not in ("velocity", "filters")]
    return [*named, f"velocity {law.velocity.kind}", *(f"filter {item.kind}" for item in law.filters)]


def of_hands(index: int) -> dict[str, Any]:
    """Compare a law in scenes with its C in a plant of other code, hand by hand."""
    draw, tables = np.random.default_rng([SEED, index]), drawn_law(SEED + index)
    if index % 2:  # too high, by a factor that leaves few of them at rest
        factor = 10 ** draw.uniform(1.0, 2.0)
        for key in ("stiffness_n_per_m", "damping_ns_per_m"):
            tables["law"][key] *= factor
    problem = load_any(tables)
    people = people_of(problem.hands, HANDS, index)
    plant = WholeDevice(problem.device, export_c(problem))
    agree, rests, foreign_rests = 0, True, True
    for speed in SPEEDS_M_PER_S:
        own = judge(law_setup(problem), people, Press(speed_m_per_s=speed), SECONDS).stable
        for row in range(HANDS):
            hand = people.values(row)
            found = plant.meets(
                held((hand["mass_kg"], hand["damping_ns_per_m"], hand["stiffness_n_per_m"]), speed), SECONDS
            )
            foreign = max(found.motor_speed, found.handle_speed) < REST_M_PER_S
            agree += foreign == own[row]
            rests, foreign_rests = rests and bool(own[row]), foreign_rests and foreign
    return {
        "kind": "hands",
        "index": index,
        "pieces": pieces_of(problem),
        "runs": len(SPEEDS_M_PER_S) * HANDS,
        "agree": int(agree),
        "rests": rests,
        "rests_in_other_code": foreign_rests,
    }


def compensated(index: int) -> Problem:
    """Draw a device with friction, and a law that compensates some or too much of it."""
    draw = np.random.default_rng([SEED, 77, index])
    period, mass = 1e-3, 10 ** draw.uniform(-1.3, -0.3)
    friction = float(10 ** draw.uniform(-1.5, -0.5))
    law: dict[str, Any] = {
        "stiffness_n_per_m": float(mass * draw.uniform(20, 60) ** 2),
        "damping_ns_per_m": float(0.01 * mass / period * draw.uniform(0.5, 2.0)),
        "velocity": drawn_velocity(VELOCITIES[index % len(VELOCITIES)], draw, period),
        "friction_compensation": {
            "force_n": friction * float(10 ** draw.uniform(-0.6, 0.6)),
            "velocity_m_per_s": float(10 ** draw.uniform(-2.3, -1.0)),
        },
    }
    device = {
        "mass_kg": mass,
        "damping_ns_per_m": 0.3,
        "sample_time_s": period,
        "delay_samples": float(draw.choice([0, 1, 1.4, 2])),
        "encoder_resolution_m": float(draw.choice([1e-6, 5e-6, 2e-5])),
        "coulomb_friction_n": friction,
        "max_force_n": 8.0,
    }
    return load_any({"device": device, "law": law})


def of_compensation(index: int) -> dict[str, Any]:
    """Compare the verdict of a trial with a device in small steps: released, and in the corners of the hands."""
    problem = compensated(index)
    device, law = problem.device, problem.law
    assert law is not None
    assert law.friction_compensation is not None
    trial = try_law(problem, HANDS)
    target = pressed(SECONDS, device.sample_time_s)
    corners = [people_of(problem.hands, 8).values(row) for row in range(8)]
    sizes = []
    for friction in (device.coulomb_friction_n, 0.5 * device.coulomb_friction_n):
        runs = [moved(problem, target, friction_n=friction, speed=0.1)]
        runs += [moved(problem, target, tuple(hand.values()), friction_n=friction) for hand in corners]
        sizes.append(max(float(np.ptp(run[-1000:])) for run in runs))
    least = max(1e-5, 2 * device.encoder_resolution_m)
    free = moved(problem, target, friction_n=0.0, speed=0.1)
    last = float(np.ptp(free[-1000:]))
    # A law of little damping may still move, more slowly from second to second: that is no swing.
    swings_free = last > least and last > _LASTING * float(np.ptp(free[-2000:-1000]))
    return {
        "kind": "compensation",
        "index": index,
        "share": law.friction_compensation.force_n / device.coulomb_friction_n,
        "velocity": law.velocity.kind,
        "sizes_m": sizes,
        "truth": "rests" if max(sizes) <= least else "swings",
        "trial": "rests" if trial.rests else "swings",
        "swings_without_friction": swings_free,
        "linear": linear_claim(problem),
    }


def linear_claim(problem: Problem) -> str:
    """Return what `avc certify` says of a law: stable, unstable, or not judged."""
    try:
        return "stable" if avc.certify_law(problem, remedies=False).stable else "unstable"
    except avc.UnsupportedError:
        return "not judged"


def page(rows: list[dict[str, Any]], made: str) -> str:
    """Return the page of the results."""
    by = {kind: [row for row in rows if row["kind"] == kind] for kind in ("export", "hands", "compensation")}
    exported, hands, cases = by["export"], by["hands"], by["compensation"]
    runs = sum(row["runs"] for row in hands)
    swinging = [row for row in cases if row["swings_without_friction"]]
    stable, unjudged = (sum(row["linear"] == claim for row in swinging) for claim in ("stable", "not judged"))
    right = sum(row["truth"] == row["trial"] for row in cases)
    lines = [
        (
            "laws whose C has the simulation's forces to 20 last digits of single precision",
            f"{sum(row['digits'] < 20 for row in exported)} of {len(exported)}",
        ),
        ("largest difference, in last digits", f"{max(row['digits'] for row in exported):.1f}"),
        (
            "no warning, and the same bits under address, undefined and integer sanitizers",
            f"{sum(row['sanitized'] for row in exported)} of {len(exported)}",
        ),
        ("the same bits on Cortex-M0 and M4F", f"{sum(row['arm'] for row in exported)} of {len(exported)}"),
        (
            "laws with the same verdict in the plant of other code",
            f"{sum(row['rests'] == row['rests_in_other_code'] for row in hands)} of {len(hands)}",
        ),
        ("of these, laws at which some hand does not rest", f"{sum(not row['rests'] for row in hands)}"),
        ("presses with the same verdict", f"{sum(row['agree'] for row in hands)} of {runs}"),
        ("friction compensations that the trial judges right", f"{right} of {len(cases)}"),
        ("of these, swinging ones", f"{sum(row['truth'] == 'swings' for row in cases)}"),
        (
            "swinging without friction, and called stable by the linear claim",
            f"{stable} of {len(swinging)}, of which {unjudged} are not judged",
        ),
    ]
    pieces = sorted({piece for row in exported for piece in row["pieces"]})
    counted = [(piece, f"{sum(piece in row['pieces'] for row in exported)}") for piece in pieces]
    return f"""# Laws of every piece

{made}

Laws of `[law]` are drawn with every velocity and filter, dead zone, limited integral, friction compensation, virtual
mass, local damper and slower rate, half of them in a wall. The exported C is called at {SAMPLES} positions of a handle
that wanders through 0, and compared with the law written out sample by sample in double precision. A last digit is
that of the position times the steepest gain of the law.

{HANDS} hands each press {TRIED} of the laws at two speeds, in scenes and, with the exported C, in
`tests/oracle/whole_device.c`. Every second law has gains that are 10 to 100 times too high.

A friction compensation is a quarter to four times the friction. The trial is right where it says what a device in steps
of 50 us does: released, and in the eight corners of the hands, at the declared friction and at half of it.

{table(("question", "answer"), lines)}

## Pieces of the exported laws

{table(("piece", "laws"), counted)}

Each law and its numbers: `results/any_law.json`.
"""


def main() -> None:
    arguments = script_arguments(__doc__, results=PAGE)
    rows: list[dict[str, Any]] = []
    for work, count in ((of_export, EXPORTED), (of_hands, TRIED), (of_compensation, COMPENSATED)):
        for index in range(count):
            rows.append(work(index))
            print({key: value for key, value in rows[-1].items() if key != "pieces"}, flush=True)
    origin = about("OPENBLAS_NUM_THREADS=1 python tests/benchmarks/any_law.py --write", SEED)
    text = page(rows, made_by(origin))
    print(text)
    if arguments.write is not None:
        write_rows(OUT, origin, rows)
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
