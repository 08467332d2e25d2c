"""[simulation] against real engines: limits, recommended pairs at a box, minimum mass, a wheel with a game's spring.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/engine_boundaries.py

Needs MuJoCo (`pip install "avc-casadi[engines]"`). Device with hand, coupling and exchange are simulated by
engine_axes.py, which shares nothing with the project; MuJoCo moves the tools. Overwrites
results/engine_boundaries.json and RESULTS_engine_boundaries.md after every cell and goes on where it stopped.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from engine_axes import Array, Axis, largest_stable_n_per_m, run
from script_arguments import script_arguments
from studied import about, computed, made_by, rounded, table

import avc_casadi as avc
from avc_casadi.design.virtual_tool import ToolSearch
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.problem import Problem
from avc_casadi.model.virtual_tool import ToolGains

SEED = 5207
OUT = Path(__file__).parent / "results" / "engine_boundaries.json"
PAGE = Path(__file__).parent / "RESULTS_engine_boundaries.md"

MASSES_KG, RATES_HZ = (0.05, 0.2, 1.0), (1000.0, 500.0, 200.0, 62.5)
# And of the exchange ahead the limit with a damper of the device's own loop, which belongs to it.
DAMPED = "ahead, damped"
EXCHANGES = ("on-time", "late", "ahead", DAMPED)
RANDOM, BOXES, PEOPLE = 100, 12, 200
BEYOND = 1.3
# Runs of the exchange ahead without that damper: light negative dampers grow slowly, and stiffnesses are low.
AHEAD_S = 20.0
DROPPED = 0.01
# A device that moves no more than this over half a second rests, m.
_REST_M = 5e-5


def problem_of(axis: Axis, **simulation: Any) -> Problem:
    """Return the axis as a problem."""
    device = {
        "mass_kg": axis.mass_kg,
        "damping_ns_per_m": axis.damping_ns_per_m,
        "sample_time_s": axis.sample_time_s,
        "delay_samples": axis.delay_samples,
    }
    table_ = {
        "tool_mass_kg": axis.tool_mass_kg,
        "step_s": axis.step_s,
        "exchange": axis.exchange,
        "steps_late": axis.steps_late,
        "integrator": "implicit-damping" if axis.engine_damps else "semi-implicit",
    }
    frequency = {"stop_hz": min(450.0, 0.45 / axis.sample_time_s)}
    return Problem(device=device, simulation=table_ | simulation, frequency=frequency)


def corners(problem: Problem) -> Array:
    """Return the corners of the hands and the device released, rows of mass, damping and stiffness."""
    hands = hand_corners(problem.hands)
    return np.array([*(list(hands.values(row).values()) for row in range(len(hands))), [0.0, 0.0, 0.0]])


def stiffest(problem: Problem) -> ToolGains:
    """Return the project's stiffest pair, with a damper of the device's own loop where one belongs to the exchange."""
    assert problem.simulation is not None
    search = ToolSearch(problem)
    return search.stiffest_beside_local_damper() if problem.simulation.damped_locally else search.stiffest()


def in_mujoco(axis: Axis, gains: ToolGains) -> float | None:
    """Return MuJoCo's largest stable K with the damper of a pair; None where the pair is none.

    A damper of the device's own loop goes with K, for one damping ratio, as in the project's search.
    """
    if gains.stiffness_n_per_m == 0:
        return None
    ratio = (gains.local_damping_ns_per_m + axis.damping_ns_per_m) / math.sqrt(gains.stiffness_n_per_m)

    def local(k: Any) -> Any:
        within = ratio * np.sqrt(k) - axis.damping_ns_per_m
        return np.maximum(within, 0.0) if gains.local_damping_ns_per_m else np.zeros_like(k)

    return largest_stable_n_per_m(
        axis,
        corners(problem_of(axis)),
        gains.stiffness_n_per_m,
        lambda k: np.full_like(k, gains.damping_ns_per_m),
        local,
        seconds=AHEAD_S if axis.exchange == "ahead" and not gains.local_damping_ns_per_m else 4.0,
    )


def table_cell(mass_kg: float, rate_hz: float, exchange: str) -> dict[str, Any]:
    """Limits of one tool at one rate: the project's by integrator, MuJoCo's where it has that integrator."""
    axis = Axis(0.12, 0.8, 1e-3, 1.0, mass_kg, 1 / rate_hz, "ahead" if exchange == DAMPED else exchange)
    problem = problem_of(axis)
    found: dict[str, Any] = {}
    for name in ("semi-implicit", "implicit-damping", "implicit"):
        one = problem.changed(simulation={"integrator": name})
        gains = stiffest(one) if exchange == DAMPED else ToolSearch(one).stiffest()
        found[name] = [gains.stiffness_n_per_m, gains.damping_ns_per_m]
        if name != "implicit":
            engine = Axis(**(vars(axis) | {"engine_damps": name == "implicit-damping"}))
            found[f"{name} in MuJoCo"] = in_mujoco(engine, gains)
    if exchange == DAMPED:
        return found
    loops = ToolLoops(problem)

    def critical(k: Any) -> Any:
        return 2 * np.sqrt(k * mass_kg)

    grid = np.geomspace(1.0, 1e5, 600)
    stable = [loops.stable(ToolGains(float(k), float(critical(k)))) for k in grid]
    default = float(grid[int(np.argmin(stable)) - 1]) if stable[0] else 0.0
    found["default damping"] = default
    found["default damping in MuJoCo"] = (
        largest_stable_n_per_m(axis, corners(problem), default, critical, np.zeros_like) if default else None
    )
    return found


def drawn(index: int, last_mass_kg: float = 2.0) -> Axis:
    """Draw a device and an engine; the same for an index whatever the count."""
    random = np.random.default_rng([SEED, index])

    def log(low: float, high: float) -> float:
        return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.3g}")

    t = float(random.choice([0.5e-3, 1e-3, 2e-3]))
    whole, late = bool(random.random() < 0.5), round(float(random.uniform(0, 3)), 2)
    return Axis(
        mass_kg=log(0.05, 0.5),
        damping_ns_per_m=log(0.1, 3.0),
        sample_time_s=t,
        delay_samples=float(random.integers(0, 4)) if whole else late,
        tool_mass_kg=log(0.02, last_mass_kg),
        step_s=int(random.integers(1, 21)) * t,
        exchange=str(random.choice(["on-time", "late", "ahead", "held-force"])),
        engine_damps=bool(random.random() < 0.25),
    )


def random_cell(index: int) -> dict[str, Any]:
    """The project's limit and MuJoCo's with the same damper."""
    axis = drawn(index)
    if axis.exchange == "held-force":
        axis = Axis(**(vars(axis) | {"engine_damps": False}))
    gains = stiffest(problem_of(axis))
    return {"axis": vars(axis), "gains": vars(gains), "mujoco_n_per_m": in_mujoco(axis, gains)}


def course(axis: Axis) -> tuple[Array, list[slice]]:
    """Return the target of hands that swing freely, tap and press, and where free motion and press are judged."""
    t = axis.sample_time_s
    settle_s = 1.0 + 12 * (axis.mass_kg + 0.3 + axis.tool_mass_kg) / (axis.damping_ns_per_m + 3)

    def span(seconds: float) -> Array:
        return np.arange(int(seconds / t)) * t

    rest_m, deep_m = -0.02, 0.01
    swing = rest_m + 0.008 * np.sin(2 * math.pi * 2 * span(1.0))
    free = np.full(len(span(settle_s)), rest_m)
    approach = rest_m + (deep_m - rest_m) * span(0.4) / 0.4
    taps = deep_m - 0.015 * (1 - np.cos(2 * math.pi * 3 * span(1.0)))
    press = np.full(len(span(settle_s)), deep_m)
    target = np.concatenate([swing, free, approach, taps, press])
    half, ends = int(0.5 / t), len(swing) + len(free)
    return target, [slice(ends - half, ends), slice(len(target) - half, len(target))]


def settled(axis: Axis, hands: Array, gains: ToolGains, *, dropped: bool = False) -> dict[str, Any]:
    """Count hands that rest after free motion and in the press, with MuJoCo's box and default contact."""
    target, judged = course(axis)
    numbers = (gains.stiffness_n_per_m, gains.damping_ns_per_m, gains.local_damping_ns_per_m)
    random = np.random.default_rng(SEED).random(len(target)) < (DROPPED if dropped else 0.0)
    found = run(
        axis,
        hands,
        tuple(np.full(len(hands), one) for one in numbers),  # type: ignore[arg-type]
        len(target),
        held=np.zeros(len(hands), dtype=bool),
        target_m=target,
        box=True,
        start_m=target[0],
        dropped=lambda number: bool(random[number]),
        force_limit_n=10.0,
    )
    moves = [np.ptp(found.device_m[:, part], axis=1) + np.ptp(found.tool_m[:, part], axis=1) for part in judged]
    rests = np.array([move < _REST_M for move in moves])
    return {
        "free": int(rests[0].sum()),
        "pressed": int(rests[1].sum()),
        "both": int(rests.all(axis=0).sum()),
        "worst_um": [round(1e6 * float(np.nanmax(move)), 2) if np.isfinite(move).all() else None for move in moves],
        "contacts_broken": int(
            (np.diff((found.tool_m[:, judged[0].stop :] > 0).astype(int), axis=1) < 0).sum(axis=1).min()
        ),
    }


