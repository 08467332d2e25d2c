"""Passivity controllers that others run in the control computer, beside a wall, constant couplings and ours.

python tests/benchmarks/passivity_baselines.py [OUT]

Laws as published (`baseline_laws.py`) and exported C of couplings on a device in plain numpy (`baseline_plant.py`):
hands that press, tap and strike, a shaken handle, a released device. Overwrites OUT (default
tests/benchmarks/results/passivity_baselines.json) and the table of RESULTS_passivity_baselines.md after every cell.
What OUT has already is not computed again. About four minutes on one core.
"""

from __future__ import annotations

import itertools
import math
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parents[1] / "oracle"))

from baseline_laws import BASELINES, Exported, ForceAugmentation, Loop, PassivityController, Wall
from baseline_plant import TAIL_S, Deeds, Floats, Law, frequency_sweep, simulated

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import damping_range, softest_wall_n_per_m, stiffest_wall
from avc_casadi.model.device import Device, DeviceRange
from avc_casadi.model.gains import Gains
from avc_hardware import export_c

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "passivity_baselines.json"
PAGE = HERE / "RESULTS_passivity_baselines.md"
HEAD = ("law", "at rest, N/m", "1 Hz, N/m", "10 Hz, N/m", "impedance error, 1 / 10 Hz, %")
HEAD += ("settled, friction / none", "held, N/m", "ripple, N", "outside, N", "given, %")
SEED, HANDS, RELEASED, PHASES = 1402, 50, 24, 8
SECONDS, REST_M_PER_S, PRESS_N, LIMIT_SHARE = 3.0, 5e-3, 10.0, 0.97
# When the last tap ends, and how fast a hand may then be.
TAPPED_S, SWING_M_PER_S = 1.4, 0.5
# Of the plain limit, so that spring and damper have a reserve.
PLAIN_SHARE = 0.9
# Of the wall asked for, where a law does not hold it.
HALVINGS = 8
# Largest damper of a passivity controller, shares of the largest that is stable by itself with every hand and released.
DAMPERS = (0.1, 0.25, 0.5)
# Rates of force augmentation; an implementation from the surroundings of its authors has 0.01.
RATES_M_PER_S = (3e-4, 1e-3, 3e-3, 1e-2)
# Wall asked for on a device of the catalogue, N/m: beyond what a plain spring and damper hold there.
WALLS = {"phantom-omni": 2e3, "phantom-premium-1.5": 2e3, "dvrk-mtm-joint1": 3e4}
PROBLEMS = ("figure5", "reference-r1", "reference-r2", "reference-r3", *WALLS)
OURS = ("static coupling", "spring and damper", "recommended")
HZ = (1.0, 10.0)


@cache
def problem_of(name: str) -> avc.Problem:
    """The problem of a device at its nominal values: what the laws of others are not made for stays out."""
    if name not in WALLS:
        return avc.load_problem(name)
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": WALLS[name]}
    problem = avc.load_problem("reference-r1").changed(device=avc.load_device(name).device, environment=wall)
    return problem.changed(device=problem.device.model_copy(update={"range": DeviceRange()}))


def coupling_of(law: str, problem: avc.Problem) -> Coupling:
    """One of our constant couplings, or what is recommended."""
    if law == "recommended":
        found = avc.recommend(problem).coupling
        assert isinstance(found, Coupling)
        return found
    if law == "static coupling":
        gains = avc.solve(problem, method="static")
        return Coupling.constant(
            problem, Gains(float(gains.damping_ns_per_m[0]), float(gains.stiffness_n_per_m[0])), law
        )
    wall, family = problem.environment.stiffness_n_per_m, PlantFamily.of(problem)
    held = min(PLAIN_SHARE * stiffest_wall(family).stiffness_n_per_m, wall)
    dampers = damping_range(family, held)
    middle = (dampers.lowest_ns_per_m + dampers.highest_ns_per_m) / 2
    return Coupling.constant(problem, Gains(0.0, 1e8 if held == wall else held * wall / (wall - held), middle), law)


def hands_of(problem: avc.Problem) -> Floats:
    """Mass, damping and stiffness of each hand: corners of the box and some of its inside, shape (hands, 3)."""
    box = np.array([problem.hands.mass_kg, problem.hands.damping_ns_per_m, problem.hands.stiffness_n_per_m])
    inside = np.random.default_rng(SEED).uniform(box[:, 0], box[:, 1], (HANDS - 8, 3))
    return np.concatenate([list(itertools.product(*box)), inside])


