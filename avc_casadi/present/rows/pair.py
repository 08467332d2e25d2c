"""Rows of a coupling to a simulation or a follower: what it renders, whether it is stable, what limits it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from avc_casadi.design.virtual_tool import WIDEST_MARGIN
from avc_casadi.present.row import Mark, Part, Row, Value, count, doubted, listed, marked, parts, row, span
from avc_casadi.present.rows.subject import hand, not_used, pair, peak_force

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

MOST_HELPS = 3
"""What would help most, on the first screen."""
# A gain margin below which a row warns.
_SAFE_GAIN = 1.5
# An impedance error in free motion above which the other end feels distinctly altered.
_DRAGS = 1.0


def pair_rows(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of a recommended coupling to a simulation or a follower."""
    found, trial, end = data["pair"], data["trial"], problem.simulation or problem.follower
    wanted = end and end.stiffness_n_per_m
    more = [*_limit(data), *not_used(data["not_used"])]
    if data["coupling"] is None:
        none = row("Coupling", f"none is deployable: {data['reason']}", mark=Mark.FAIL)
        # Where K is linearly stable hands refute it: what else is linearly stable with it is no help.
        refuted = wanted is not None and wanted <= found["stiffest"]["stiffness_n_per_m"]
        return [none, *([] if refuted else _same_k(found, problem)), *more]
    local = "damper of each loop" if problem.follower is not None else "damper in the device's loop"
    soft = wanted is None and found["gains"]["stiffness_n_per_m"] < problem.hands.stiffness_n_per_m[0]
    softer = ": softer than the softest hand" if soft else ""
    rows = [row("Coupling", pair(found["gains"], local), softer, mark=marked(not soft, Mark.CAUTION))]
    for where, there in (("in the scene", found["in_scene"]), ("at the follower", found["at_follower"])):
        if there and there != found["gains"]:
            rows.append(row("Scaled", where, pair(there, local)))
    rows += [*felt_rows(data["felt"]), *stability(found), *_passivity(found, problem), *_trial(trial)]
    if "tap_force_n" in trial:
        rows.append(peak_force(trial, problem.device.max_force_n))
    if found["set_by"]:
        rows.append(row("K is set by", f"hands: {found['set_by']}"))
    return [*rows, *_same_k(found, problem), *more]


def felt_rows(felt: Mapping[str, Any]) -> list[Row]:
    """Return what the handle meets: on a rigid object, on the stiffest declared contact, and in free motion."""
    if not felt["at"]:
        return []
    rows, moved = [], felt["at"][0]
    if felt["on_stiffest_contact_n_per_m"] is not None:
        rows.append(row("Declared contact", Value(felt["on_stiffest_contact_n_per_m"], "stiffness"), "pressed"))
    pressed = None if felt["stiffness_n_per_m"] is None else (Value(felt["stiffness_n_per_m"], "stiffness"), "pressed")
    stiff = [(Value(one["stiffness_n_per_m"], "stiffness"), f"at {one['frequency_hz']:g} Hz") for one in felt["at"]]
    rows.append(row("Rigid object", listed([pressed, *stiff])))
    if moved["mass_kg"] is not None:
        mass: Part = "a restoring spring" if moved["mass_kg"] < 0 else Value(moved["mass_kg"], "mass")
        drag = (", drag", Value(moved["drag_ns_per_m"], "damping"), f"at {moved['frequency_hz']:g} Hz")
        errors = listed((Value(one["free_error"], "share"), f"at {one['frequency_hz']:g} Hz") for one in felt["at"])
        altered = max(one["free_error"] for one in felt["at"]) > _DRAGS
        rows.append(row("Free motion", mass, drag, "; impedance error", errors, mark=doubted(altered)))
    return rows