def box_cell(index: int) -> dict[str, Any]:
    """A recommended pair, and one beyond the limit, pressed on a box of MuJoCo by many hands."""
    axis = drawn(10_000 + index, 0.5)
    axis = Axis(**(vars(axis) | {"engine_damps": False}))
    problem = problem_of(axis).changed(device={"max_force_n": 10.0})
    answer = avc.recommend(problem, hands=100)
    told: dict[str, Any] = {
        "axis": vars(axis),
        "reason": answer.reason,
        "limit_n_per_m": answer.stiffest.stiffness_n_per_m,
    }
    if answer.coupling is None:
        return told | {"gains": None}
    gains, random = answer.coupling.gains, np.random.default_rng([SEED, index, 1])
    ends = corners(problem)[:-1]
    hands = np.concatenate([ends, random.uniform(ends.min(axis=0), ends.max(axis=0), (PEOPLE - len(ends), 3))])
    beyond = replace(answer.stiffest, stiffness_n_per_m=BEYOND * answer.stiffest.stiffness_n_per_m)
    every = np.concatenate([hands[: len(ends)]] * 2 + [np.zeros((2, 3))])
    held = [*np.array([False, True]).repeat(len(ends)).tolist(), False, True]
    numbers = (beyond.stiffness_n_per_m, beyond.damping_ns_per_m, beyond.local_damping_ns_per_m)
    kicked = run(
        axis,
        every,
        tuple(np.full(len(every), one) for one in numbers),  # type: ignore[arg-type]
        int(4.0 / axis.sample_time_s),
        held=np.array(held),
    )
    return told | {
        "gains": vars(gains),
        "steady": settled(axis, hands, gains),
        "dropped": settled(axis, hands, gains, dropped=True),
        "beyond": settled(axis, hands, beyond),
        "beyond_grows": int(kicked.grows.sum()),
    }


