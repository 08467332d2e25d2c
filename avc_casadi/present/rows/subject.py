"""Parts of answers: a problem in a line, gains with their spans, limits, what is declared and not used."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from avc_casadi.files.catalogue import catalogue_names
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.present.row import Answer, Mark, Part, Quantity, Row, Value, count, listed, parts, row, span

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# A spring so many times stiffer than the wall renders the wall itself.
_RIGID = 100.0
# A force this near to its limit is at it.
_AT_LIMIT = 0.97
HAND: tuple[tuple[str, Quantity], ...] = (
    ("mass_kg", "mass"),
    ("damping_ns_per_m", "damping"),
    ("stiffness_n_per_m", "stiffness"),
)
"""Numbers of a hand."""


def name_of(problem: Problem) -> str:
    """Return the problem as a user types it: a name of the catalogue, or a file."""
    return problem.name if problem.name in catalogue_names() else f"{problem.name or 'problem'}.toml"


def headline(problem: Problem, shown: str) -> tuple[Part, ...]:
    """Return a problem in a line: what is rendered, and the device."""
    device, wall, tool, follower = problem.device, problem.environment, problem.simulation, problem.follower
    rate = Value(1 / device.sample_time_s, "frequency")
    of_device = ("device", Value(device.mass_kg, "mass"), ",", rate, ", delay", Value(device.delay_samples, "samples"))
    if tool is not None:
        what = ("fixed place",) if tool.tool_mass_kg is None else ("tool", *span(tool.tool_mass_kg, "mass"))
        late = f", {tool.steps_late} steps late" if tool.steps_late else ""
        rates = span([1 / step for step in tool.step_s], "frequency")
        return parts(shown, " ", what, "at", rates, f", {tool.integrator}, {tool.exchange}{late}", "·", of_device)
    if follower is not None:
        far = Value(follower.mass_kg, "mass"), ",", Value(1 / follower.sample_time_s, "frequency")
        delay = Value(follower.delays_s[-1][0], "time")
        return parts(shown, "  follower", far, ",", delay, f"away, {follower.architecture}", "·", of_device)
    stiffness, damping = Value(wall.stiffness_n_per_m, "stiffness"), Value(wall.damping_ns_per_m, "damping")
    rendered = listed(one for one in (stiffness, damping) if one.number)
    return parts(shown, "  wall", rendered or "none", "·", of_device)


def answer(
    kind: str,
    data: Mapping[str, Any],
    problem: Problem,
    shown: str,
    rows: Iterable[Row],
    onwards: Iterable[str] = (),
    complaint: str = "",
) -> Answer:
    """Return the answer to a question about a problem."""
    title = headline(problem, shown)
    return Answer(kind, data, title, tuple(rows), tuple(onwards), problem.units, complaint=complaint)


def gains(table: Mapping[str, Sequence[float | None]], problem: Problem) -> tuple[Part, ...]:
    """Return the gains of a table with their spans."""
    keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
    b, k, b_p = ([one for one in table[key] if one is not None] for key in keys)
    contact = ("contact damper b_p", span(b_p, "damping")) if max(b_p, default=0.0) > 0 else None
    if not k:
        return listed([contact, "no spring"])
    if min(k) >= _RIGID * problem.environment.stiffness_n_per_m:
        return listed([contact, "wall rendered directly"])
    damper = ("damper b", span(b, "damping")) if max(b, default=0.0) > 0 else None
    return listed([contact, ("spring k", span(k, "stiffness")), damper])


def pair(gains: Mapping[str, Any], local: str = "damper in the device's loop") -> tuple[Part, ...]:
    """Return spring and dampers of a coupling to another end."""
    own = gains["local_damping_ns_per_m"]
    return listed(
        [
            ("spring K", Value(gains["stiffness_n_per_m"], "stiffness")),
            ("damper B", Value(gains["damping_ns_per_m"], "damping")) if gains["damping_ns_per_m"] else None,
            (local, Value(own, "damping")) if own else None,
        ]
    )


def hand(values: Mapping[str, float]) -> tuple[Part, ...]:
    """Return a hand by its numbers; all 0 for the device released."""
    if not any(values.values()):
        return ("device released",)
    return ("hand of", *listed(Value(values[key], of) for key, of in HAND))


def passive_limit(limit_n_per_m: float | None) -> Row:
    """Return the largest static stiffness of any passive linear rendering: 2 b_d/((1 + d) T) at the worst of ranges."""
    if limit_n_per_m is None or math.isnan(limit_n_per_m):
        return row("Passive limit", "known for a rigid device, ideal amplifier and whole samples of delay only")
    if limit_n_per_m == 0:
        return row("Passive limit", "none: no damping of the device is declared")
    return row("Passive limit", Value(limit_n_per_m, "stiffness"), "static for any passive linear rendering")


def thin(disk_margin: float | None) -> str:
    """Return what is to be said of a disk margin; empty where it is sound or not known."""
    if disk_margin is None or disk_margin >= SOUND_DISK:
        return ""
    return f"; disk margin {disk_margin:.2g}, {f'below {LEAST_DISK}' if disk_margin < LEAST_DISK else 'thin'}"


def deployable(verdict: Mapping[str, Any] | None) -> Row:
    """Return the verdict on deployment: the claims that hold, or the first that fails."""
    if verdict is None:
        return row("Deployable", "no: no row has gains", mark=Mark.FAIL)
    if verdict["pass"]:
        doubt = thin(verdict.get("disk_margin"))
        said = f"yes: linearly stable with every corner hand and released{doubt}"
        return row("Deployable", said, mark=Mark.CAUTION if doubt else Mark.PASS)
    failed = [claim["sentence"] for claim in verdict.get("claims", ()) if not claim["pass"]]
    return row(
        "Deployable", f"no: {failed[0] if failed else verdict.get('sentence', 'no row has gains')}", mark=Mark.FAIL
    )


def counts(found: Mapping[str, int]) -> str:
    """Return counts as "187 solved, 13 infeasible", without zeros."""
    return ", ".join(f"{number} {name}" for name, number in found.items() if number) or "none"


def plural(number: int, thing: str) -> str:
    """Return a number of things: "1 row", "3 rows"."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def settled(found: Mapping[str, Any]) -> Mark:
    """Return the mark of a trial: fails where hands do not settle, a caution where some need dry friction for it."""
    if found["at_rest"] < found["hands"]:
        return Mark.FAIL
    return Mark.CAUTION if found["at_rest_without_friction"] < found["hands"] else Mark.PASS


