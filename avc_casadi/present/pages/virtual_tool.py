"""Summary of a coupling to a simulation: spring and damper, rendering, claims, limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import percent, quantity
from avc_casadi.design.virtual_tool import ToolSearchOptions
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# A gain margin below which a row warns.
_SAFE = 1.5
_MOST_HELPS = 3
# An impedance error in free motion above which the tool feels distinctly altered.
_DRAGS = 1.0


def tool_page(
    document: dict[str, Any],
    problem: Problem,
    page: Page,
    shown: str = "P",
    written: str | None = None,
    *,
    verbose: bool = False,
) -> str:
    """Return the `recommend` document of a problem with [simulation] as a headline and about ten rows.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        written: file that holds the coupling, if one was written.
        verbose: with all details below.
    """
    commands = [
        f"avc recommend {quote(shown)} --out coupling.json"
        if written is None
        else f"avc export {quote(written)} --c DIR"
    ]
    if document["coupling"] is None:
        commands = [f"avc check {quote(shown)}"]
    text = page.rendered(headline(problem, shown), tool_rows(document, problem), commands, ("The same K, B",))
    if verbose:
        text = "\n".join([text, "", "\n".join(_all(document, problem))])
    return text


def headline(problem: Problem, shown: str) -> str:
    """Return a problem with [simulation] in a line: tool, engine, device.

    Args:
        problem: the problem.
        shown: as the user names it.
    """
    device, tool, unit = problem.device, problem.simulation, problem.units.unit
    assert tool is not None  # noqa: S101 - asked of problems with one
    what = "a fixed place" if tool.tool_mass_kg is None else f"a tool of {span(tool.tool_mass_kg, unit('kg'))}"
    late = f", {tool.steps_late} steps late" if tool.steps_late > 1 else ", one step late" if tool.steps_late else ""
    return (
        f"{shown}   {what} at {span([1 / step for step in reversed(tool.step_s)], 'Hz')}, {tool.integrator}, "
        f"{tool.exchange}{late} · device {quantity(device.mass_kg, unit('kg'))}, "
        f"{quantity(1 / device.sample_time_s, 'Hz')}, delay {device.delay_samples:g}"
    )


def tool_rows(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of the `recommend` document.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
    """
    found = document["simulation"]
    if document["coupling"] is None:
        none = Row("Coupling", f"none is deployable: {document['reason']}", Mark.FAIL)
        # Where K is linearly stable hands refute it: what else is linearly stable with it is no help.
        wanted = problem.simulation and problem.simulation.stiffness_n_per_m
        refuted = wanted is not None and wanted <= found["stiffest_n_per_m"]
        needed = [] if refuted else _needed(found, problem)
        return [none, *needed, _limit(document, problem), *not_used_rows(document)]
    return [
        _coupling(found, problem),
        *felt_rows(found["felt"], found["rendered_stiffness_n_per_m"], problem),
        _stability(document, problem),
        _simulated(document),
        _force(document, problem),
        *([Row("K is set by", f"hands: {found['set_by']}")] if found["set_by"] else []),
        *_needed(found, problem),
        _limit(document, problem),
        *not_used_rows(document),
    ]


def _coupling(found: dict[str, Any], problem: Problem) -> Row:
    unit = problem.units.unit
    text = f"spring K {quantity(found['stiffness_n_per_m'], unit('N/m'))}"
    if found["damping_ns_per_m"] > 0:
        text += f", damper B {quantity(found['damping_ns_per_m'], unit('N.s/m'))}"
    if found["local_damping_ns_per_m"] > 0:
        text += f", damper in the device's loop {quantity(found['local_damping_ns_per_m'], unit('N.s/m'))}"
    scene = found["in_scene"]
    if scene["stiffness_n_per_m"] != found["stiffness_n_per_m"]:
        k, b = quantity(scene["stiffness_n_per_m"], unit("N/m")), quantity(scene["damping_ns_per_m"], unit("N.s/m"))
        text += f"; in the scene {k}, {b}"
    wanted = problem.simulation is not None and problem.simulation.stiffness_n_per_m is not None
    if not wanted and found["stiffness_n_per_m"] < problem.hands.stiffness_n_per_m[0]:
        return Row("Coupling", f"{text}: softer than the softest hand", Mark.CAUTION)
    return Row("Coupling", text, Mark.PASS)