# Steering wheel of simulators: moment of inertia, drag, radius of the rim, as in the project's guide.
WHEEL = """[device]
motion = "rotary"
handle_radius_m = 0.15
inertia_kgm2 = 0.05
damping_nms_per_rad = 0.02
delay_samples = 1
max_torque_nm = 8.0
[simulation]
step_s = {step_s!r}
exchange = "held-force"
steps_late = {frames}
stiffness_nm_per_rad = {spring!r}
"""
SPRINGS_NM_PER_RAD, FRAMES = (2.0, 8.0, 20.0), (0, 1, 2)


def wheel_cell(spring: float, frames: int) -> dict[str, Any]:
    """Dampers of the wheel's own loop with which a game's spring at 60 Hz holds: the project's, and simulated ones."""
    problem = avc.parse_problem(WHEEL.format(step_s=1 / 60, frames=frames, spring=spring))
    axis = Axis(0.05, 0.02, 1e-3, 1.0, 1.0, 1 / 60, "held-force", steps_late=frames)
    hands = corners(problem) * 0.15**2
    dampers = np.geomspace(0.02, 200.0, 60)
    loops = ToolLoops(problem)
    stated = [loops.stable(ToolGains(spring, 0.0, float(one))) for one in dampers]
    every, local = np.tile(hands, (len(dampers), 1)), np.repeat(dampers, len(hands))
    good = np.ones(len(dampers), dtype=bool)
    for phase in (0.0, 0.5):
        k, none = np.full(len(local), spring), np.zeros(len(local))
        found = run(axis, every, (k, none, local), 9_000, held=np.ones(len(local), dtype=bool), phase=phase)
        good &= ~found.grows.reshape(len(dampers), -1).any(axis=1)
    answer = avc.recommend(problem, hands=20)
    recommended = None if answer.coupling is None else answer.coupling.gains.local_damping_ns_per_m
    return {
        "project": _range(dampers, stated),
        "simulated": _range(dampers, good.tolist()),
        "apart": int(sum(one != other for one, other in zip(stated, good, strict=True))),
        "recommended": recommended,
        "reason": answer.reason,
    }


