"""The two contact laws on the same hands: who comes to rest, how soon, what is felt, what is felt before the surface.

python tests/benchmarks/clip_last.py [PEOPLE] [OUT]

Every coupling runs gated and clip-last with the same people in a press, taps and a hold, without and with encoder,
observer, filters and delay; then the reference devices in a simulator of its own, with the exported C of both laws.
PEOPLE are tried in each cell; the stiff wall of figure 5 gets fifty times as many. Overwrites OUT (default
tests/benchmarks/results/clip_last.json) and RESULTS_clip_last.md beside this file after every cell; what OUT holds
already is not computed again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from robust_goals import GOALS, rested
from studies.designs import design
from studies.reach import with_observer
from whole_device import WholeDevice, people

import avc_casadi as avc
import avc_hardware
from avc_casadi.coupling import Coupling
from avc_casadi.design.tuning import tuned
from avc_casadi.model.effects import NotchEffect
from avc_casadi.model.gains import Gains
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.model.velocity_keys import VelocityFilterEffect
from avc_casadi.simulation.judge import Judgement
from avc_casadi.simulation.population.motions import MOTIONS
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.population.trial import Conditions, Traces, traces

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "clip_last.json"
LAWS = ("gated", "clip-last")
SEED = 77
MANY = 50
MOVING_M_PER_S = 5e-3
WALLS = ("ve2", "ve3", "ve4", "ve5", "ve6", "ve7")
DESIGNS = ("static", "static-tuned", "schedule")
FILTERS = {
    "velocity filter 300 Hz": VelocityFilterEffect(cutoff_hz=300.0),
    "notch 150 Hz": NotchEffect(frequency_hz=150.0, depth=0.3, width=0.5),
}

Gained = Gains | GainSchedule


@dataclass(frozen=True)
class Case:
    """What both laws run.

    Attributes:
        problem: device and wall.
        gains: of the coupling.
        conditions: what of the device is simulated.
    """

    problem: Problem
    gains: Gained
    conditions: Conditions


def with_law(problem: Problem, law: str) -> Problem:
    return problem.changed(coupling={"contact": law})


def figures(part: Traces) -> dict[str, np.ndarray]:
    """What is told of each person's run, each of shape (people,)."""
    x, v, force, t = part.position_m, part.velocity_m_per_s, part.force_n, part.sample_time_s
    count = x.shape[1]
    moving = np.abs(v) >= MOVING_M_PER_S
    last = np.where(moving.any(axis=1), count - 1 - moving[:, ::-1].argmax(axis=1), 0)
    inside = x > 0
    first = np.where(inside.any(axis=1), inside.argmax(axis=1), count)
    outside = (x <= 0) & (force > 1e-9)
    return {
        "settling_s": np.maximum(last - first + 1, 0) * t,
        "peak_force_n": force.max(axis=1),
        "before_m": np.where(outside, -x, 0.0).max(axis=1),
        "force_before_n": np.where(outside, force, 0.0).max(axis=1),
    }


def tried(case: Case, law: str, count: int) -> dict[str, dict[str, np.ndarray]]:
    """Everybody in every motion: judgement and figures by motion, each of shape (people,)."""
    subjects = draw_population("A", count, SEED)
    found = {}
    for name, motion in MOTIONS.items():
        parts = []
        for part in traces(with_law(case.problem, law), case.gains, subjects, motion, case.conditions):
            told: Judgement = part.judged()
            felt = {key: vars(told)[key] for key in ("stable", "buzzing", "apparent_stiffness_n_per_m")}
            parts.append(felt | figures(part))
        found[name] = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    return found


def cell(case: Callable[[], Case | None], count: int) -> dict[str, Any]:
    """Compare both laws on the same people."""
    made = case()
    if made is None:
        return {"no_gains": True}
    runs = {law: tried(made, law, count) for law in LAWS}
    wall = made.problem.environment.stiffness_n_per_m
    rest = {law: np.all([one["stable"] for one in run.values()], axis=0) for law, run in runs.items()}
    both = rest["gated"] & rest["clip-last"]
    document: dict[str, Any] = {"people": count, "both": int(both.sum())}
    for law, run in runs.items():
        press, tap = run["press"], run["tap"]
        settled, share = press["settling_s"][both], press["apparent_stiffness_n_per_m"][both] / wall
        document[law] = {
            "at_rest": int(rest[law].sum()),
            "interval": exact_interval(int(rest[law].sum()), count),
            "by_motion": {name: int(one["stable"].sum()) for name, one in run.items()},
            "only_here": int((rest[law] & ~both).sum()),
            "buzzing": int(np.any([one["buzzing"] for one in run.values()], axis=0).sum()),
            "settling_s": quantiles(settled),
            "peak_press_n": quantiles(press["peak_force_n"][both]),
            "peak_tap_n": quantiles(tap["peak_force_n"][both]),
            "stiffness_share": quantiles(share),
            "before_m": float(max(one["before_m"].max() for one in run.values())),
            "force_before_n": float(max(one["force_before_n"].max() for one in run.values())),
        }
    return document


