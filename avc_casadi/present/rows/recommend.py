"""Rows of a recommendation: a coupling to a wall, and the stiffest wall."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi.present.row import (
    Answer,
    Mark,
    Part,
    Row,
    Value,
    count,
    doubted,
    listed,
    row,
    span,
    written,
)
from avc_casadi.present.rows.margins import damping_ratio, margins_by_loop, settling, smallest_margins
from avc_casadi.present.rows.pair import MOST_HELPS, pair_rows
from avc_casadi.present.rows.subject import answer, gains, name_of, notes, peak_force, settled, thin
from avc_casadi.recommendation.contact_onset import REACHED_M
from avc_casadi.recommendation.preconditions import SLIP, asked_of_others, not_judged

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.recommendation import Recommendation

# An impedance error of a hand's motion above which it feels unlike a static press.
_SOFTER = 0.2
# Impedance of device and wall together over that of the wall below which errors are relative to hardly anything.
_RESONANT = 0.3
# Frequencies up to this are those of hands.
_OF_HANDS_HZ = 10.0
# A stiffness gain by friction that is worth a row, and a share of the wall that is beyond what is wanted.
_STIFFER = 1.1
# Share of hands that may notice the encoder steps, or a vibration at rest, without a caution.
_FEW_FEEL = 0.1
# Steps of the force, and shortfalls of the handle, from which on they are printed.
_NOTICED_STEP_N, _NOTICED_SHORT_M = 0.1, 1e-3
# Of the wall: a share that is hardly a wall; of the hands: those at the force limit.
_HARDLY, _PUSH_THROUGH = 0.1, 0.5
# A contact onset, and a rebound over that of a passive wall, that differ noticeably.
_ELSEWHERE_M, _FASTER = 5e-4, 1.02
_CYCLES = {
    "proved": "proved to settle from any state, making and breaking contact",
    "refuted": "a limit cycle without friction exists",
    "open": "freedom from limit cycles is open",
    "simulated": "freedom from limit cycles is simulated, not proved",
}


def recommendation(found: Recommendation, shown: str = "", file: str | None = None) -> Answer:
    """Return the answer of `recommend`; ``file`` holds the coupling."""
    problem, data, shown = found.problem, found.data(), shown or name_of(found.problem)
    rows = wall_rows(data, problem) if found.pair is None else pair_rows(data, problem)
    onwards = f"avc recommend {quote(shown)} --out coupling.json"
    nothing = data["reason"].startswith("nothing") or problem.environment.stiffness_n_per_m == 0
    if found.deployable and file is not None:
        onwards = f"avc export {quote(file)} --c firmware"
    elif found.coupling is None or (not found.deployable and (nothing or _slips(data))):
        onwards = f"avc check {quote(shown)}"
    elif not found.deployable:
        onwards = f"avc recommend {quote(shown)} --stiffest"
    complaint = "" if found.deployable else f"avc: {problem.name}: no coupling is deployable"
    rows += [*written(file), *_details(data)]
    return answer("recommend", data, problem, shown, rows, (onwards, f"avc recommend {quote(shown)} -v"), complaint)


def verdict(data: Mapping[str, Any], rows: Sequence[Row]) -> tuple[str, bool]:
    """Return the verdict in a line, and whether it is a yes."""
    if data["coupling"] is None:
        return f"Deploy nothing: {data['reason'].partition(';')[0]}.", False
    if not data["deployable"]:
        return f"Do not deploy this coupling: {data['reason']}.", False
    doubts = ", ".join(dict.fromkeys(one.label for one in rows if one.mark in {Mark.CAUTION, Mark.FAIL}))
    return f"Deploy this coupling{f'; see {doubts}' if doubts else ''}.", True


def wall_rows(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of a coupling to a wall."""
    if data["coupling"] is None:
        none = row("Coupling", f"none is deployable: {data['reason']}", mark=Mark.FAIL)
        return [*_slips(data), none, *_limit(data)]
    found = [*_slips(data), _coupling(data, problem), *_rendered(data, problem), _stability(data)]
    if not data["deployable"]:
        return [*found, *_simulated(data)]
    limit, worst = data["coupling"]["max_force_n"], data["transient"]["worst_hand"]
    return [
        *found,
        smallest_margins(data["margins"]),
        settling(data["transient"]["released"]["settling_s"], "released"),
        damping_ratio(worst["damping_ratio"], worst["frequency_hz"], "worst_hand", data["coupling"]["sample_time_s"]),
        *_trade_off(data),
        *_simulated(data),
        *_unmodelled(data),
        peak_force(data["trial"], limit, data["trial"]["at_force_limit"]),
        *_quantisation(data["felt"], problem),
        *_contact(data["felt"], problem),
        *_friction(data, problem),
        *notes(asked_of_others(data["not_used"]), "Not used", Mark.NONE),
        *_limit(data),
    ]