def deeds_of(hands: Floats, device: Device) -> Deeds:
    """Each hand presses, strikes and taps, with the declared friction and without; then released devices fly in."""
    motions, frictions = ((0.07, False), (0.3, False), (0.07, True)), (device.coulomb_friction_n, 0.0)
    each = [(*hand, *motion, dry, 0.0) for dry in frictions for motion in motions for hand in hands]
    each += [(0.0, 0.0, 0.0, 1.0, False, 0.0, speed) for speed in np.geomspace(0.02, 0.3, RELEASED)]
    mass, damping, stiffness, speed, taps, friction, velocity = np.array(each).T
    return Deeds(mass, damping, stiffness, speed, taps > 0, friction, velocity)


def measured(loop: Loop, made: Callable[[int], Law], hands: Floats) -> dict[str, Any]:
    """Run a law and tell what is found."""
    device, count = loop.device, len(hands)
    deeds = deeds_of(hands, device)
    lanes = len(deeds.mass_kg)
    found = simulated(device, made(lanes), deeds, phases(lanes), seconds_for(device, hands))
    rests = np.asarray(found.speed_m_per_s < REST_M_PER_S)
    settled = np.logical_and.reduce(rests[: 6 * count].reshape(2, 3, count), axis=1)
    pressed = slice(3 * count, 4 * count)
    free = rests[pressed] & (found.force_n[pressed] < LIMIT_SHARE * (device.max_force_n or np.inf))
    stiffness = (found.force_n / found.depth_m)[pressed][free]
    entry = 0.5 * device.mass_kg * deeds.velocity_m_per_s[-RELEASED:] ** 2
    return {
        "settled": int(settled[0].sum()),
        "settled_without_friction": int(settled[1].sum()),
        "at_rest_n_per_m": float(np.median(stiffness)) if len(stiffness) else None,
        "ripple_n": float(np.median(found.ripple_n[pressed])),
        "outside_n": float(found.outside_n.max()),
        "given_share": float((found.given_j[-RELEASED:] / entry).max()),
    }


def seconds_for(device: Device, hands: Floats) -> float:
    """How long is watched: as much longer as the slowest hand swings with the device where there is no wall."""
    slowest = float((2 * (device.mass_kg + hands[:, 0]) / (device.damping_ns_per_m + hands[:, 1])).max())
    return max(SECONDS, TAPPED_S + math.log(SWING_M_PER_S / REST_M_PER_S) * slowest + TAIL_S)


def phases(lanes: int) -> Floats:
    """Where the encoders count from, steps."""
    return np.random.default_rng([SEED, 1]).uniform(-0.5, 0.5, lanes)


def in_motion(loop: Loop, made: Callable[[int], Law]) -> dict[str, Any]:
    """What a shaken handle measures: stiffness and impedance error, the medians over places of the encoder."""
    device = loop.device
    depth = min(PRESS_N, device.max_force_n or PRESS_N) / 2 / loop.stiffness_n_per_m
    hz = np.repeat(HZ, PHASES)
    phase = np.tile((np.arange(PHASES) + 0.5) / PHASES - 0.5, len(HZ))
    rendered = frequency_sweep(device, made(len(hz)), depth, hz, phase)
    s = 2j * np.pi * hz
    own = device.mass_kg * s + device.damping_ns_per_m
    wanted = own + loop.damping_ns_per_m + loop.stiffness_n_per_m / s
    error = np.abs(own + rendered / s - wanted) / np.abs(wanted)
    stiffness, off = (np.median(value.reshape(len(HZ), PHASES), axis=1) for value in (np.abs(rendered), error))
    return {"shaken_depth_m": depth, "in_motion_n_per_m": stiffness.tolist(), "error": off.tolist()}


def held_n_per_m(kind: type[Wall], loop: Loop, hands: Floats) -> float | None:
    """The stiffest wall at which a law lets every hand settle without friction, halved from the one asked for."""
    frictionless = loop.device.model_copy(update={"coulomb_friction_n": 0.0})
    deeds = deeds_of(hands, frictionless)
    half = Deeds(**{name: column[: 3 * len(hands)] for name, column in vars(deeds).items()})
    for halvings in range(1, HALVINGS + 1):
        softer = replace(loop, stiffness_n_per_m=loop.stiffness_n_per_m / 2**halvings)
        lanes = len(half.mass_kg)
        found = simulated(softer.device, kind(softer, lanes), half, phases(lanes), seconds_for(softer.device, hands))
        if (found.speed_m_per_s < REST_M_PER_S).all():
            return softer.stiffness_n_per_m
    return None


