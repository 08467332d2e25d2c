"""Rows of a coupling to a simulation or a follower."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from avc_casadi.present.row import Mark, Part, Row, Value, count, listed, marked, parts, row, span
from avc_casadi.present.rows.subject import SAFE_GAIN, gain_margin, hand, not_used, pair

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

AT_LIMIT = 0.97
"""A tap this near to the force limit counts as saturated."""
MOST_HELPS = 3
"""What would help most, on the first screen."""
# An impedance error in free motion above which the other end feels distinctly altered.
_DRAGS = 1.0


def pair_rows(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of a coupling to a simulation or a follower."""
    found, felt, trial = data["pair"], data["felt"], data["trial"]
    unused = not_used(data["not_used"])
    end = problem.simulation or problem.follower
    if data["coupling"] is None:
        none = row("Coupling", f"none is deployable: {data['reason']}", mark=Mark.FAIL)
        # Where K is linearly stable hands refute it: what else is linearly stable with it is no help.
        wanted = end and end.stiffness_n_per_m
        refuted = wanted is not None and wanted <= found["stiffest"]["stiffness_n_per_m"]
        return [none, *([] if refuted else _same_k(found, problem)), *_pair_limit(data), *unused]
    local = "damper of each loop" if problem.follower is not None else "damper in the device's loop"
    soft = end is not None and end.stiffness_n_per_m is None
    soft = soft and found["gains"]["stiffness_n_per_m"] < problem.hands.stiffness_n_per_m[0]
    scene = found["in_scene"] or found["at_follower"]
    there = "in the scene" if found["in_scene"] else "at the follower"
    rows = [
        row(
            "Coupling",
            pair(found["gains"], local),
            ": softer than the softest hand" if soft else "",
            mark=Mark.CAUTION if soft else Mark.PASS,
        ),
        *([row("Scaled", there, pair(scene, local))] if scene and scene != found["gains"] else []),
        *felt_rows(felt),
        *_pair_stability(found, problem),
        *_pair_trial(trial),
    ]
    if "tap_force_n" in trial:
        limit = problem.device.max_force_n
        full = limit is not None and trial["tap_force_n"] >= AT_LIMIT * limit
        tap = (
            ("a tap saturates at", Value(limit, "force"))
            if full
            else (Value(trial["tap_force_n"], "force"), "in a tap")
        )
        rows.append(row("Peak force", tap, mark=Mark.CAUTION if full else Mark.NONE))
    if found["set_by"]:
        rows.append(row("K is set by", f"hands: {found['set_by']}"))
    return [*rows, *_same_k(found, problem), *_pair_limit(data), *unused]


def felt_rows(felt: Mapping[str, Any]) -> list[Row]:
    """Return what the handle meets: on a rigid object, on the stiffest declared contact, and in free motion."""
    if not felt["at"]:
        return []
    pressed = None if felt["stiffness_n_per_m"] is None else (Value(felt["stiffness_n_per_m"], "stiffness"), "pressed")
    stiff = [(Value(one["stiffness_n_per_m"], "stiffness"), f"at {one['frequency_hz']:g} Hz") for one in felt["at"]]
    rows = []
    if felt["on_stiffest_contact_n_per_m"] is not None:
        rows.append(row("Declared contact", Value(felt["on_stiffest_contact_n_per_m"], "stiffness"), "pressed"))
    rows.append(row("Rigid object", listed([pressed, *stiff])))
    moved = felt["at"][0]
    if moved["mass_kg"] is not None:
        mass: tuple[Part, ...] = (Value(moved["mass_kg"], "mass"),)
        if moved["mass_kg"] < 0:
            mass = ("a restoring spring",)
        drag = ("drag", Value(moved["drag_ns_per_m"], "damping"), f"at {moved['frequency_hz']:g} Hz")
        errors = listed((Value(one["free_error"], "share"), f"at {one['frequency_hz']:g} Hz") for one in felt["at"])
        altered = max(one["free_error"] for one in felt["at"]) > _DRAGS
        mark = Mark.CAUTION if altered else Mark.NONE
        rows.append(row("Free motion", mass, ",", drag, "; impedance error", errors, mark=mark))
    return rows