def not_used_rows(document: dict[str, Any]) -> list[Row]:
    """Return what is declared and no part of a coupling to another end, a row for each reason.

    Args:
        document: of `avc recommend`, `certify` or `check`.
    """
    by_reason: dict[str, list[str]] = {}
    for what in document["not_used"]:
        name, _, reason = what.partition(" (")
        by_reason.setdefault(reason.removesuffix(")"), []).append(name)
    return [Row("Not used", f"{', '.join(names)}: {why}", Mark.CAUTION) for why, names in by_reason.items()]


def gain_margin_text(margin: float) -> str:
    """Return a gain margin in words, rounded down; where the search of it ended, as at least that.

    Args:
        margin: of a certificate.
    """
    most = ToolSearchOptions().widest_margin
    return f"gain margin {most:g} or more" if margin >= most else f"gain margin {math.floor(100 * margin) / 100:.3g}"


def felt_rows(felt: list[dict[str, Any]], pressed_n_per_m: float | None, problem: Problem) -> list[Row]:
    """Return what the handle feels like: on a rigid object, and in free motion where something moves.

    Args:
        felt: at each frequency, of the `recommend` document.
        pressed_n_per_m: stiffness that simulated hands met; None where none has tried it.
        problem: for its units.
    """
    unit = problem.units.unit
    if not felt:
        return []
    stiff = ", ".join(
        f"{quantity(one['stiffness_n_per_m'], unit('N/m'))} at {one['frequency_hz']:g} Hz" for one in felt
    )
    pressed = "" if pressed_n_per_m is None else f"{quantity(pressed_n_per_m, unit('N/m'))} pressed, "
    rows = [Row("Rigid object", f"{pressed}{stiff}")]
    moved = felt[0]
    if moved["mass_kg"] is not None:
        errors = ", ".join(f"{percent(one['free_error'])} at {one['frequency_hz']:g} Hz" for one in felt)
        told = f"{inertia_text(moved, problem)}; impedance error {errors}"
        altered = max(one["free_error"] for one in felt) > _DRAGS
        rows.append(Row("Free motion", told, Mark.CAUTION if altered else Mark.NONE))
    return rows


def inertia_text(felt: dict[str, Any], problem: Problem) -> str:
    """Return what a handle that moves freely feels like: a mass, or where it pulls back a spring, and a drag.

    Args:
        felt: at one frequency, of the `recommend` document.
        problem: for its units.
    """
    unit, mass = problem.units.unit, felt["mass_kg"]
    what = quantity(mass, unit("kg"))
    if mass < 0:
        what = f"a spring of {quantity(-mass * (2 * math.pi * felt['frequency_hz']) ** 2, unit('N/m'))}"
    return f"{what} with a drag of {quantity(felt['drag_ns_per_m'], unit('N.s/m'))} at {felt['frequency_hz']:g} Hz"


def _stability(document: dict[str, Any], problem: Problem) -> Row:
    found, mode = document["simulation"], document["simulation"]["least_damped"]
    margin = found["gain_margin"]
    told = f"all hands and released, {document['certificate']['loops']} loops; {gain_margin_text(margin)}"
    if mode["damping_ratio"] < 1:
        seconds = quantity(mode["time_constant_s"], "s", 2)
        told += (
            f"; least damped {mode['damping_ratio']:.2g} at {quantity(mode['frequency_hz'], 'Hz')}, {seconds} to 1/e"
        )
    if not found["mismatch_stable"]:
        told += "; not on devices 10 % off"
    del problem
    return Row("Stability", told, Mark.PASS if margin >= _SAFE and found["mismatch_stable"] else Mark.CAUTION)


