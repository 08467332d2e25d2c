"""Do the searches of ranges find the worst point? Walls, engines, followers drawn at random against a dense search.

OPENBLAS_NUM_THREADS=1 python tests/benchmarks/ranges.py 500 --write

The loops are of tests/oracle/loops_by_expm.py; of the package only its limits and radii are used. A row is refuted
where a point grows faster than was told at a share of the limit, by 1e-6 a ms, or is unstable at 0.99 of the limit.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, kept_rows, write_rows

sys.path[:0] = [str(Path(__file__).parents[1] / "oracle")]

from loops_by_expm import growth  # noqa: E402 - an oracle of the tests

from avc_casadi.claims.law_analysis import LawAnalysis, SpringDamper  # noqa: E402
from avc_casadi.design.virtual_tool import CouplingSearch, Scale  # noqa: E402
from avc_casadi.loops.engine import ToolLoops  # noqa: E402
from avc_casadi.loops.follower import FollowerLoops  # noqa: E402
from avc_casadi.model.ends import ToolGains  # noqa: E402
from avc_casadi.model.problem import Problem  # noqa: E402

SEED, OUT = 91, Path(__file__).parent / "results" / "ranges.json"
DEVICE = {"mass_kg": (0.03, 0.5), "damping_ns_per_m": (0.1, 5.0), "delay_samples": (0.1, 3.0)}
MODE = {"frequency_hz": (40.0, 400.0), "damping_ratio": (0.005, 0.1), "mass_ratio": (0.1, 0.6)}
HAND = {"mass_kg": (0.02, 2.0), "damping_ns_per_m": (1.0, 60.0), "stiffness_n_per_m": (50.0, 3000.0)}
Box = dict[str, tuple[float, float]]


class Draw:
    """Tables of a problem with ranges, drawn at random."""

    def __init__(self, number: int) -> None:
        self.random, self.kind = np.random.default_rng([SEED, number]), number % 3

    def values(self, spans: Box) -> dict[str, Any]:
        """Return values between the ends, by their logarithm."""
        return {key: float(f"{low * (high / low) ** self.random.random():.3g}") for key, (low, high) in spans.items()}

    def about(self, values: dict[str, float], most: float, often: float) -> dict[str, Any]:
        """Return ranges about some of the values."""
        factors = {key: self.random.uniform(1.05, most) for key in values if self.random.random() < often}
        return {
            key: [round(values[key] / factor, 6), round(values[key] * factor, 6)] for key, factor in factors.items()
        }

    def device(self, often: float) -> dict[str, Any]:
        """Return a device; often: how many of its values have a range."""
        values, chance = self.values(DEVICE), self.random.random(3)
        if chance[0] < 0.4:
            values["delay_samples"] = round(values["delay_samples"])
        known = self.about({key: values[key] for key in DEVICE if values[key]}, 1.7, often)
        if chance[1] < 0.4:
            values["resonance"] = self.values(MODE)
            known["resonance"] = self.about(values["resonance"], 1.5, often)
        if chance[2] < 0.3:
            values |= (slow := self.values({"amplifier_bandwidth_hz": (100.0, 2000.0)}))
            known |= self.about(slow, 1.7, often)
        return values | {"range": known}

    def tables(self) -> dict[str, Any]:
        """Return the problem."""
        made = {
            "hands": self.about(self.values(HAND), 3.0, 1.0),
            "device": self.device(0.15 if self.kind == 2 else 0.4),
        }
        top, step_s = round(10 ** self.random.uniform(1.7, 4.0)), 1e-3 * int(self.random.choice([1, 2, 4, 8, 10, 16]))
        spring = {"contact_stiffness_n_per_m": [0.1 * top, top], "contact_damping_ns_per_m": [0.5, 2.0]}
        if self.kind == 0:
            return made | {"environment": {"stiffness_n_per_m": 1000.0, "damping_ns_per_m": 0.0}}
        if self.kind == 2:
            return made | {"follower": self.device(0.15) | spring | {"delay_s": 1e-3 * int(self.random.integers(0, 9))}}
        how = str(self.random.choice(["semi-implicit", "explicit", "implicit-damping", "implicit"]))
        tool = self.about(self.values({"tool_mass_kg": (0.03, 1.0)}), 2.0, 1.0)
        tool |= spring if how != "explicit" and top * step_s**2 < 0.5 * tool["tool_mass_kg"][0] else {}
        exchange = str(self.random.choice(["on-time", "late"]))
        return made | {"simulation": {"integrator": how, "step_s": step_s, "exchange": exchange} | tool}


def ranges(device: dict[str, Any], before: str = "") -> Box:
    """Return the ends of all values of a device that its loop knows."""
    known = device["range"]
    ends = {key: known.get(key, [device[key]] * 2) for key in (*DEVICE, "amplifier_bandwidth_hz") if key in device}
    for key, value in device.get("resonance", {}).items():
        ends[f"resonance.{key}"] = known["resonance"].get(key, [value] * 2)
    return {before + key: (low, high) for key, (low, high) in ends.items()}


def boxes(tables: dict[str, Any]) -> Iterator[tuple[Box, dict[str, Any]]]:
    """Yield the ranges of every kind of hand and contact and of every phase of the clocks, and what is set."""
    tool, other = tables.get("simulation", {}), tables.get("follower", {})
    far, box, end, late = tool or other, ranges(tables["device"]), {}, round(1e3 * other.get("delay_s", 0.0))
    if tool:
        end = {
            "samples": round(1e3 * tool["step_s"]),
            "integrator": tool["integrator"],
            "late": tool["exchange"] == "late",
        }
        box["tool.mass_kg"] = tuple(tool["tool_mass_kg"])
    box |= ranges(other, "follower.") if other else {}
    box["contact.damping_ns_per_m"] = tuple(far.get("contact_damping_ns_per_m", (0.0, 0.0)))
    springs = [(0.0, 0.0), far.get("contact_stiffness_n_per_m", (math.inf, math.inf))] if far else [(0.0, 0.0)]
    for held, contact, phase in itertools.product((1, 0), springs, (0, 1) if other else (0,)):
        hand = {f"hand.{key}": (held * low, held * high) for key, (low, high) in tables["hands"].items()}
        ages = {"ages": (late + phase, late)} if other else {}
        yield box | hand | {"contact.stiffness_n_per_m": tuple(contact)}, end | ages


def fastest(box: Box, end: dict[str, Any], gains: tuple[float, float]) -> float:
    """Return the fastest growth at corners, faces and points inside, then at ever nearer draws about the fastest."""
    random, sides = np.random.default_rng(7), [key for key, (low, high) in box.items() if high > low]

    def at(shares: Any) -> Any:
        found = {key: np.full(len(shares), low) for key, (low, _) in box.items()}
        for key, share in zip(sides, shares.T, strict=True):
            found[key] = box[key][0] * (box[key][1] / box[key][0]) ** share
        return growth(found, gains, **end)

    shares = random.random((1500, len(sides)))
    shares = np.where(random.random(shares.shape) < 0.5, np.round(shares), shares)
    values = at(shares)
    for turn in range(22):
        best = np.argsort(-values)[: 30 if turn < 4 else 8]
        near = np.repeat(shares[best], 6 if turn < 4 else 16, axis=0)
        moves = random.normal(size=near.shape) * (random.random(near.shape) < 0.6) * 0.25 * 0.7**turn
        near = np.clip(near + moves, 0.0, 1.0)
        shares, values = np.concatenate([shares[best], near]), np.concatenate([values[best], at(near)])
    return float(values.max())


def judged(tables: dict[str, Any], share: float, damper: float) -> dict[str, Any]:
    """Return what the package told of a problem, and what the dense search found; damper: b of a wall, else B/K."""
    problem = Problem(**tables)
    if problem.environment is not None and not (problem.simulation or problem.follower):
        analysis = LawAnalysis(problem)
        (_, k), lag_s = analysis.stiffness_range(SpringDamper(1.0, damper)) or (0.0, 0.0), 0.0
        told = (
            max(analysis.case(SpringDamper(share * k, damper), side).spectral_radius for side in analysis.sides)
            if k
            else 1.0
        )
    else:
        every: Any = ToolLoops(problem) if problem.simulation else FollowerLoops(problem)
        search, k, lag_s, damper = CouplingSearch(every, Scale.of(problem, 2e-3)), 0.1, damper, 0.0
        while search.gain_margin(ToolGains(4 * k, 4 * k * lag_s)) and k < 1e6:
            k *= 4
        k *= search.gain_margin_over_ranges(ToolGains(k, k * lag_s))
        step_s = getattr(problem.simulation, "step_s", [1e-3])[0]
        told = every.radius(ToolGains(share * k, share * k * lag_s))[0] ** (1e-3 / step_s) if k else 1.0
    if not k:
        return {"limit_n_per_m": 0.0, "refuted": False}
    found, near = (max(fastest(*one, (f * k, damper + f * k * lag_s)) for one in boxes(tables)) for f in (share, 0.99))
    refuted = bool(found > told + 1e-6 or near > 1 + 1e-9)
    return {"limit_n_per_m": k, "share": share, "told": told, "found": found, "at_0.99": near, "refuted": refuted}


def row(number: int) -> dict[str, Any]:
    """Return one problem's row."""
    draw = Draw(number)
    tables, share = draw.tables(), draw.random.uniform(0.6, 0.98)
    damper = 10 ** (draw.random.uniform(-1, 1.5) if draw.kind == 0 else draw.random.uniform(-3.3, -1.7))
    sides = max(sum(high > low for low, high in box.values()) for box, _ in boxes(tables))
    return {"number": number, "kind": ("wall", "engine", "follower")[draw.kind], "sides": sides} | judged(
        tables, share, damper
    )


def main() -> None:
    """Compute the rows that the file does not hold yet."""
    arguments = script_arguments(__doc__, people=500, results=OUT)
    stated = about("OPENBLAS_NUM_THREADS=1 python tests/benchmarks/ranges.py 500 --write", SEED)
    rows = kept_rows(OUT, stated)
    for number in range(len(rows), arguments.people):
        rows.append(row(number))
        print(rows[-1], flush=True)
        if arguments.write:
            write_rows(OUT, stated, rows)


if __name__ == "__main__":
    main()