def stability(found: Mapping[str, Any]) -> list[Row]:
    """Return whether all loops are stable, with their margin, and the worst or least damped of them."""
    rows, loops, mode = [], count(found["loops"]), found["least_damped"]
    if not found.get("stable", True):
        rows.append(row("Stability", "not all of", loops, "loops are stable", mark=Mark.FAIL))
    else:
        steady = found.get("mismatch_stable") is not False
        margin = f"{WIDEST_MARGIN:g} or more"  # where its search ended
        if found["gain_margin"] < WIDEST_MARGIN:
            margin = f"{math.floor(100 * found['gain_margin']) / 100:.3g}"
        text = ("corner hands and released,", loops, f"loops; gain margin {margin}")
        mark = marked(found["gain_margin"] >= _SAFE_GAIN and steady, Mark.CAUTION)
        rows.append(row("Stability", text, "" if steady else "; not on devices 10 % away", mark=mark))
    if case := found.get("worst"):
        tool, stiffness = case["tool"], case["tool"]["contact_stiffness_n_per_m"]
        touches: tuple[Part, ...] = ("on", Value(stiffness, "stiffness")) if stiffness else ("free",)
        what = ("tool of", Value(tool["mass_kg"], "mass"), ",", "held rigidly" if stiffness is None else touches)
        step = ("; step", Value(case["step_s"], "time"))
        radius = ("; spectral radius", Value(found["spectral_radius"], "number", 6), "a step")
        at = "fixed place" if tool["mass_kg"] is None else what
        rows.append(row("Worst loop", hand(case["hand"]), ";", at, step, radius))
    if found.get("stable", True) and mode["damping_ratio"] < 1:
        damped = (Value(mode["damping_ratio"], "number", 2), "at", Value(mode["frequency_hz"], "frequency"))
        rows.append(row("Damping ratio", damped, "(least damped loop)"))
    return rows


def _passivity(found: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return whether a teleoperator is passive at both ports."""
    if problem.follower is None or found["passivity_margin_ns_per_m"] is None:
        return []
    if found["passivity_margin_ns_per_m"] >= 0:
        return [row("Passivity", "for any operator and environment", mark=Mark.PASS)]
    needed = Value(found["passive_damping_ns_per_m"], "damping")
    return [row("Passivity", "not for any operator: that needs", needed, "a device", mark=Mark.CAUTION)]


def _trial(trial: Mapping[str, Any]) -> list[Row]:
    hands, settled = trial["hands"], [trial["settled"]]
    text = parts(count(trial["settled"]), "of", count(hands), f"hands settle ({', '.join(trial['motions'])})")
    if "settled_without_friction" not in trial:
        link = (";", Value(trial["jitter"], "share"), "of jitter,", Value(trial["lost_share"], "share"), "lost")
        return [row("Simulated", text, link, mark=marked(settled == [hands]))]
    settled += [trial["settled_without_friction"], trial["settled_with_dropped_steps"]]
    missed = (",", count(settled[2]), "with", Value(trial["dropped_share"], "share"), "of the steps missed")
    mark = marked(min(settled) == hands, Mark.CAUTION)
    return [row("Simulated", text, ",", count(settled[1]), "without friction", missed, mark=mark)]


def _same_k(found: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return the lightest tool, the slowest step and the exchanges with which the same K is linearly stable."""
    ends, each = found["searched_to"], list[tuple[Part, ...]]()
    if (least := found["least_tool_mass_kg"]) is not None:
        bound = "or less" if least <= ends["least_tool_mass_kg"] * 1.001 else "or more"
        each.append(("a tool of", Value(least, "mass"), bound))
    if (slowest := found["slowest_step_s"]) is not None:
        bound = "a step up to at least" if slowest >= ends["slowest_step_s"] * 0.999 else "a step up to"
        each.append((bound, Value(slowest, "time")))
    if found["exchanges"]:
        stable = ", ".join(name for name, holds in found["exchanges"].items() if holds)
        each.append((f"exchange {stable}" if stable else "no exchange",))
    rows = [row("Linear, same K", listed(each), ", with a B of its own and no margin")] if each else []
    if problem.simulation is not None and found["local_dampers_ns_per_m"] is not None:
        rows.append(row("Local damper", span(found["local_dampers_ns_per_m"], "damping"), "keeps the same K, B stable"))
    return rows


def _limit(data: Mapping[str, Any]) -> list[Row]:
    stiffest, case = data["pair"]["stiffest"]["stiffness_n_per_m"], data["pair"]["limited_by"]
    limit = ("K", Value(stiffest, "stiffness")) if stiffest else ("no K is stable",)
    helps = [(one["change"], Value(one["stiffest_n_per_m"], "stiffness")) for one in data["what_would_help"]]
    where = parts(hand(case["hand"]))
    if "step_s" in case:
        where = parts(where, "; step", Value(case["step_s"], "time"))
    else:
        touched = case["environment_n_per_m"]
        on = ("rigid object",) if touched is None else ("spring of", Value(touched, "stiffness")) if touched else "free"
        where = parts(where, ", follower", on, "; delays", listed(Value(one, "time") for one in case["delays_s"]))
    return [
        row("Linear limit", listed([limit, *helps[:MOST_HELPS]], ";")),
        row("Limited by", where, rank=1),
        *(row("What would help", one, rank=1) for one in helps[MOST_HELPS:]),
    ]