def _range(values: Array, good: list[bool]) -> list[float] | None:
    some = values[np.array(good)]
    return [float(some.min()), float(some.max())] if len(some) else None


def passive_mass_kg(k: float, b: float, drag: float, t: float) -> float:
    """Return the lightest passive tool by frequencies: sampled-data passivity of a device with this drag, on-time.

    Colgate and Schenkel's condition drag > T/2 Re((1 - 1/z) H(z)) / (1 - cos(w T)) with H of coupling and a mass moved
    by semi-implicit Euler at T; bisected. Infinite where a rigid end is not passive either.
    """
    angle = np.linspace(1e-3, math.pi, 4000)
    z = np.exp(1j * angle)
    joined = k + b * (1 - 1 / z) / t

    def passive(mass: float) -> bool:
        # Position of the mass for a force, before the step: T^2 / m * z / (z - 1)^2; its speed T / m / (z - 1).
        compliance = t * t / mass * z / (z - 1) ** 2
        h = joined / (1 + k * compliance + b * t / mass / (z - 1))
        return bool(np.all(drag > t / 2 * ((1 - 1 / z) * h).real / (1 - np.cos(angle))))

    if not passive(1e6):
        return math.inf
    # A tool this light, or lighter, is unstable on a device that stands still: its pole is at -1.
    low, high = t / 2 * (b + k * t / 2), 1e6
    while high > 1.0005 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if passive(middle) else (middle, high)
    return high


def mass_cell(index: int) -> dict[str, Any]:
    """Minimum mass for passivity, by frequencies and in closed form, and the project's verdict on it."""
    random = np.random.default_rng([SEED, index, 2])
    t, drag = float(random.choice([0.5e-3, 1e-3, 2e-3])), float(np.exp(random.uniform(np.log(0.3), np.log(5))))
    share, split = random.uniform(0.05, 0.9), random.uniform(0.1, 0.9)
    c = share * drag  # B + K T/2, below the drag: the condition of Colgate and Schenkel for a rigid end
    b, k = split * c, 2 * (1 - split) * c / t
    mass = passive_mass_kg(k, b, drag, t)
    axis = Axis(0.12, drag, t, 0.0, mass, t, "on-time")
    loops = ToolLoops(problem_of(axis))
    lighter = next(
        (
            factor
            for factor in np.geomspace(1.0, 1e-4, 60)
            if not ToolLoops(problem_of(Axis(**(vars(axis) | {"tool_mass_kg": factor * mass})))).stable(ToolGains(k, b))
        ),
        0.0,
    )
    return {
        "numbers": [k, b, drag, t],
        "by_frequencies_kg": mass,
        "closed_form_kg": t / 2 * drag * c / (drag - c),
        "stable_there": loops.stable(ToolGains(k, b)),
        "unstable_below_kg": float(lighter * mass),
    }