def quantiles(values: np.ndarray) -> list[float] | None:
    """Median and largest; None where nobody is left."""
    return [float(np.nanmedian(values)), float(np.nanmax(values))] if np.isfinite(values).any() else None


@cache
def designed(wall: str, name: str, delay: float = 0.0) -> Case | None:
    problem = avc.load_problem(wall).changed(device={"delay_samples": delay})
    found = design(problem, name)
    return None if found.gains is None else Case(problem, found.in_force, Conditions(delay_samples=delay))


@cache
def stiff(scheduled: bool) -> Case:
    problem = avc.load_problem("ve7")
    return Case(problem, tuned(problem, scheduled=scheduled, margin_ns_per_m=6.0), Conditions())


@cache
def solved(name: str, method: str) -> Case | None:
    problem = avc.load_problem(name)
    gains = avc.solve(problem, method)
    return Case(problem, gains, Conditions()) if gains.usable.any() else None


@cache
def recommended(name: str) -> Coupling:
    return avc.recommend(name).coupling


def as_it_is(coupling: Coupling, conditions: Conditions) -> Case:
    constant = coupling.table.constant
    return Case(coupling.problem, coupling.table.at_rest if constant else coupling.schedule, conditions)


def on(case: Callable[[], Case | None], **changed: Any) -> Callable[[], Case | None]:
    """The same under other conditions."""

    def made() -> Case | None:
        found = case()
        return found and replace(found, conditions=replace(found.conditions, **changed))

    return made


def observed(case: Callable[[], Case | None], encoder_m: float) -> Callable[[], Case | None]:
    """The same behind an encoder with the observer."""

    def made() -> Case | None:
        found = case()
        if found is None:
            return None
        coarse = replace(found.conditions, encoder_m=encoder_m)
        return replace(found, conditions=with_observer(found.problem, coarse))

    return made


def cells(count: int) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
    def told(case: Callable[[], Case | None], times: int = 1) -> Callable[[], dict[str, Any]]:
        return lambda: cell(case, times * count)

    for wall in WALLS:
        for name in DESIGNS:
            case = lambda wall=wall, name=name: designed(wall, name)  # noqa: E731
            yield f"{wall} | {name} | no encoder", told(case)
            yield f"{wall} | {name} | 2 um", told(on(case, encoder_m=2e-6))
            yield f"{wall} | {name} | 20 um, observer", told(observed(case, 20e-6))
        constant = lambda wall=wall: designed(wall, "static-tuned")  # noqa: E731
        yield f"{wall} | static-tuned | 20 um", told(on(constant, encoder_m=20e-6))
        for name, effect in FILTERS.items():
            yield f"{wall} | static-tuned | {name}", told(on(constant, others=(effect,)))
    for wall in WALLS[:3]:
        for name in DESIGNS[1:]:
            yield f"{wall} | {name} | delay of 1 sample", told(lambda wall=wall, name=name: designed(wall, name, 1.0))
    for name, method in (("soft", "direct"), ("soft", "static"), ("spring", "static"), ("figure5", "static")):
        yield f"{name} | {method} | no encoder", told(lambda name=name, method=method: solved(name, method))
    for scheduled in (False, True):
        name = "schedule" if scheduled else "static-tuned"
        case = lambda scheduled=scheduled: stiff(scheduled)  # noqa: E731
        yield f"figure5, margin 6 | {name} | no encoder", told(case, MANY)
        yield f"figure5, margin 6 | {name} | 20 um, observer", told(observed(case, 20e-6), MANY)
    whole = lambda: recommended("figure5")  # noqa: E731
    declared = lambda: as_it_is(whole(), Conditions.of(whole()))  # noqa: E731
    smooth = lambda: as_it_is(whole(), Conditions.of(whole()).without_friction())  # noqa: E731
    yield "figure5 | recommended | as declared", told(declared, MANY)
    yield "figure5 | recommended | without friction", told(smooth, MANY)
    for name, (wall, _) in GOALS.items():
        yield f"{name} | recommended | exported C", lambda name=name, wall=wall: device(name, wall, count)


def device(name: str, wall: float, count: int) -> dict[str, Any]:
    """A reference device that runs the exported C of both laws, in a simulator that shares no code with the project."""
    problem = avc.load_problem(name).changed(environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0})
    hands = people(problem.hands, count - 8, SEED)
    document: dict[str, Any] = {"people": len(hands), "wall_n_per_m": wall}
    for designed_for in LAWS:
        coupling = avc.recommend(with_law(problem, designed_for)).coupling
        for law in LAWS:
            made = coupling.on(with_law(problem, law))
            bench = WholeDevice(problem.device, avc_hardware.export_c(made, unsafe=True))
            for key, friction in (("friction", {}), ("no friction", {"friction": 0.0})):
                share, motor, handle = rested(bench, hands, **friction)
                document[f"designed {designed_for}, runs {law}, {key}"] = {
                    "at_rest": round(share * len(hands)),
                    "interval": exact_interval(round(share * len(hands)), len(hands)),
                    "felt_motor_n_per_m": motor,
                    "felt_handle_n_per_m": handle,
                }
    return document