def peak_force(trial: Mapping[str, Any], limit_n: float | None, limited: int = 0) -> Row:
    """Return the largest force of a tap; where it saturates, how many presses do so too."""
    if limit_n is not None and trial["tap_force_n"] >= _AT_LIMIT * limit_n:
        presses = ("; so do", count(limited), "presses") if limited else None
        return row("Peak force", "a tap saturates at", Value(limit_n, "force"), presses, mark=Mark.CAUTION)
    deep = (",", Value(trial["tap_depth_m"], "length"), "deep") if "tap_depth_m" in trial else None
    return row("Peak force", Value(trial["tap_force_n"], "force"), "in a tap", deep)


def not_used(declared: Iterable[str]) -> list[Row]:
    """Return what is declared and no part of a coupling to another end, a row for each reason."""
    by_reason: dict[str, list[str]] = {}
    for what in declared:
        name, _, reason = what.partition(" (")
        by_reason.setdefault(reason.removesuffix(")"), []).append(name)
    return [row("Not used", f"{', '.join(names)}: {why}", mark=Mark.CAUTION) for why, names in by_reason.items()]


def notes(found: Iterable[str], label: str = "Note", mark: Mark = Mark.CAUTION, rank: int = 0) -> list[Row]:
    """Return a row for each sentence."""
    return [row(label, one, mark=mark, rank=rank) for one in found]