def cell(name: str, law: str) -> dict[str, Any]:
    """A law before the wall that is asked for, and the stiffest wall at which it lets everybody settle."""
    problem = problem_of(name)
    device, wall, hands = problem.device, problem.environment, hands_of(problem)
    told = {"device": name, "law": law, "wall_n_per_m": wall.stiffness_n_per_m, "friction_n": device.coulomb_friction_n}
    loop = Loop(device, wall.stiffness_n_per_m, wall.damping_ns_per_m)
    told |= {"passive_n_per_m": loop.passive_n_per_m}
    if law in OURS:
        coupling = coupling_of(law, problem)
        made = Exported(export_c(coupling, unsafe=True)).lanes
        return told | {"method": coupling.method} | measured(loop, made, hands) | in_motion(loop, made)
    kind, tries = BASELINES[law], []
    # Tuned in favour of each law: by the hands that settle, then by the stiffness, then by the ripple.
    for tuned in tunings(kind, problem):
        tried = replace(loop, tuned=tuned)
        found = measured(tried, partial(kind, tried), hands)
        stiffness = round((found["at_rest_n_per_m"] or 0.0) / wall.stiffness_n_per_m, 2)
        merit = (found["settled_without_friction"], found["settled"], stiffness, -found["ripple_n"])
        tries.append((merit, tried, found))
    (without, settled, *_), tried, found = max(tries, key=itemgetter(0))
    held = loop.stiffness_n_per_m if without == settled == HANDS else held_n_per_m(kind, tried, hands)
    told |= {"tuned": None if math.isnan(tried.tuned) else tried.tuned, "held_n_per_m": held}
    return told | found | in_motion(tried, partial(kind, tried))


def tunings(kind: type[Wall], problem: avc.Problem) -> tuple[float, ...]:
    """What a law is tried with; one that has nothing to tune is tried once."""
    if issubclass(kind, PassivityController):
        stable = damping_range(PlantFamily.of(problem), softest_wall_n_per_m(problem.device))
        return tuple(share * stable.highest_ns_per_m for share in DAMPERS)
    return RATES_M_PER_S if kind is ForceAugmentation else (math.nan,)


def row(found: dict[str, Any]) -> tuple[str, ...]:
    """Return a row of the page."""
    words = {"robust": "state feedback", "damped": "contact damper"}
    name = found["law"]
    if name == "recommended":
        name = f"**recommended** ({words.get(found['method'], found['method'])})"
    if "error" not in found or isinstance(found["error"], str):
        return (name, *[found.get("error", "none")] * 9)
    errors = " / ".join(rounded(100 * error, 2) for error in found["error"])
    counts = f"{found['settled']} / {found['settled_without_friction']}"
    held = rounded(found["held_n_per_m"]) if "held_n_per_m" in found else ""
    motion = [rounded(stiffness) for stiffness in found["in_motion_n_per_m"]]
    ripple, outside = found["ripple_n"], found["outside_n"]
    energy = rounded(100 * found["given_share"], 2)
    return (
        name,
        rounded(found["at_rest_n_per_m"]),
        *motion,
        errors,
        counts,
        held,
        rounded(round(ripple, 5), 2),
        rounded(outside),
        energy,
    )


def write_page(document: dict[str, Any]) -> None:
    """Put the numbers into the page, whose words stay."""
    rows: list[tuple[str, ...]] = []
    for problem in PROBLEMS:
        found = [cell for name, cell in document["cells"].items() if name.startswith(f"{problem} |")]
        if found:
            of = found[0]
            wall, passive, led = (rounded(of[key]) for key in ("wall_n_per_m", "passive_n_per_m", "friction_n"))
            rows.append(
                (f"**{problem}, {wall} N/m**: {passive} N/m, {led} N, {1e3 * of['shaken_depth_m']:.3g} mm", *[""] * 9)
            )
            rows += [row(cell) for cell in found]
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition("| law | at rest")
    made = re.sub("^Made by .*$", made_by(document["about"]), before, count=1, flags=re.MULTILINE)
    PAGE.write_text(f"{made}{table(HEAD, rows)}\n\n## {rest.partition('## ')[2]}", encoding="utf-8")


def main() -> None:
    arguments = script_arguments(__doc__, out=RESULTS)
    told = about("python tests/benchmarks/passivity_baselines.py", SEED) | {"hands": HANDS}
    cells = {f"{name} | {law}": partial(cell, name, law) for name in PROBLEMS for law in (*BASELINES, *OURS)}
    computed(cells, arguments.out, told, write_page)


if __name__ == "__main__":
    main()