def cells() -> dict[str, Callable[[], dict[str, Any]]]:
    """Return every cell by name."""
    found: dict[str, Callable[[], dict[str, Any]]] = {}
    found |= {f"random {index}": partial(random_cell, index) for index in range(RANDOM)}
    found |= {f"box {index}": partial(box_cell, index) for index in range(BOXES)}
    found |= {f"mass {index}": partial(mass_cell, index) for index in range(20)}
    found |= {
        f"wheel {spring:g} {frames}": partial(wheel_cell, spring, frames)
        for spring in SPRINGS_NM_PER_RAD
        for frames in FRAMES
    }
    for exchange in EXCHANGES:
        for mass in MASSES_KG:
            for rate in RATES_HZ:
                found[f"table {mass:g} {rate:g} {exchange}"] = partial(table_cell, mass, rate, exchange)
    return found


TEXT = """# [simulation] against real engines

{made_by}

`avc recommend` of a problem with `[simulation]` judges a linear, periodic model. Here MuJoCo itself moves the tools:
bodies on slide joints, pushed by `qfrc_applied`, integrator Euler, or implicitfast with the coupling's damper in the
joint. Device and hand (exact zero-order hold, fractional delays too), coupling and exchange are code of this study
([engine_axes.py](engine_axes.py)); hands are the corners of the default box and the device released, the tool free
and held (a body without a joint). Unstable is what grows: after a kick of 1 mm/s the energy is larger in the last
quarter of 4 s (`ahead` without a damper of the device's loop: 20 s) than in the third. MuJoCo's limit is the largest
K, from half the project's up, at last within 0.3 %, below which nothing grows, with the damper of the project's
stiffest pair, and with one of the device's own loop, where it has one, for the same damping ratio.

## Limits

Device 0.12 kg, 0.8 N.s/m, T 1 ms, one sample of delay. Stiffest K, N/m, with its best damper; in brackets MuJoCo's
with the same damper. **ahead, damped**: with a damper of the device's own loop, which belongs to that exchange. The
last column has the damper that engines take, B = 2 sqrt(K m_t). MuJoCo has no integrator that is implicit in position.

{limits}

## {count} random cases

Tool 0.02 to 2 kg, step of the engine 1 to 20 samples, T 0.5, 1 or 2 ms, delay 0 to 3 samples (whole for one half),
device 0.05 to 0.5 kg and 0.1 to 3 N.s/m, exchange drawn among the four (held-force and ahead with the damper of the
device's own loop), a quarter with implicitfast.

{random}

## Recommended pairs at a box

{boxes_said}

{boxes}

## Minimum mass

Brown and Colgate (Minimum mass for haptic display simulations, ASME IMECE 1998) derive the lightest point mass that
an explicit integrator moves passively. Their formulas are not at hand here (the abstract alone is public), so they
are neither quoted nor reproduced; what follows is derived anew from the condition of Colgate and Schenkel, b > T/2
Re((1 - 1/z) H) / (1 - cos wT), for the exchange on-time, semi-implicit Euler at T, no delay. At the Nyquist frequency
H = (K + 2 B/T) / (1 - (K T^2/4 + B T/2)/m), so that with c = B + K T/2 < b

    m > T/2 * b c / (b - c)

What a lower frequency asks for stands [beside what others published](RESULTS_published.md#the-least-mass-of-a-tool):
below B = K^2 T^2/(16 b) no mass at all is passive.

{masses}

## A wheel with a game's spring

0.05 kg.m2, 0.02 N.m.s/rad, rim 0.15 m, one sample of delay at 1 kHz; a spring of a game at 60 Hz, no tool, exchange
`held-force`, so many frames late; the damper is the wheel's own, at 1 kHz. Range of that damper (of 60 tried, 0.02 to
200 N.m.s/rad) with which hands and the released wheel are stable: by the project, and in a plain simulation of 9 s
with the step on a sample and between two.

{wheels}

Below the range the spring's delay swings the wheel up; above it the damper's own delay does, whatever the spring.
"""


def _short(value: float | None) -> str:
    return rounded(value) if value else "none"