def _slips(data: Mapping[str, Any]) -> list[Row]:
    doubts = [what.removeprefix(SLIP) for what in data["assumed"] if what.startswith(SLIP)]
    return [row("Values", "; ".join(doubts), mark=Mark.CAUTION)] if doubts else []


def _coupling(data: Mapping[str, Any], problem: Problem) -> Row:
    coupling, trial, felt, wall = data["coupling"], data["trial"], data["felt"], problem.environment.stiffness_n_per_m
    runtime, law = coupling["runtime"], coupling["runtime"]["state_feedback"]
    mass = runtime["observer_mass_kg"]
    found = listed(
        [
            None if law is None else f"observer ({len(law['innovation'])} states) with state feedback",
            gains(coupling["table"], problem),
            None if mass is None else ("observer of assumed", Value(mass, "mass")),
            None if coupling["constant"] else f"{len(coupling['table']['frequency_hz'])} rows",
        ]
    )
    if not data["deployable"]:
        why = "" if data["reason"].startswith("nothing") or _failed(data) else f": {data['reason']}"
        return row("Coupling", found, ": NOT deployable", why, mark=Mark.FAIL)
    names = ", ".join(what.partition(" (")[0] for what in not_judged(data["not_used"]))
    doubt: tuple[Part, ...] = ()
    if trial["at_force_limit"] > _PUSH_THROUGH * trial["hands"]:
        pushing = (", but", count(trial["at_force_limit"]), "of", count(trial["hands"]), "hands push through the wall")
        doubt = (*pushing, "(limit", Value(coupling["max_force_n"], "force"), ")")
    elif wall > 0:
        moving = felt["stiffness_in_motion_n_per_m"].get("1", wall)
        if min(felt["share_of_wall"] or 1.0, moving / wall) < _HARDLY:
            doubt = (", but hardly anything of the wall is rendered to a moving hand",)
    without = f"without {names}, which is declared and not used" if names else ""
    low = thin(min(one["disk"] for one in data["margins"].values()))
    mark = Mark.CAUTION if doubt or without or low else Mark.PASS
    return row("Coupling", found, ": deployable", without, doubt, low, mark=mark)


