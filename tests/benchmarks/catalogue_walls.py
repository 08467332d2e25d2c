"""How stiff a wall each device of the catalogue can show: two sets of hands, gaps of the device files as ranges.

nice -n 10 python tests/benchmarks/catalogue_walls.py

Overwrites results/catalogue_walls.json and RESULTS_catalogue.md after every cell and goes on where it stopped. About
an hour and a half of processor time.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, computed, cpu_seconds, expected_n_per_m, felt_n_per_m, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from whole_device import WholeDevice, rests_as_tried

import avc_casadi as avc
import avc_hardware
from avc_casadi.certificate import deployable
from avc_casadi.coupling import Coupling, Gains
from avc_casadi.loop import (
    FINGERTIP,
    device_corners,
    device_set,
    device_with,
    hand_corners,
    linear_values,
    with_let_go,
)
from avc_casadi.problem import Device, DeviceFile, Problem, SdkExample, device_catalogue, load_device
from avc_casadi.stability import damping_range, stiffest_wall
from avc_casadi.trial import course_of, draw_hands, people_of, try_coupling, try_on_devices

# Of the hands and devices that `recommend` tries, and of those it never saw.
SEED, FRESH_SEED = 2026, 4711
PEOPLE, FRESH = 100, 400
# Corners of the ranges, and devices within, among which fresh hands are dealt out.
FRESH_CORNERS, FRESH_WITHIN = 24, 16
# As many processes as `avc recommend` has.
WORKERS = 2
WALL_N_PER_M = 1e5
OUT = Path(__file__).parent / "results" / "catalogue_walls.json"
PAGE = Path(__file__).parent / "RESULTS_catalogue.md"

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
INSIDE = 12
PLAIN_SHARE = 0.9
_MOST = 0.5


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
    extreme = with_let_go(hand_corners(problem.hands))
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


def limited_by(found: dict[str, Any]) -> str:
    """Name what holds a wall back."""
    if found.get("at_force_limit", 0) > _MOST * found.get("people", np.inf):
        return "force limit"
    raised = found["stiffest_without_n_per_m"]
    name = max(raised, key=lambda one: raised[one])
    rest = found["plain_at_rest"]
    plain = found["plain_n_per_m"]
    if plain == raised[name] == 0:
        return "no plain wall with any one of these"
    said = f"{name} (x {raised[name] / plain:.2g})" if plain else f"{name} (no plain wall with it)"
    if rest and rest["encoder"] < rest["no encoder"]:
        said += f"; encoder ({rest['encoder']} rest, {rest['no encoder']} without it)"
    return said


def examples(names: str) -> list[SdkExample]:
    """Return what an SDK ships for the devices of a row, in their order."""
    found = (load_device(name).sdk_example for name in names.split(", "))
    return [one for one in found if one is not None]


def sdk_example(names: str) -> str:
    limits = [
        f"{rounded(one.wall_stiffness_n_per_m)} (example program)"
        if one.max_stiffness_n_per_m is None
        else f"{rounded(one.max_stiffness_n_per_m)}; {rounded(one.max_damping_ns_per_m)}"
        for one in examples(names)
    ]
    return ", ".join(limits) or "-"


HEAD = (
    "device",
    "hands",
    "plain limit, N/m",
    "recommended, N/m",
    "felt, N/m",
    "by",
    "leaning on friction, N/m",
    "at rest / without friction / quiet of 100",
    "fresh hands at rest on devices of the ranges / in the second simulator",
    "at the force limit",
    "holds inside the ranges",
    "limited by",
    "SDK example, N/m; N.s/m",
)


def row(name: str, hands: str, found: dict[str, Any]) -> list[str]:
    if "error" in found:
        return [name, hands, found["error"], *[""] * (len(HEAD) - 3)]
    if found["recommended_n_per_m"] is None:
        return [name, hands, rounded(found["plain_n_per_m"]), "none", *["-"] * 7, limited_by(found), sdk_example(name)]
    return [
        name,
        hands,
        rounded(found["plain_n_per_m"]),
        rounded(found["recommended_n_per_m"]),
        rounded(found["felt_n_per_m"]),
        found["method"] + (" + observer" if found["observer"] and found["method"] != "robust" else ""),
        rounded(found["with_friction_n_per_m"]) if found["friction_n"] else "no friction known",
        f"{found['at_rest']} / {found['at_rest_without_friction']} / {found['quiet']}",
        fresh(found["fresh_at_rest"]),
        str(found["at_force_limit"]),
        f"{found['inside']} of {INSIDE}",
        limited_by(found),
        sdk_example(name),
    ]


def fresh(found: dict[str, int | None]) -> str:
    second = found["second_simulator"]
    return f"{found['scene']}" if second is None else f"{found['scene']} / {second}"


TEXT = """# How stiff a wall each device of the catalogue can show

{made_by}