def _page_limits(cells: dict[str, Any]) -> str:
    rows = []
    for mass in MASSES_KG:
        for rate in RATES_HZ:
            for exchange in EXCHANGES:
                one = cells.get(f"table {mass:g} {rate:g} {exchange}")
                if one is None or "error" in one:
                    continue
                row = [f"{mass:g}", f"{rate:g}", exchange]
                for name in ("semi-implicit", "implicit-damping", "implicit", "default damping"):
                    if name not in one:
                        row.append("-")
                        continue
                    value, own = one[name], f"{name} in MuJoCo"
                    limit = _short(value[0] if isinstance(value, list) else value)
                    row += [f"{limit} ({_short(one[own])})" if own in one else limit]
                rows.append(row)
    head = ("tool, kg", "engine, Hz", "exchange", "semi-implicit", "implicit-damping", "implicit", "default damping")
    return table(head, rows)


def _page_random(cells: list[dict[str, Any]]) -> str:
    some = [one for one in cells if one.get("mujoco_n_per_m") is not None]
    none = sum(one["gains"]["stiffness_n_per_m"] == 0 for one in cells)
    ratios = np.array([one["mujoco_n_per_m"] / one["gains"]["stiffness_n_per_m"] for one in some])
    if len(ratios) == 0:
        return ""
    rows = []
    for exchange in ("on-time", "late", "ahead", "held-force"):
        mine = ratios[[one["axis"]["exchange"] == exchange for one in some]]
        if len(mine):
            within = f"{int((np.abs(mine - 1) <= 0.1).sum())} of {len(mine)}"
            rows.append([exchange, within, f"{mine.min():.4f}", f"{np.median(mine):.4f}", f"{mine.max():.4f}"])
    within = int((np.abs(ratios - 1) <= 0.1).sum())
    said = (
        f"**{within} of {len(ratios)} within 10 %**; {int((np.abs(ratios - 1) <= 0.02).sum())} within 2 %. MuJoCo's "
        f"limit as a share of the project's: {ratios.min():.4f} to {ratios.max():.4f}; below 1 is the unsafe side, "
        f"worst {100 * (1 - ratios.min()):.2g} %, with {_worded(some[int(np.argmin(ratios))]['axis'])}; farthest above "
        f"1 with {_worded(some[int(np.argmax(ratios))]['axis'])}. {none} cases have no stable pair at all."
    )
    return said + "\n\n" + table(("exchange", "within 10 %", "least share", "median", "largest (1.8: or more)"), rows)


def _worded(axis: dict[str, Any]) -> str:
    return (
        f"a tool of {axis['tool_mass_kg']:g} kg at {1e3 * axis['step_s']:.3g} ms, {axis['exchange']}, on "
        f"{axis['mass_kg']:g} kg and {axis['damping_ns_per_m']:g} N.s/m with T {1e3 * axis['sample_time_s']:g} ms and "
        f"{axis['delay_samples']:g} samples of delay"
    )


def _page_boxes(cells: list[dict[str, Any]]) -> tuple[str, str]:
    rows, found = [], [one for one in cells if one.get("gains")]
    for one in found:
        axis, gains = one["axis"], one["gains"]
        number = f"{axis['tool_mass_kg']:g} kg, {1e3 * axis['step_s']:.3g} ms, {axis['exchange']}"
        rows.append(
            [
                number,
                f"{axis['mass_kg']:g} kg, {1e3 * axis['sample_time_s']:g} ms, {axis['delay_samples']:g}",
                f"{rounded(gains['stiffness_n_per_m'])} of {rounded(one['limit_n_per_m'])}",
                *(f"{one[kind]['free']} / {one[kind]['pressed']}" for kind in ("steady", "dropped", "beyond")),
                one["beyond_grows"],
                one["steady"]["contacts_broken"],
            ]
        )
    whole = sum(one["steady"]["both"] == PEOPLE for one in found)
    dropped = sum(one["dropped"]["both"] == PEOPLE for one in found)
    beyond = sum(one["beyond"]["both"] < PEOPLE or one["beyond_grows"] > 0 for one in found)
    said = (
        f"{PEOPLE} hands (corners of the box, the others drawn) swing freely, rest, tap three times a second and press "
        "with MuJoCo's default contact, without friction in the device; forces end at 10 N. Settled: device and tool "
        f"move by less than {1e6 * _REST_M:g} um together in the last half second of the rest and of the press. Of "
        f"{len(cells)} cases {len(found)} have a recommended pair; all hands settle with {whole} of them, with one "
        f"step of the engine in a hundred missed with {dropped}; with {BEYOND:g} times the stiffest K {beyond} do not "
        "hold. 'Grows' counts of 18 kicked axes (corners and released, tool free and held) at that K."
    )
    head = (
        "tool, step, exchange",
        "device, T, delay in samples",
        "K of the limit, N/m",
        "settled free / pressed",
        "with missed steps",
        f"at {BEYOND:g} times the limit",
        "grows there",
        "contacts broken, at least",
    )
    return said, table(head, rows)