def _rendered(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    felt, trial, wall = data["felt"], data["trial"], problem.environment
    errors = listed((Value(error, "share"), f"at {hz} Hz") for hz, error in felt["complex_error"].items())

    def moving(key: str) -> dict[str, float]:
        return {hz: one for hz, one in felt[key].items() if float(hz) <= _OF_HANDS_HZ}

    if wall.stiffness_n_per_m == 0:
        damping = moving("damping_in_motion_ns_per_m")
        off = any(abs(one / wall.damping_ns_per_m - 1) > _SOFTER for one in damping.values())
        found = listed((Value(one, "damping"), f"at {hz} Hz") for hz, one in damping.items())
        error = row("Impedance error", errors, "of the whole cycle: a wall never pulls")
        return [row("Rendered", "damper of", found, mark=doubted(off)), error]
    if felt["stiffness_n_per_m"] is None or data["reason"].startswith("nothing"):
        what = data["reason"] if data["reason"].startswith("nothing") else "nothing: every press reaches the limit"
        return [row("Rendered", what, mark=Mark.FAIL)]
    sensed, share, handle = felt["stiffness_n_per_m"], felt["share_of_wall"], felt["stiffness_at_handle_n_per_m"]
    motion, low_high = moving("stiffness_in_motion_n_per_m"), trial["stiffness_n_per_m"]["nine_in_ten"]
    wanted = {hz: wall.stiffness_n_per_m + 2j * math.pi * float(hz) * wall.damping_ns_per_m for hz in motion}
    stiffer = any(one > (1 + _SOFTER) * abs(wanted[hz]) for hz, one in motion.items())
    spread = min(low_high) < 0.9 * sensed or max(low_high) > 1.1 * sensed
    stiffnesses = [
        (Value(sensed, "stiffness"), "static (", Value(share, "share"), "of the wall)"),
        *((Value(one, "stiffness"), f"at {hz} Hz") for hz, one in motion.items()),
        None if handle == sensed else (Value(handle, "stiffness"), "at the handle"),
        (span(low_high, "stiffness"), "over 90 % of hands") if spread else None,
        "above the wall in motion, damping included" if stiffer else None,
    ]
    worst = max(moving("complex_error").values(), default=0.0)
    near = " and ".join(_near_resonance(felt["complex_error"], problem))
    resonance = f"; resonance of device and wall near {near}, where |Z| is small" if near else ""
    sine = (", sine of", Value(felt["shaken"]["amplitude_m"], "length"))
    return [
        row("Rendered", listed(stiffnesses), mark=doubted(stiffer or share > _STIFFER)),
        row("Impedance error", errors, sine, resonance, mark=doubted(worst > max(_SOFTER, 1 - share))),
    ]


def _near_resonance(errors: Mapping[str, float], problem: Problem) -> list[str]:
    """Return the frequencies near the resonance of device and wall, where |Z| nearly vanishes."""
    device, wall, near = problem.device, problem.environment, []
    for hz in errors:
        s = 2j * math.pi * float(hz)
        of_wall = wall.damping_ns_per_m + wall.stiffness_n_per_m / s
        if abs(device.mass_kg * s + device.damping_ns_per_m + of_wall) < _RESONANT * abs(of_wall):
            near.append(f"{hz} Hz")
    return near


def _failed(data: Mapping[str, Any]) -> list[str]:
    return [claim["sentence"] for claim in data["certificate"]["deployable"]["claims"] if not claim["pass"]]


def _stability(data: Mapping[str, Any]) -> Row:
    if failed := _failed(data):
        return row("Stability", failed[0], mark=Mark.FAIL)
    text = f"linearly stable with every corner hand and released; {_CYCLES[data['rest']['word']]}"
    return row("Stability", text, mark=Mark.CAUTION if data["rest"]["word"] == "refuted" else Mark.PASS)


def _simulated(data: Mapping[str, Any]) -> list[Row]:
    total, off = data["simulated"], data["off_file"]
    loud = total["hands"] - total["quiet"] > _FEW_FEEL * total["hands"]
    simulated = _resting("Simulated", total)
    rows = [replace(simulated, mark=_or_caution(simulated.mark, doubt=loud))]
    if off is not None:
        devices = ("on", count(off["devices"]), "devices with values off by", Value(off["share"], "share"))
        unstable = off["linearly_unstable"]
        more = ("; linearly unstable on", count(unstable)) if unstable else None
        mark = _or_caution(settled(off), doubt=bool(unstable))
        rows.append(row("Model mismatch", _settle(off), devices, more, mark=mark))
    return rows


def _or_caution(mark: Mark, *, doubt: bool) -> Mark:
    return Mark.CAUTION if doubt and mark is Mark.PASS else mark


def _settle(found: Mapping[str, Any]) -> tuple[Part, ...]:
    free = ("settle,", count(found["at_rest_without_friction"]), "without friction")
    return (count(found["at_rest"]), "of", count(found["hands"]), "hands", *free)


def _resting(label: str, found: Mapping[str, Any]) -> Row:
    quiet = (";", count(found["quiet"]), "below the vibrotactile threshold")
    return row(label, _settle(found), quiet, mark=settled(found))


def _unmodelled(data: Mapping[str, Any]) -> list[Row]:
    """Return how many hands settle with each unmodelled effect, and how many of those that hold the device."""
    by_label: dict[str, list[Mapping[str, Any]]] = {"Unmodelled": [], "Declared grip": []}
    for one in data["beyond_file"]:
        by_label["Declared grip" if one["key"] == "held" else "Unmodelled"].append(one)
    rows = []
    for label, found in by_label.items():
        each, whole = [], True
        for place, one in enumerate(found):
            # A requirement is met, if not without dry friction, then with it where that may be counted on.
            key = "at_rest" if one["asked"] and one["at_rest"] is not None else "at_rest_without_friction"
            whole = whole and one[key] == one["at_rest_without_friction"] == one["hands"]
            of = None if place else ("of", count(one["hands"]), "hands settle")
            each.append((count(one[key]), of, "with", _effect(one)))
        if each:
            rows.append(row(label, listed(each), mark=Mark.PASS if whole else Mark.CAUTION))
    return rows


def _effect(one: Mapping[str, Any]) -> tuple[Part, ...]:
    value = one["value"]
    if one["key"] == "held":
        return ("one fingertip" if value == "fingertip" else f"hands on a {value}",)
    return (Value(value, "share"), "less mass" if one["key"] == "mass_share" else "of samples lost")


def _quantisation(felt: Mapping[str, Any], problem: Problem) -> list[Row]:
    ripple, steps = felt["ripple"], felt["encoder_step_n"]
    loud = ripple["hands"] - ripple["quiet"] > _FEW_FEEL * ripple["hands"]
    if not loud and sum(steps.values()) <= _NOTICED_STEP_N * problem.device.metres_per_unit:
        return []
    step = (Value(steps["spring"], "force"), "by the spring and", Value(steps["damping"], "force"), "by the damper")
    slow = Value(next(iter(ripple["force_n"].values())), "force")
    quiet = (count(ripple["quiet"]), "of", count(ripple["hands"]), "hands below the vibrotactile threshold")
    text = (step, "per encoder step; ripple", slow, "in slow motion,", quiet)
    return [row("Quantisation", text, mark=doubted(loud))]


def _contact(felt: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return where the force sets in for a moving hand, and rebounds of the released device that exceed its speed."""
    size, rows = problem.device.metres_per_unit, []
    stiffness, noticed = felt["stiffness_n_per_m"], felt["edge_force_n"]
    give, elsewhere = noticed / stiffness if stiffness else 0.0, _ELSEWHERE_M / size
    if not all(depth is not None and -elsewhere < depth < elsewhere + give for depth in felt["edge_m"].values()):
        places = []
        for speed, depth in felt["edge_m"].items():
            where: tuple[Part, ...] = ("no force in the first", Value(REACHED_M / size, "length"))
            if depth is not None:
                where = (Value(abs(depth), "length"), "before the face" if depth < 0 else "behind the face")
            places.append((*where, "at", Value(float(speed), "speed")))
        rows.append(row("Contact onset", listed(places), mark=Mark.CAUTION))
    fast = {speed: share for speed, share in felt["rebound"].items() if share > _FASTER}
    if fast:
        each = listed((Value(share, "number"), "times", Value(float(speed), "speed")) for speed, share in fast.items())
        rows.append(row("Rebound", "the released device leaves the wall at", each, mark=Mark.CAUTION))
    return rows


def _friction(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    leaning, sensed, short = (
        data["with_friction_n_per_m"],
        data["felt"]["stiffness_n_per_m"],
        data["felt"]["rest_error_m"],
    )
    rows = []
    if short is not None and short > _NOTICED_SHORT_M / problem.device.metres_per_unit:
        text = ("holds the handle up to", Value(short, "length"), "from rest")
        rows.append(row("Dry friction", text, mark=Mark.CAUTION))
    if leaning is not None and sensed is not None and leaning > _STIFFER * sensed:
        stiffer = Value(leaning, "stiffness")
        rows.append(row("With friction", "at least", stiffer, "if its help is enough: --lean-on-friction"))
    return rows


def _trade_off(data: Mapping[str, Any]) -> list[Row]:
    """Return what a disk margin costs in impedance error at 1, 10 and 30 Hz, and the ripple of an encoder step."""
    each = []
    for one in data["trade_off"] or ():
        errors = [(Value(share, "share"), ",") for share in one["error"]]
        ripple = ("ripple", Value(one["ripple_n"], "force"), "" if one["met"] else "(contact or decay not met)")
        each.append(("disk margin", Value(one["disk_margin"], "number", 2), ": error", errors, ripple))
    return [row("At 1, 10, 30 Hz", listed(each, ";"))] if each else []


def _limit(data: Mapping[str, Any]) -> list[Row]:
    plain = ("plain coupling", Value(data["plain_wall_n_per_m"], "stiffness"))
    each = [(_change(one), Value(one["stiffest_wall_n_per_m"], "stiffness")) for one in data["what_would_help"]]
    rows = [row("Linear limit", listed([plain, *each[:MOST_HELPS]], ";"))] if each else []
    return rows + [row("What would help", one, rank=1) for one in each[MOST_HELPS:]]


def _change(one: Mapping[str, Any]) -> str:
    return str(one["change"]).removesuffix(" of the device")


def _details(data: Mapping[str, Any]) -> list[Row]:
    """Return the rows of lower rank: margins of each loop, what was simulated, why this one, assumptions."""
    rows = margins_by_loop(data.get("margins", {}))
    if data.get("rest"):
        rows.append(row("Limit cycles", f"{data['rest']['word']}: {data['rest']['sentence']}", rank=1))
    if (trial := data["trial"]) is not None:
        effects = [", ".join(trial.get("effects", ())), ", ".join(trial["motions"])]
        rows.append(row("Simulated effects", "; ".join(filter(None, effects)), rank=1))
    rows.append(row("Reason", data["reason"], rank=1))
    return rows + notes((one for one in data["assumed"] if not one.startswith(SLIP)), "Assumed", Mark.NONE, 1)


def stiffest(data: Mapping[str, Any], problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `recommend --stiffest`."""
    shown, others, limited = shown or name_of(problem), data["confirmed"], data["at_force_limit"]
    rows = [row("Stiffest wall", "none was found", mark=Mark.FAIL)]
    if data["stiffest_wall_n_per_m"] is not None:
        reached = (Value(data["stiffest_wall_n_per_m"], "stiffness"), f"({data['by']})", ":", _settle(data))
        rows = [row("Stiffest wall", reached, mark=settled(data))]
    if limited:
        limit = Value(problem.device.max_force_n, "force")
        at = (count(limited), "of", count(data["hands"]), "presses end at the limit of", limit)
        rows.append(row("Limit", at, mark=Mark.CAUTION))
    if others is not None:
        rows.append(_resting("Confirmed", others))
    if data["plain_wall_n_per_m"]:
        plain = ("plain coupling", Value(data["plain_wall_n_per_m"], "stiffness"))
        rows.append(row("Linear limit", plain, ", with damping of", span(data["damping_ns_per_m"], "damping")))
    else:
        rows.append(row("Linear limit", "a plain coupling is stable at no wall", mark=Mark.CAUTION))
    helps = data["what_would_help"]
    rows += [row(_change(one).capitalize(), Value(one["stiffest_wall_n_per_m"], "stiffness")) for one in helps]
    rows += [*notes(data["assumed"], "Assumed", Mark.NONE, 1), *notes(data["not_used"], "Not used", rank=1)]
    onwards = (f"avc recommend {quote(shown)} --out coupling.json", f"avc recommend {quote(shown)} --stiffest -v")
    return answer("stiffest", data, problem, shown, rows, onwards)
