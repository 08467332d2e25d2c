"""[simulation] against real engines: limits, and recommended pairs at a box.

OPENBLAS_NUM_THREADS=1 nice -n 10 python tests/benchmarks/engine_boundaries.py

Needs MuJoCo (`pip install "avc-casadi[engines]"`). Device with hand, coupling and exchange are simulated by
engine_axes.py, which shares nothing with the project; MuJoCo moves the tools. Overwrites
results/engine_boundaries.json and the numbers of its page after every cell, and goes on where it stopped.
"""

from __future__ import annotations

import math
import os
import re
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
from avc_casadi.model.ends import ToolGains, whole_samples
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.problem import Problem

SEED = 5207
OUT = Path(__file__).parent / "results" / "engine_boundaries.json"
PAGE = Path(__file__).parent / "RESULTS_engine_boundaries.md"

RANDOM, BOXES, PEOPLE = 20, 4, 200
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
        # The axis starts every step of the engine at the first sample from then on.
        "clock": "device" if whole_samples(axis.step_s, axis.sample_time_s) else "own",
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
    limit = answer.pair.stiffest  # type: ignore[union-attr] - of a tool there is one
    told: dict[str, Any] = {
        "axis": vars(axis),
        "reason": answer.reason,
        "limit_n_per_m": limit.stiffness_n_per_m,
    }
    if answer.coupling is None:
        return told | {"gains": None}
    gains, random = answer.coupling.gains, np.random.default_rng([SEED, index, 1])
    ends = corners(problem)[:-1]
    hands = np.concatenate([ends, random.uniform(ends.min(axis=0), ends.max(axis=0), (PEOPLE - len(ends), 3))])
    beyond = replace(limit, stiffness_n_per_m=BEYOND * limit.stiffness_n_per_m)
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


def cells() -> dict[str, Callable[[], dict[str, Any]]]:
    """Return every cell by name."""
    found: dict[str, Callable[[], dict[str, Any]]] = {}
    found |= {f"random {index}": partial(random_cell, index) for index in range(RANDOM)}
    found |= {f"box {index}": partial(box_cell, index) for index in range(BOXES)}
    return found


def limits_text(cells: list[dict[str, Any]]) -> str:
    """Return how MuJoCo's limits compare with the project's, all and by exchange."""
    able = [cell for cell in cells if cell.get("gains") is not None]
    shares = {
        kind: np.array(
            [
                cell["mujoco_n_per_m"] / cell["gains"]["stiffness_n_per_m"]
                for cell in able
                if cell["axis"]["exchange"] == kind
            ]
        )
        for kind in ("on-time", "late", "ahead", "held-force")
    }
    every = np.concatenate([*shares.values()])
    rows = []
    for kind, share in shares.items():
        spread = [f"{value:.4f}" for value in (share.min(), np.median(share), share.max())]
        rows.append((kind, f"{np.count_nonzero(abs(share - 1) < 0.1)} of {share.size}", *spread))
    head = ("exchange", "within 10 %", "least share", "median", "largest (1.8: or more)")
    return (
        f"**{np.count_nonzero(abs(every - 1) < 0.1)} of {every.size} within 10 %**, "
        f"{np.count_nonzero(abs(every - 1) < 0.02)} within 2 %. MuJoCo's limit as a share of the project's: "
        f"{every.min():.4f} to {every.max():.4f}; below 1 is the unsafe side. {len(cells) - len(able)} cases have no "
        f"stable pair at all.\n\n{table(head, rows)}\n"
    )


def boxes_text(cells: list[dict[str, Any]]) -> str:
    """Return how many hands settle with the recommended pairs, and beyond the limit."""
    able = [cell for cell in cells if cell["gains"] is not None]
    settle = {key: sum(cell[key]["both"] == PEOPLE for cell in able) for key in ("steady", "dropped")}
    beyond = sum(cell["beyond"]["both"] < PEOPLE or cell["beyond_grows"] > 0 for cell in able)
    rows = []
    for cell in able:
        axis, counts = cell["axis"], [f"{cell[key]['free']} / {cell[key]['pressed']}" for key in _RUNS]
        tool = f"{axis['tool_mass_kg']} kg, {1e3 * axis['step_s']:g} ms, {axis['exchange']}"
        device = f"{axis['mass_kg']} kg, {1e3 * axis['sample_time_s']:g} ms, {axis['delay_samples']:g}"
        limit = f"{rounded(cell['gains']['stiffness_n_per_m'])} of {rounded(cell['limit_n_per_m'])}"
        rows.append((tool, device, limit, *counts, cell["beyond_grows"], cell["steady"]["contacts_broken"]))
    head = ("tool, step, exchange", "device, T, delay in samples", "K of the limit, N/m", "settled free / pressed")
    head += ("with missed steps", "at 1.3 times the limit", "grows there", "contacts broken, at least")
    return (
        f"Of {len(cells)} cases {len(able)} have a recommended pair. All hands settle with {settle['steady']} of them, "
        f"with one step of the engine in a hundred missed with {settle['dropped']}. With 1.3 times the stiffest K "
        f"{beyond} are unstable.\n\n{table(head, rows)}\n"
    )


_RUNS = ("steady", "dropped", "beyond")


def write_page(document: dict[str, Any]) -> None:
    """Put the numbers into the page between its marks, and with what they were made."""
    groups = {
        kind: [cell for name, cell in document["cells"].items() if name.startswith(kind)] for kind in ("random", "box")
    }
    if not all(groups.values()):
        return
    text = re.sub(
        "^Made by .*$", made_by(document["about"]), PAGE.read_text(encoding="utf-8"), count=1, flags=re.MULTILINE
    )
    for kind, written in (("random", limits_text(groups["random"])), ("box", boxes_text(groups["box"]))):
        begin, end = f"<!-- {kind} -->\n", "<!-- end -->"
        before, _, rest = text.partition(begin)
        text = f"{before}{begin}{written}{end}{rest.partition(end)[2]}"
    PAGE.write_text(text, encoding="utf-8")


def main() -> None:
    script_arguments(__doc__)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    told = about("python tests/benchmarks/engine_boundaries.py", SEED)
    told["versions"]["mujoco"] = version("mujoco")
    computed(cells(), OUT, told, write_page)


if __name__ == "__main__":
    main()