def write_page(document: Mapping[str, Any]) -> None:
    kept = document["cells"]
    laws, devices, nothing = [], [], []
    for name, one in kept.items():
        if "error" in one or "no_gains" in one:
            nothing.append(f"- {name}: {one.get('error', 'no gains')}")
        elif "wall_n_per_m" in one:
            devices += [(name.split(" | ")[0], *row) for row in _device_rows(one)]
        else:
            laws.append((*name.split(" | "), *_law_row(one)))
    text = _PAGE.format(
        made_by=made_by(document["about"]),
        laws=table(_LAW_HEAD, laws),
        devices=table(_DEVICE_HEAD, devices),
        only_gated=sum(one["gated"]["only_here"] for one in kept.values() if "gated" in one),
        only_clip_last=sum(one["clip-last"]["only_here"] for one in kept.values() if "clip-last" in one),
    )
    if nothing:
        text += "\n## Cells without a comparison\n\n" + "\n".join(nothing) + "\n"
    (HERE / "RESULTS_clip_last.md").write_text(text, encoding="utf-8")


_PAGE = """\
# Two contact laws on the same hands

{made_by}

Gated: the coupling acts on the tool's penetration, and only where the device is in the wall. Clip-last: F = max(0, y),
y the force of the same coupling to a wall on both sides. Set A; press, tap and hold, 3 s each. **At rest**: below
5 mm/s at the end of all three (exact 95 % interval). The other figures are of those who rest under both laws.
**Settling**: from the first sample in the wall to the last above 5 mm/s, press. **Peak**: largest force. **Stiffness**:
of the press, as a share of the wall's. Of each median and largest. **Before the surface**: the farthest place at which
clip-last pushes, and the largest force there, in any motion. No friction unless the row says so. `direct` for `spring`
and `figure5` has rows without a spring: those tables are gated, whatever is asked for.

At rest under one law alone, over all cells: {only_gated} gated, {only_clip_last} clip-last.

{laws}

## Reference devices, exported C

The walls of `robust_goals.py` that lean on friction, in `tests/whole_device.c`: press, taps and a strike, all at rest.
Each law runs the coupling that `recommend` finds under it, and that of the other. These couplings are a spring alone
behind their observer: without a damper both laws are the same force.

{devices}
"""
_LAW_HEAD = (
    "wall",
    "coupling",
    "conditions",
    "people",
    "at rest, gated",
    "clip-last",
    "settling, ms: median, largest; gated",
    "clip-last",
    "peak of a press, N; gated",
    "clip-last",
    "of a tap, N; gated",
    "clip-last",
    "stiffness, share; gated",
    "clip-last",
    "before the surface, mm",
    "N",
)
_DEVICE_HEAD = ("device", "coupling and law", "at rest", "95 %", "felt at the motor, N/m", "at the handle, N/m")


def _law_row(one: Mapping[str, Any]) -> list[str]:
    gated, clipped = one["gated"], one["clip-last"]
    row = [str(one["people"])]
    for law in (gated, clipped):
        low, high = (100 * end for end in law["interval"])
        row.append(f"{law['at_rest']} ({low:.1f}-{high:.1f} %)")
    for key, factor, digits in (
        ("settling_s", 1e3, 3),
        ("peak_press_n", 1.0, 3),
        ("peak_tap_n", 1.0, 3),
        ("stiffness_share", 1.0, 3),
    ):
        row += [
            "-" if law[key] is None else ", ".join(rounded(factor * value, digits) for value in law[key])
            for law in (gated, clipped)
        ]
    return [*row, rounded(1e3 * clipped["before_m"], 2), rounded(clipped["force_before_n"], 2)]


def _device_rows(one: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    for name, found in one.items():
        if isinstance(found, Mapping) and "interval" in found:
            low, high = (100 * end for end in found["interval"])
            felt = (rounded(found[f"felt_{where}_n_per_m"]) for where in ("motor", "handle"))
            yield name, str(found["at_rest"]), f"{low:.1f}-{high:.1f} %", *felt


def main() -> None:
    arguments = script_arguments(__doc__, people=200, out=RESULTS)
    told = about(f"python tests/benchmarks/clip_last.py {arguments.people}", SEED)
    computed(dict(cells(arguments.people)), arguments.out, told, write_page)


if __name__ == "__main__":
    main()