def _pair_stability(found: Mapping[str, Any], problem: Problem) -> list[Row]:
    mode, margin, steady = found["least_damped"], found["gain_margin"], found["mismatch_stable"] is not False
    mark = Mark.PASS if margin >= SAFE_GAIN and steady else Mark.CAUTION
    off = "" if steady else "; not on devices 10 % away"
    rows = [
        row(
            "Stability",
            "corner hands and released,",
            count(found["loops"]),
            "loops;",
            gain_margin(margin),
            off,
            mark=mark,
        )
    ]
    if mode["damping_ratio"] < 1:
        damped = (Value(mode["damping_ratio"], "number", 2), "at", Value(mode["frequency_hz"], "frequency"))
        seconds = ("; decays to 1/e in", Value(mode["time_constant_s"], "time", 2))
        rows.append(row("Damping ratio", damped, "(least damped loop)", seconds))
    if problem.follower is not None and found["passivity_margin_ns_per_m"] is not None:
        passive = found["passivity_margin_ns_per_m"] >= 0
        needed = ("not for any operator: that needs", Value(found["passive_damping_ns_per_m"], "damping"), "a device")
        told = ("for any operator and environment",) if passive else needed
        rows.append(row("Passivity", told, mark=marked(passive, Mark.CAUTION)))
    return rows


def _pair_trial(trial: Mapping[str, Any]) -> list[Row]:
    hands, motions = trial["hands"], ", ".join(trial["motions"])
    told = (count(trial["settled"]), "of", count(hands), f"hands settle ({motions})")
    if "settled_without_friction" not in trial:
        link = (";", Value(trial["jitter"], "share"), "of jitter,", Value(trial["lost_share"], "share"), "lost")
        return [row("Simulated", told, link, mark=marked(trial["settled"] == hands))]
    free, dropped = trial["settled_without_friction"], trial["settled_with_dropped_steps"]
    missed = (",", count(dropped), "with", Value(trial["dropped_share"], "share"), "of the steps missed")
    mark = marked(min(trial["settled"], free, dropped) == hands, Mark.CAUTION)
    return [row("Simulated", told, ",", count(free), "without friction", missed, mark=mark)]


def _same_k(found: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return the lightest tool, the slowest step and the exchanges with which the same K is linearly stable."""
    ends = found["searched_to"]
    each: list[tuple[Part, ...]] = []
    if (least := found["least_tool_mass_kg"]) is not None:
        bound = "or less" if least <= ends["least_tool_mass_kg"] * 1.001 else "or more"
        each.append(("a tool of", Value(least, "mass"), bound))
    if (slowest := found["slowest_step_s"]) is not None:
        bound = "at least" if slowest >= ends["slowest_step_s"] * 0.999 else ""
        each.append(("a step up to", bound, Value(slowest, "time")))
    if found["exchanges"]:
        held = [name for name, holds in found["exchanges"].items() if holds]
        each.append((f"exchange {', '.join(held)}" if held else "no exchange",))
    rows = [row("Linear, same K", listed(each), ", with a B of its own and no margin")] if each else []
    if problem.simulation is not None and found["local_dampers_ns_per_m"] is not None:
        rows.append(row("Local damper", span(found["local_dampers_ns_per_m"], "damping"), "keeps the same K, B stable"))
    return rows


def _pair_limit(data: Mapping[str, Any]) -> list[Row]:
    found = data["pair"]
    stiffest, case = found["stiffest"]["stiffness_n_per_m"], found["limited_by"]
    limit = ("K", Value(stiffest, "stiffness")) if stiffest else ("no K is stable",)
    helps = [(one["change"], Value(one["stiffest_n_per_m"], "stiffness")) for one in data["what_would_help"]]
    where: tuple[Part, ...] = hand(case["hand"])
    if "step_s" in case:
        where = parts(where, "; step", Value(case["step_s"], "time"))
    else:
        touched = case["environment_n_per_m"]
        on = ("rigid object",) if touched is None else ("spring of", Value(touched, "stiffness")) if touched else "free"
        delays = (Value(one, "time") for one in case["delays_s"])
        where = parts(where, ", follower", on, "; delays", listed(delays))
    return [
        row("Linear limit", listed([limit, *helps[:MOST_HELPS]], ";")),
        row("Limited by", where, rank=1),
        *(row("What would help", one, rank=1) for one in helps[MOST_HELPS:]),
    ]