def _page_masses(cells: list[dict[str, Any]]) -> str:
    if not cells:
        return ""
    ratios = np.array([one["by_frequencies_kg"] / one["closed_form_kg"] for one in cells])
    numbers = np.array([one["numbers"] for one in cells])
    shares = numbers[:, 1] / (numbers[:, 1] + numbers[:, 0] * numbers[:, 3] / 2)  # of B in c
    same = ratios < 1.001
    stable = sum(one["stable_there"] for one in cells)
    lighter = [one["unstable_below_kg"] / one["by_frequencies_kg"] for one in cells]
    least, most = ratios[~same].min(initial=np.inf), ratios[~same].max(initial=0.0)
    others = (
        f" In the others, all with B below {shares[~same].max(initial=0.0):.2g} c, a lower frequency asks for more: "
        f"{least:.3g} to {most:,.0f} times as much; the form above is necessary there, and not enough."
    )
    return (
        f"{len(cells)} random K, B, b and T with c between 0.05 and 0.9 b, bisected over 4000 frequencies: with "
        f"{same.sum()} it is the mass of the closed form within 0.1 %, the least B among them being "
        f"{shares[same].min():.2g} c."
        + ("" if same.all() else others)
        + f" The project finds {stable} of {len(cells)} "
        "stable with the mass by frequencies, as it must: what is passive is stable with every hand. The lightest tool "
        f"that is stable with the default hands (device 0.12 kg) is {min(lighter):.2g} to {max(lighter):.2g} times as "
        f"heavy (median {np.median(lighter):.2g})."
    )


def _page_wheels(cells: dict[str, Any]) -> str:
    def told(ends: list[float] | None) -> str:
        return "none" if ends is None else f"{ends[0]:.3g} to {ends[1]:.3g}"

    rows = []
    for spring in SPRINGS_NM_PER_RAD:
        for frames in FRAMES:
            one = cells.get(f"wheel {spring:g} {frames}")
            if one is not None and "error" not in one:
                given = "none" if one["recommended"] is None else f"{one['recommended']:.3g}"
                rows.append([f"{spring:g}", frames, told(one["project"]), told(one["simulated"]), one["apart"], given])
    head = (
        "spring, N.m/rad",
        "frames late",
        "stable dampers, project",
        "simulated",
        "of 60 judged otherwise",
        "recommended",
    )
    return table(head, rows)


def write_page(document: dict[str, Any]) -> None:
    cells = document["cells"]

    def of(kind: str) -> list[dict[str, Any]]:
        return [one for name, one in cells.items() if name.startswith(kind) and "error" not in one]

    boxes_said, boxes = _page_boxes(of("box"))
    failed = [f"- {name}: {one['error']}" for name, one in cells.items() if "error" in one]
    text = TEXT.format(
        made_by=made_by(document["about"]),
        limits=_page_limits(cells),
        count=len(of("random")),
        random=_page_random(of("random")),
        boxes_said=boxes_said,
        boxes=boxes,
        masses=_page_masses(of("mass")),
        wheels=_page_wheels(cells),
    )
    PAGE.write_text(
        text + ("\n## Cells that ended with an error\n\n" + "\n".join(failed) + "\n" if failed else ""),
        encoding="utf-8",
    )


def main() -> None:
    script_arguments(__doc__)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    told = about("python tests/benchmarks/engine_boundaries.py", SEED)
    told["versions"]["mujoco"] = version("mujoco")
    computed(cells(), OUT, told, write_page)


if __name__ == "__main__":
    main()
