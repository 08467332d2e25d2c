"""How stiff a wall each device of the catalogue can show: two sets of hands, gaps of the device files as ranges.

nice -n 10 python tests/benchmarks/catalogue_walls.py

Overwrites results/catalogue_walls.json and RESULTS_catalogue.md after every cell and goes on where it stopped. About
an hour of processor time.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from catalogue_page import FRESH, FRESH_CORNERS, FRESH_WITHIN, INSIDE, PLAIN_SHARE, WALL_N_PER_M, write_page
from studied import about, computed, cpu_seconds, expected_n_per_m, felt_n_per_m

sys.path.insert(0, str(Path(__file__).parent.parent))
from whole_device import WholeDevice, rests_as_tried

import avc_casadi as avc
import avc_hardware
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.files.device_file import DeviceFile, device_catalogue
from avc_casadi.loops.walls import damping_range, stiffest_wall
from avc_casadi.model.corners import device_corners, device_set, device_with, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import FINGERTIP, hand_corners, with_released
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.population.coupling_trial import try_coupling, try_on_devices
from avc_casadi.simulation.population.motions import course_of
from avc_casadi.simulation.population.operators import draw_hands, people_of

# Of the hands and devices that `recommend` tries, and of those it never saw.
SEED, FRESH_SEED = 2026, 4711
PEOPLE = 100
# As many processes as `avc recommend` has.
WORKERS = 2
OUT = Path(__file__).parent / "results" / "catalogue_walls.json"

HANDS: dict[str, dict[str, Any]] = {"default": {}, "fingertip": FINGERTIP.model_dump()}
# What stands for a value that nobody publishes and the device file gives no range for; nominal values are simulated.
GAPS: dict[str, dict[str, Any]] = {
    "damping_ns_per_m": {"damping_ns_per_m": 0.2, "range": {"damping_ns_per_m": (0.0, 1.0)}},
    "delay_samples": {"delay_samples": 1, "range": {"delay_samples": (0, 2)}},
    "encoder_resolution_m": {"encoder_resolution_m": 5.5e-5},
    "amplifier_bandwidth_hz": {"amplifier_bandwidth_hz": 1000.0, "range": {"amplifier_bandwidth_hz": (500.0, 3000.0)}},
    "resonance": {
        "resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "mass_ratio": 0.3},
        "range": {"resonance": {"frequency_hz": (80.0, 300.0)}},
    },
}
READINGS = {
    "cautious": "every gap that matters to the loop is a range",
    "as filed": "structure rigid, amplifier and encoder ideal where the file has a gap",
}
# Each alone, on the device with its ranges.
CHANGES: dict[str, dict[str, Any]] = {
    "delay": {"delay_samples": 0, "range": {"delay_samples": None}},
    "resonance": {"resonance": None, "range": {"resonance": {"frequency_hz": None}}},
    "amplifier": {"amplifier_bandwidth_hz": None, "range": {"amplifier_bandwidth_hz": None}},
}


def groups() -> dict[str, DeviceFile]:
    """Return one device file for all that declare the same device."""
    found: list[tuple[list[str], DeviceFile]] = []
    for one in device_catalogue():
        same = next((names for names, other in found if other.device == one.device and other.gaps == one.gaps), None)
        if same is None:
            found.append(([one.name], one))
        else:
            same.append(one.name)
    return {", ".join(names): one for names, one in found}


def read_as(file: DeviceFile, reading: str, hands: dict[str, Any]) -> Problem:
    """Return the wall on a device of the catalogue; with one that turns all of it is the same at its handle."""
    radius_m = file.device.metres_per_unit
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": WALL_N_PER_M * radius_m**2}
    turned = {key: tuple(radius_m**2 * end for end in ends) if ends else ends for key, ends in hands.items()}
    problem = avc.load_problem("reference-r1").changed(device=file.device, environment=wall, hands=turned)
    if reading == "as filed":
        return problem
    for key, values in GAPS.items():
        ranged = key != "resonance" and getattr(file.device.range, key) is not None
        if key in file.gaps and not ranged:
            problem = problem.changed(device=at_radius(values, radius_m))
    return problem


def at_radius(values: dict[str, Any], radius_m: float) -> dict[str, Any]:
    """Return what stands for a gap as a device that turns counts it, rad and N.m.s/rad; 1 m leaves it as it is."""
    units = {"damping_ns_per_m": radius_m**2, "encoder_resolution_m": 1 / radius_m}
    turned = {key: units[key] * value if key in units else value for key, value in values.items()}
    known = values.get("range", {})
    return turned | {
        "range": {
            key: tuple(units.get(key, 1) * end for end in ends) if isinstance(ends, tuple) else ends
            for key, ends in known.items()
        }
    }


def cell(file: DeviceFile, reading: str, hands: str) -> dict[str, Any]:
    problem = read_as(file, reading, HANDS[hands])
    at_handle = 1 / problem.device.metres_per_unit**2
    extreme = with_released(hand_corners(problem.hands))
    plain = stiffest_wall(problem.device, extreme).stiffness_n_per_m
    started = cpu_seconds()
    found = avc.recommend(problem, hands=PEOPLE, seed=SEED, workers=WORKERS)
    seconds = cpu_seconds() - started
    coupling, trial = found.coupling, found.trial
    same = {
        "plain_n_per_m": plain * at_handle,
        "stiffest_without_n_per_m": without(problem, extreme),
        "plain_at_rest": plain_at_rest(problem, extreme, plain),
        "recommend_cpu_s": round(seconds, 1),
        "reason": found.reason,
        "friction_n": problem.device.coulomb_friction_n,
    }
    if coupling is None or trial is None:
        return same | {"recommended_n_per_m": None}
    return same | {
        "recommended_n_per_m": expected_n_per_m(coupling) * at_handle,
        "felt_n_per_m": None if (felt := felt_n_per_m(trial)) is None else felt * at_handle,
        "method": coupling.method,
        "observer": coupling.runtime.observer_mass_kg is not None or coupling.runtime.state_feedback is not None,
        "with_friction_n_per_m": None
        if found.with_friction_n_per_m is None
        else found.with_friction_n_per_m * at_handle,
        "people": trial.hands,
        "at_rest": int(trial.stable.sum()),
        "at_rest_without_friction": int(trial.stable_without_friction.sum()),
        "quiet": int(trial.quiet.sum()),
        "at_force_limit": int(trial.at_force_limit.sum()),
        "fresh_at_rest": fresh_at_rest(coupling),
        "inside": inside(coupling),
        "corners": bool(deployable(coupling).passed),
    }


def without(problem: Problem, extreme: Any) -> dict[str, float]:
    """Return the stiffest plain wall with one thing taken from the device, or the sample time halved."""
    device = problem.device
    changes = CHANGES | {"sampling": {"sample_time_s": device.sample_time_s / 2}}
    has = {
        "delay": device.delay_samples > 0,
        "resonance": device.resonance is not None,
        "amplifier": device.amplifier_bandwidth_hz is not None,
        "sampling": True,
    }
    return {
        name: stiffest_wall(problem.changed(device=keys).device, extreme).stiffness_n_per_m / device.metres_per_unit**2
        for name, keys in changes.items()
        if has[name]
    }


def plain_at_rest(problem: Problem, extreme: Any, plain: float) -> dict[str, int]:
    """Return how many hands rest without friction at nine tenths of the plain limit, with the encoder and without."""
    felt, wall = PLAIN_SHARE * plain, problem.environment.stiffness_n_per_m
    if felt >= wall or felt == 0:
        return {}
    damping = damping_range(problem.device, extreme, felt)
    middle = (damping.lowest_ns_per_m + damping.highest_ns_per_m) / 2
    gains = Gains(0.0, felt * wall / (wall - felt), middle)
    free = problem.changed(device={"coulomb_friction_n": 0.0, "range": {"coulomb_friction_n": None}})
    people = people_of(problem.hands, PEOPLE, SEED)
    return {
        name: int(try_coupling(Coupling.constant(one, gains, "softened wall"), people, SEED).stable.sum())
        for name, one in (
            ("encoder", free),
            ("no encoder", free.changed(device={"encoder_resolution_m": 0.0})),
        )
    }


def fresh_at_rest(coupling: Coupling) -> dict[str, int | None]:
    """Count fresh hands at rest without friction, dealt out among devices at corners of the ranges and within.

    In the scene, and with the exported C in a simulator that shares no code with the project, which has a structure
    and an amplifier and counts in metres.
    """
    device, random = coupling.problem.device, np.random.default_rng(FRESH_SEED)
    corners = device_corners(device)
    some = [corners[place] for place in random.permutation(len(corners))[:FRESH_CORNERS]]
    devices = [*some, *device_set(device, draws=FRESH_WITHIN, seed=FRESH_SEED)[len(corners) :]]
    people = draw_hands(coupling.problem.hands, FRESH, FRESH_SEED)
    found = {"scene": int(try_on_devices(coupling, people, devices, FRESH_SEED).stable_without_friction.sum())}
    if device.motion == "rotary" or device.resonance is None or device.amplifier_bandwidth_hz is None:
        return found | {"second_simulator": None}
    bench = WholeDevice(device, avc_hardware.export_c(coupling))
    hands = list(zip(*vars(people).values(), strict=True))
    rest = 0
    for place, one in enumerate(devices):
        longest_s = course_of(coupling.problem.changed(device=one)).longest_s
        rest += int(rests_as_tried(bench, one, hands[place :: len(devices)], 0.0, longest_s).sum())
    return found | {"second_simulator": rest}


def inside(coupling: Coupling) -> int:
    """Count the devices drawn inside the ranges, not at their corners, on which the coupling is deployable too."""
    random = np.random.default_rng(SEED)
    device = coupling.problem.device
    ends = {
        key: interval
        for key in linear_values(device)
        if (interval := _interval(device, key)) is not None and interval[0] < interval[1]
    }
    passed = 0
    for _ in range(INSIDE):
        drawn = {key: float(random.uniform(*interval)) for key, interval in ends.items()}
        one = device_with(device, drawn)
        moved = Coupling.constant(
            coupling.problem.changed(device=one), coupling.table.at_rest, coupling.method, coupling.runtime
        )
        passed += deployable(moved).passed
    return passed


def _interval(device: Device, key: str) -> tuple[float, float] | None:
    table, _, inner = key.rpartition(".")
    return getattr(device.range.resonance if table else device.range, inner)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    cells = {
        f"{name} | {hands} | {reading}": partial(cell, file, reading, hands)
        for reading in READINGS
        for hands in HANDS
        for name, file in groups().items()
        if reading == "cautious" or file.gaps  # without gaps both readings are one
    }
    computed(cells, OUT, about("python tests/benchmarks/catalogue_walls.py", SEED), write_page)


if __name__ == "__main__":
    main()