def _simulated(document: dict[str, Any]) -> Row:
    trial = document["trial"]
    free, dropped, hands = trial["settled_without_friction"], trial["settled_with_dropped_steps"], trial["hands"]
    told = (
        f"{trial['settled']} of {hands} hands settle ({', '.join(trial['motions'])}), {free} without friction, "
        f"{dropped} with {100 * trial['dropped_share']:g} % of the steps missed"
    )
    return Row("Simulated", told, Mark.PASS if min(trial["settled"], free, dropped) == hands else Mark.CAUTION)


def _force(document: dict[str, Any], problem: Problem) -> Row:
    tap, limit, unit = document["trial"]["tap_force_n"], problem.device.max_force_n, problem.units.unit("N")
    label = problem.units.key("force").capitalize()
    if limit is not None and tap >= 0.97 * limit:
        return Row(label, f"a tap reaches the limit of {quantity(limit, unit)}", Mark.CAUTION)
    return Row(label, f"a tap reaches {quantity(tap, unit)}")


def _needed(found: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe the lightest tool, the slowest engine and the exchange that allow the same K, each with a B of its own.

    Where a search ended, its end is no limit.
    """
    unit, parts, ends = problem.units.unit, [], found["searched_to"]
    if found["least_tool_mass_kg"] is not None:
        least, tried = found["least_tool_mass_kg"], ends["least_tool_mass_kg"]
        parts.append(f"a tool of {quantity(least, unit('kg'))}{' or less' if least <= tried * 1.001 else ' or more'}")
    if found["slowest_step_s"] is not None:
        slowest, tried = found["slowest_step_s"], ends["slowest_step_s"]
        samples = round(slowest / problem.device.sample_time_s)
        least = "at least " if slowest >= tried * 0.999 else ""
        parts.append(f"a step up to {least}{samples} sample{'s' * (samples > 1)} ({quantity(slowest, 's')})")
    if found["exchanges"]:
        held = [name for name, holds in found["exchanges"].items() if holds]
        if not found["local_damping_ns_per_m"] and "held-force" in held:
            held[held.index("held-force")] = "held-force (and a damper in the device's loop)"
        parts.append(f"exchange {', '.join(held)}" if held else "no exchange")
    rows = [Row("The same K holds", f"with its own B: {', '.join(parts)}")] if parts else []
    if found["local_dampers_ns_per_m"] is not None:
        damper = span(found["local_dampers_ns_per_m"], unit("N.s/m"))
        rows.append(Row("The same K, B", f"hold with a damper in the device's loop of {damper}"))
    return rows


def _limit(document: dict[str, Any], problem: Problem) -> Row:
    unit = problem.units.unit("N/m")
    helps = "".join(
        f"; {one['change']} {quantity(one['stiffest_n_per_m'], unit)}"
        for one in document["what_would_help"][:_MOST_HELPS]
    )
    stiffest = document["simulation"]["stiffest_n_per_m"]
    return Row("Linear limit", f"{f'K {quantity(stiffest, unit)}' if stiffest else 'no K is stable'}{helps}")


def _all(document: dict[str, Any], problem: Problem) -> list[str]:
    found, unit = document["simulation"], problem.units.unit
    case = found["limited_by"]
    hand = case["hand"]
    who = "the device released"
    if any(hand.values()):
        who = ", ".join(
            quantity(hand[key], unit(of))
            for key, of in (("mass_kg", "kg"), ("damping_ns_per_m", "N.s/m"), ("stiffness_n_per_m", "N/m"))
        )
    lines = [f"limited by: {who}; step {quantity(case['step_s'], 's')}"]
    if document["certificate"]:
        lines.append(f"claim: {document['certificate']['claim']}")
    lines += [f"assumed: {gap}" for gap in document["assumed"]]
    lines += [f"not used: {what}" for what in document["not_used"]]
    return [*lines, f"reason: {document['reason']}"]


def span(values: Sequence[float], unit: str) -> str:
    """Return a value, or the ends of a range, in a unit.

    Args:
        values: one or more.
        unit: of them.
    """
    low, high = min(values), max(values)
    return quantity(low, unit) if low == high else f"{quantity(low, unit)} to {quantity(high, unit)}"