The wall asked for is {wall} N/m, out of reach on purpose, on one axis. **Plain limit**: the stiffest wall that spring
and damper hold with every corner of the hands and let go, at every corner of the device's ranges
(`avc_casadi.stability.stiffest_wall`), linear. **Recommended**: coupling and wall in series of `avc recommend`;
**felt**: median at the end of a press, hands at the force limit left out. **Leaning on friction**: what
`with_friction_n_per_m` tells: of what was tried, so at least that. Trials: 100 hands, corners among them, on the
nominal device. **Fresh hands**: {fresh} that `recommend` never saw, dealt out among devices at corners of the ranges
and within ({corners} and {within}, drawn anew), at rest without dry friction: in the scene, and with the exported C in
a simulator that shares no code with the project (linear devices with amplifier and structure). **Holds inside the
ranges**: of {inside} devices drawn inside the ranges (claims are made at their corners), those on which the coupling
is deployable. **Limited by**: the force limit if most presses end at it; else the single change that raises the plain
limit most (no delay, no resonance, ideal amplifier, each with its range gone; half the sample time) and by how much;
and the encoder, if without it more hands rest (without friction) before the plain wall of {share:.0%} of the limit.
Walls of a device that turns are told at its handle.
Hands: the default set (0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m) and fingertips (0.02 to 0.1 kg, 1 to 5 N.s/m,
100 to 500 N/m).

**SDK example**: what CHAI3D 3.3.0 (Hapkit: its example program) ships as limits of stiffness and of damping. Example
values of an SDK, no datasheets; they were not made for the ranges below.

## Gaps taken as ranges

Nobody publishes most values of most devices. Here each gap is a range, its nominal value simulated: mass, damping and
delay as the device file gives them (damping 0 to 1 N.s/m, delay 0 to 2 samples; where the file gives no range for the
gap: the same); amplifier 500 to 3000 Hz (nominal 1000); a resonance at 80 to 300 Hz (nominal 150; damping ratio 0.05,
mass ratio 0.3); an encoder step of 55 um, the coarsest that is published for a desktop device here. **Not filled**:
noise and backlash (taken as none), dry friction (none, the cautious end, unless the file has a value), force limit
(none known: no limit). Devices with the same values share a row. What these rows say of a device with gaps is as much
about the ranges as about the device: they are what can be promised without measuring it.

{cautious}

{cautious_said}

## Gaps left ideal, for comparison

The same with a rigid structure, an ideal amplifier and an exact encoder wherever the file has such a gap; mass, damping
and delay still over their ranges. **Not to be promised for a device**: it shows what an unmeasured structure costs.

{filed}

{filed_said}
"""


def said(document: dict[str, Any], reading: str) -> str:
    """Say what a table shows, from its numbers."""
    found = {
        name: one
        for name, one in document["cells"].items()
        if name.endswith(f"| {reading}") and "error" not in one and one["recommended_n_per_m"] is not None
    }
    if not found:
        return ""
    gain = [
        one["recommended_n_per_m"] / min(one["plain_n_per_m"], WALL_N_PER_M)
        for one in found.values()
        if one["plain_n_per_m"]
    ]
    beyond = [
        (sdk.max_stiffness_n_per_m, one)
        for name, one in found.items()
        for sdk in examples(name.split(" | ")[0])
        if sdk.max_stiffness_n_per_m is not None
    ]
    whole = sum(one["at_rest_without_friction"] == one["people"] for one in found.values())
    over = sum(limit > one["recommended_n_per_m"] for limit, one in beyond)
    inner = sum(one["inside"] == INSIDE for one in found.values())
    tried = {
        name: [one["fresh_at_rest"][name] for one in found.values() if one["fresh_at_rest"][name] is not None]
        for name in ("scene", "second_simulator")
    }
    rest = {name: f"{rounded(sum(some), 9)} of {rounded(FRESH * len(some), 9)}" for name, some in tried.items()}
    beyond_the_scene = f" ({rest['second_simulator']} in the second simulator)" if tried["second_simulator"] else ""
    return (
        f"In {len(found)} rows the recommended wall is {min(gain):.2g} to {max(gain):.2g} times the plain limit, or "
        f"the wall where that is less (median {np.median(gain):.2g}); in {whole} all hands come to rest without "
        f"friction; of fresh hands on devices all over the ranges {rest['scene']} do{beyond_the_scene}; in {inner} the "
        "coupling holds on all devices drawn inside the ranges. The SDK's example limit is stiffer than what is "
        f"recommended in {over} of {len(beyond)} devices and hands that have one."
    )


def write_page(document: dict[str, Any]) -> None:
    def rows(reading: str) -> str:
        cells = [name.split(" | ") for name in document["cells"]]
        return table(
            HEAD,
            (
                row(name, hands, document["cells"][f"{name} | {hands} | {which}"])
                for name, hands, which in sorted(cells)
                if which == reading
            ),
        )

    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            wall=rounded(WALL_N_PER_M),
            inside=INSIDE,
            fresh=FRESH,
            corners=FRESH_CORNERS,
            within=FRESH_WITHIN,
            share=PLAIN_SHARE,
            cautious=rows("cautious"),
            filed=rows("as filed"),
            cautious_said=said(document, "cautious"),
            filed_said=said(document, "as filed"),
        ),
        encoding="utf-8",
    )


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
