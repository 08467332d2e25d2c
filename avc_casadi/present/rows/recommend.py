"""Rows of a recommendation: a coupling to a wall, a simulation or a follower."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import singledispatch
from shlex import quote
from typing import Any

from avc_casadi.design.virtual_tool import WIDEST_MARGIN
from avc_casadi.model.corners import Robustness
from avc_casadi.model.ends import End, Follower, Simulation
from avc_casadi.model.problem import Problem
from avc_casadi.present import words
from avc_casadi.present.row import Answer, Mark, Part, Parts, Row, Value, caution, commas, fill, grade, row, span
from avc_casadi.present.rows import subject
from avc_casadi.recommendation.felt import NOTICED_LATE_S, REACHED_M
from avc_casadi.recommendation.rank import UNNOTICED
from avc_casadi.recommendation.recommendation import (
    NoCoupling,
    NoPair,
    NoWallCoupling,
    PairRecommendation,
    Recommendation,
    Verdict,
    WallRecommendation,
)

# Stiffness at rest over that of the wall that is worth a mark.
_STIFFER = 1.1
_CYCLES = {
    "proved": "proved to settle from any state, making and breaking contact",
    "refuted": "a limit cycle without friction exists",
    "open": "freedom from limit cycles is open",
    "simulated": "freedom from limit cycles is simulated, not proved",
}
_SETTLE = "{at_rest:9} of {hands:9} hands settle, {at_rest_without_friction:9} without friction"


def recommendation(recommended: Recommendation, shown: str = "", file: str | None = None) -> Answer:
    """Return the answer of `recommend`; ``file`` holds the coupling."""
    problem, data = recommended.problem, recommended.data()
    onwards = _onwards(recommended)
    if recommended.deployable and file is not None:
        onwards = f"export {quote(file)} --c firmware"
    complaint = "" if recommended.deployable else f"avc: {problem.name}: no coupling is deployable"
    rows = [*rows_of(recommended), *_details(recommended)]
    return subject.answer("recommend", data, problem, shown, rows, onwards, complaint=complaint)


@singledispatch
def rows_of(recommended: Recommendation) -> list[Row]:
    """Return the rows of a recommendation of one kind, the most important first."""
    raise TypeError(f"no rows for {type(recommended).__name__}")


@singledispatch
def _onwards(recommended: Recommendation) -> str:  # noqa: ARG001
    """Return the command to type next."""
    return "recommend {} --out coupling.json"


@_onwards.register
def _onwards_from_none(recommended: NoCoupling) -> str:  # noqa: ARG001
    return "check {}"


@_onwards.register
def _onwards_from_no_wall(recommended: NoWallCoupling) -> str:
    return "recommend {}" if recommended.limits.no_stiffer else "check {}"


@_onwards.register
def _onwards_from_wall(recommended: WallRecommendation) -> str:
    nothing = recommended.verdict is Verdict.NOTHING_RENDERED or recommended.problem.environment.stiffness_n_per_m == 0
    if not recommended.deployable and (nothing or _slips(recommended)):
        return "check {}"
    if recommended.limits.no_stiffer:
        return "recommend {} --stiffest --out coupling.json"
    if not recommended.deployable or _far(recommended.data()):
        return "recommend {} --stiffest"
    return "recommend {} --out coupling.json"


def verdict(data: Mapping[str, Any], rows: Sequence[Row]) -> tuple[str, bool]:
    """Return the verdict in a line, and whether it is a yes."""
    if data["coupling"] is None:
        return f"Deploy nothing: {data['reason'].partition(';')[0]}.", False
    if not data["deployable"]:
        return f"Do not deploy this coupling: {data['reason']}.", False
    doubtful = (shown.label for shown in rows if shown.mark in {Mark.CAUTION, Mark.FAIL})
    doubts = ", ".join(dict.fromkeys(doubtful))
    return f"Deploy this coupling{f'; see {doubts}' if doubts else ''}.", True


@rows_of.register
def _no_wall_rows(recommended: NoWallCoupling) -> list[Row]:
    data = recommended.data()
    none = row("Coupling", f"none is deployable: {recommended.reason}", mark=Mark.FAIL)
    return [*_slips(recommended), none, *_limit(data)]


@rows_of.register
def _wall_rows(recommended: WallRecommendation) -> list[Row]:
    return wall_rows(recommended, recommended.data())


def wall_rows(recommended: WallRecommendation, data: Mapping[str, Any]) -> list[Row]:
    """Return the rows of a coupling to a wall, of its data."""
    problem = recommended.problem
    failed, rest = _failed(data), data["rest"]
    text = f"linearly stable with every corner hand and released; {_CYCLES[rest['word']]}" if not failed else failed[0]
    stable = row("Stability", text, mark=Mark.FAIL if failed else grade(rest["word"] != "refuted", Mark.CAUTION))
    stiffest: list[Row] = []
    if data["stiffest_wall_n_per_m"]:
        text = f"{{stiffest_wall_n_per_m}}, within {100 * UNNOTICED:.0f} % to a hand that moves; {data['no_stiffer']}"
        stiffest = [row("Stiffest wall", fill(text, data)), *_limit(data)]
    first = [*_slips(recommended), *stiffest, _coupling(recommended, data), *_rendered(recommended, data), stable]
    if not recommended.deployable:
        return [*first, *_simulated(data)]
    limit, period_s = problem.device.max_force_n, problem.device.sample_time_s
    worst, trade_off = data["transient"]["worst_hand"], []
    for trade in data["trade_off"] or ():
        errors = commas(Value(share, "share") for share in trade["error"])
        missed = "" if trade["met"] else "(contact or decay not met)"
        point = fill("disk margin {disk_margin:2}: error", trade)
        trade_off.append((point, errors, fill(", ripple {ripple_n}", trade), missed))
    return [
        *first,
        subject.smallest_margins(data["margins"]),
        subject.settling(*max((transient["settling_s"], who) for who, transient in data["transient"].items())),
        subject.damping_ratio(worst["damping_ratio"], worst["frequency_hz"], "worst_hand", period_s),
        *([row("At 1, 10, 30 Hz", commas(trade_off, ";"))] if trade_off else []),
        *_simulated(data),
        *_unmodelled(data),
        subject.peak_force(data["trial"], limit, data["trial"]["at_force_limit"]),
        *_contact(data, problem),
        *subject.notes(words.used_by_solve(recommended.not_used), "Not used", Mark.NONE),
        *([] if stiffest else _limit(data)),
    ]


def _far(data: Mapping[str, Any]) -> bool:
    """Whether a hand that moves notices that it is not the wall."""
    return any(data["felt"].get("complex_error", {}).get(hz, 0.0) > UNNOTICED for hz in ("1", "10"))


def _slips(recommended: Recommendation) -> list[Row]:
    doubts = [assumption.text for assumption in recommended.assumed if assumption.slip]
    return [row("Values", "; ".join(doubts), mark=Mark.CAUTION)] if doubts else []


def _coupling(recommended: WallRecommendation, data: Mapping[str, Any]) -> Row:
    problem = recommended.problem
    coupling = data["coupling"]
    trial = data["trial"]
    felt = data["felt"]
    wall = problem.environment.stiffness_n_per_m
    runtime, rows = coupling["runtime"], len(coupling["table"]["frequency_hz"])
    law = runtime["state_feedback"]
    parts = commas(
        [
            None if law is None else f"observer ({len(law['innovation'])} states) with state feedback",
            subject.gains(coupling["table"], problem),
            None if runtime["observer_mass_kg"] is None else fill("observer of assumed {observer_mass_kg}", runtime),
            None if rows == 1 else f"{rows} rows",
        ]
    )
    if not recommended.deployable:
        told = recommended.verdict is Verdict.NOTHING_RENDERED or _failed(data)  # in another row
        return row("Coupling", parts, ": NOT deployable", "" if told else f": {recommended.reason}", mark=Mark.FAIL)
    names = ", ".join(unused.key for unused in recommended.not_used if not unused.asked_of_solve)
    doubt: tuple[Part, ...] = ()
    if trial["at_force_limit"] > trial["hands"] / 2:
        through = ", but {at_force_limit:9} of {hands:9} hands push through the wall (limit {max_force_n})"
        doubt = fill(through, {**trial, "max_force_n": problem.device.max_force_n})
    elif wall > 0:
        moving = felt["stiffness_in_motion_n_per_m"].get("1", wall)
        if min(felt["share_of_wall"] or 1.0, moving / wall) < 0.1:
            doubt = (", but hardly anything of the wall is rendered to a moving hand",)
    without = f"without {names}, which is declared and not used" if names else ""
    low = subject.thin(min(margins["disk"] for margins in data["margins"].values()))
    mark = Mark.CAUTION if doubt or without or low else Mark.PASS
    return row("Coupling", parts, ": deployable", without, doubt, low, mark=mark)


def _rendered(recommended: WallRecommendation, data: Mapping[str, Any]) -> list[Row]:
    felt = data["felt"]
    trial = data["trial"]
    wall = recommended.problem.environment
    errors = commas((Value(error, "share"), f"at {hz} Hz") for hz, error in felt["complex_error"].items())

    def moving(key: str) -> dict[str, float]:
        return {hz: value for hz, value in felt[key].items() if float(hz) <= 10}  # a hand moves no faster

    if wall.stiffness_n_per_m == 0:
        damping = moving("damping_in_motion_ns_per_m")
        off = any(abs(value / wall.damping_ns_per_m - 1) > UNNOTICED for value in damping.values())
        dampers = commas((Value(value, "damping"), f"at {hz} Hz") for hz, value in damping.items())
        error = row("Impedance error", errors, "of the whole cycle: a wall never pulls")
        return [row("Rendered", "damper of", dampers, mark=caution(off)), error]
    if recommended.verdict is Verdict.NOTHING_RENDERED:
        return [row("Rendered", recommended.reason, mark=Mark.FAIL)]
    if felt["stiffness_n_per_m"] is None:
        return [row("Rendered", "nothing: every press reaches the limit", mark=Mark.FAIL)]
    sensed = felt["stiffness_n_per_m"]
    share = felt["share_of_wall"]
    handle = felt["stiffness_at_handle_n_per_m"]
    motion, low_high = moving("stiffness_in_motion_n_per_m"), trial["stiffness_n_per_m"]["nine_in_ten"]
    wanted = {hz: wall.stiffness_n_per_m + 2j * math.pi * float(hz) * wall.damping_ns_per_m for hz in motion}
    stiffer = any(value > (1 + UNNOTICED) * abs(wanted[hz]) for hz, value in motion.items())
    spread = min(low_high) < 0.9 * sensed or max(low_high) > 1.1 * sensed
    stiffnesses = [
        (Value(handle, "stiffness"), "static (", Value(share * handle / sensed, "share"), "of the wall)"),
        *((Value(value, "stiffness"), f"at {hz} Hz") for hz, value in motion.items()),
        None if handle == sensed else fill("{stiffness_n_per_m} at the sensor", felt),
        (span(low_high, "stiffness"), "over 90 % of hands") if spread else None,
        "above the wall in motion, damping included" if stiffer else None,
    ]
    worst = max(moving("complex_error").values(), default=0.0)
    sine = fill(", sine of {amplitude_m}", felt["shaken"])
    return [
        row("Rendered", commas(stiffnesses), mark=caution(stiffer or share > _STIFFER)),
        row("Impedance error", errors, sine, mark=caution(worst > max(UNNOTICED, 1 - share))),
    ]


def _failed(data: Mapping[str, Any]) -> list[str]:
    return [claim["sentence"] for claim in data["certificate"]["deployable"]["claims"] if not claim["pass"]]


def _loud(trial: Mapping[str, Any]) -> bool:
    """Whether many hands may notice a vibration at rest."""
    return bool(trial["hands"] - trial["quiet"] > 0.1 * trial["hands"])


def _simulated(data: Mapping[str, Any]) -> list[Row]:
    total, off = data["simulated"], data["off_file"]
    quiet = fill(f"{_SETTLE}; {{quiet:9}} below the vibrotactile threshold", total)
    rows = [row("Simulated", quiet, mark=subject.settled(total, doubt=_loud(total)))]
    if off is not None:
        unstable = fill("; linearly unstable on {linearly_unstable}", off) if off["linearly_unstable"] else None
        on = fill(f"{_SETTLE} on {{devices:9}} devices with values changed by {{share}}", off)
        rows.append(row("Model mismatch", on, unstable, mark=subject.settled(off, doubt=bool(unstable))))
    return rows


def _unmodelled(data: Mapping[str, Any]) -> list[Row]:
    """Return how many hands settle with each unmodelled effect, and how many of those that hold the device."""
    rows = []
    for label, held in (("Unmodelled", False), ("Declared grip", True)):
        whole, texts = True, list[tuple[Part, ...]]()
        for trial in (trial for trial in data["beyond_file"] if (trial["key"] == "held") is held):
            # A requirement is met, if not without dry friction, then with it where that may be counted on.
            key = "at_rest" if trial["asked"] and trial["at_rest"] is not None else "at_rest_without_friction"
            whole = whole and trial[key] == trial["at_rest_without_friction"] == trial["hands"]
            effect = "{value:share} less mass" if trial["key"] == "mass_share" else "{value:share} of samples lost"
            if held:
                effect = "one fingertip" if trial["value"] == "fingertip" else "hands on a {value}"
            texts.append(fill(f"{{{key}:9}}{'' if texts else ' of {hands:9} hands settle'} with {effect}", trial))
        if texts:
            rows.append(row(label, commas(texts), mark=grade(whole, Mark.CAUTION)))
    return rows


def _contact(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return encoder steps, contact onset and leaving, rebound and dry friction where a hand may notice them."""
    rows = []
    felt = data["felt"]
    size = problem.device.metres_per_unit
    ripple = felt["ripple"]
    steps = felt["encoder_step_n"]
    short = felt["rest_error_m"]
    if _loud(ripple) or sum(steps.values()) > 0.1 * size:
        known = {**ripple, **steps, "slow_n": next(iter(ripple["force_n"].values()))}
        damper = " and {damping:force} by the damper" * bool(steps["damping"])
        step = fill(f"{{spring:force}} by the spring{damper} per encoder step;", known)
        quiet = fill("ripple {slow_n} in slow motion, {quiet:9} of {hands:9} hands below the threshold", known)
        rows.append(row("Quantisation", step, quiet, mark=caution(_loud(ripple))))
    stiffness, elsewhere = felt["stiffness_n_per_m"], 5e-4 / size
    give = felt["edge_force_n"] / stiffness if stiffness else 0.0
    if not all(depth is not None and -elsewhere < depth < elsewhere + give for depth in felt["edge_m"].values()):
        depths = felt["edge_m"]
        speed = max(depths, key=lambda known: math.inf if depths[known] is None else abs(depths[known]))
        depth = depths[speed]
        side = "before the wall's face" if depth is not None and depth < 0 else "inside the wall"
        begins = Value(REACHED_M / size if depth is None else abs(depth), "length")
        onset = "force from" if depth is not None else "no force up to", begins, side
        rows.append(row("Contact onset", onset, "at", Value(float(speed), "speed"), mark=Mark.CAUTION))
    if leaving := felt["leaving"]:
        late, pushes = leaving["lasting_s"] > NOTICED_LATE_S, "no noticeable force outside"
        if leaving["lasting_s"] > 0:
            pushes = "up to {force_n} for {lasting_s} outside the wall, until {outside_m}"
        text = fill(f"{pushes}; a hand withdraws in {{withdrawn_s}}", leaving)
        rows.append(row("Leaving contact", text, mark=caution(late), rank=0 if late else 1))
    if (slow := felt["creep"]) is not None and slow["play_n"] > felt["edge_force_n"]:
        who = "a hand" if slow["speed_m_per_s"] is None else fill("a hand slower than {speed_m_per_s}", slow)
        rows.append(row("Slow press", who, fill("feels a change of force only after {play_m} ({play_n})", slow)))
    if fast := {speed: share for speed, share in felt["rebound"].items() if share > 1.02}:
        exits = ((Value(share, "number"), "times", Value(float(speed), "speed")) for speed, share in fast.items())
        rows.append(row("Rebound", "the released device leaves the wall at", commas(exits), mark=Mark.CAUTION))
    if short is not None and short > 1e-3 / size:
        far = fill("holds the handle up to {rest_error_m} from rest", felt)
        rows.append(row("Dry friction", far, mark=Mark.CAUTION))
    return rows


def _limit(data: Mapping[str, Any]) -> list[Row]:
    changes = [
        (str(change["change"]).removesuffix(" of the device"), fill("{stiffest_wall_n_per_m}", change))
        for change in data["what_would_help"]
    ]
    limit = fill("plain coupling {plain_wall_n_per_m}", data)
    return [row("Linear limit", commas([limit, *changes[:3]], ";"))] if changes else []


def _details(recommended: Recommendation) -> list[Row]:
    """Return the rows of lower rank: limit cycles, what was simulated, why this one, assumptions."""
    data = recommended.data()
    rest = data.get("rest")
    rows = [row("Limit cycles", f"{rest['word']}: {rest['sentence']}", rank=1)] if rest else []
    if (trial := data["trial"]) is not None:
        effects = [", ".join(trial.get("effects", ())), ", ".join(trial["motions"])]
        rows.append(row("Simulated effects", "; ".join(filter(None, effects)), rank=1))
    far = _far(data)
    rows.append(row("Reason", data["reason"], mark=caution(far), rank=0 if far else 1))
    assumed = (assumption.text for assumption in recommended.assumed if not assumption.slip)
    return rows + subject.notes(assumed, "Assumed", Mark.NONE, 1)


@rows_of.register
def _no_pair_rows(recommended: NoPair) -> list[Row]:
    none = row("Coupling", f"none is deployable: {recommended.reason}", mark=Mark.FAIL)
    # Where K is linearly stable hands refute it: what else is linearly stable with it is no help.
    wanted = recommended.pair.wanted_n_per_m
    refuted = wanted is not None and wanted <= recommended.pair.stiffest.stiffness_n_per_m
    same = [] if refuted else _same_k(recommended.data()["pair"], recommended.problem)
    return [none, *same, *_pair_limit(recommended)]


@rows_of.register
def _pair_rows(recommended: PairRecommendation) -> list[Row]:
    data = recommended.data()
    problem = recommended.problem
    pair = data["pair"]
    k, local = recommended.coupling.gains.stiffness_n_per_m, subject.local_damper(recommended.end)
    soft = recommended.pair.wanted_n_per_m is None and k < problem.hands.stiffness_n_per_m[0]
    doubt, softer = grade(not soft and not thin(pair), Mark.CAUTION), ": softer than the softest hand" * soft
    rows = [row("Coupling", subject.pair(pair["gains"], local), softer, mark=doubt)]
    for where, there in (("in the scene", pair["in_scene"]), ("at the follower", pair["at_follower"])):
        if there and there != pair["gains"]:
            rows.append(row("Scaled", where, subject.pair(there, local)))
    rows += [*felt_rows(data["felt"]), *stability(recommended.end, pair)]
    if recommended.pair.passivity_margin_ns_per_m is not None:
        passive = recommended.pair.passivity_margin_ns_per_m >= 0
        needed = "not for any operator: that needs {passive_damping_ns_per_m} a device"
        text = fill("for any operator and environment" if passive else needed, pair)
        rows.append(row("Passivity", text, mark=grade(passive, Mark.CAUTION)))
    rows.append(_pair_simulated(data["trial"]))
    rows.append(subject.peak_force(data["trial"], problem.device.max_force_n))
    if recommended.pair.set_by:
        rows.append(row("K is set by", f"hands: {recommended.pair.set_by}"))
    return [*rows, *_same_k(pair, problem, rank=1), *_pair_limit(recommended)]


def _pair_limit(recommended: NoPair | PairRecommendation) -> list[Row]:
    """Return the stiffest coupling by linear stability, what would help, and what is declared and not used."""
    data = recommended.data()
    stiffest = data["pair"]["stiffest"]
    limit = fill("K {stiffness_n_per_m}", stiffest) if stiffest["stiffness_n_per_m"] else ("no K is stable",)
    helps = [(change["change"], fill("{stiffest_n_per_m}", change)) for change in data["what_would_help"][:3]]
    return [row("Linear limit", commas([limit, *helps], ";")), *subject.not_used(recommended.not_used)]


def felt_rows(felt: Mapping[str, Any]) -> list[Row]:
    """Return what the handle meets: on a rigid object, on the stiffest declared contact, and in free motion."""
    if not felt["at"]:
        return []
    rows, first = [], felt["at"][0]
    if felt["on_stiffest_contact_n_per_m"] is not None:
        rows.append(row("Declared contact", fill("{on_stiffest_contact_n_per_m} pressed", felt)))
    pressed = None if felt["stiffness_n_per_m"] is None else fill("{stiffness_n_per_m} pressed", felt)
    stiff = [fill(f"{{stiffness_n_per_m}} at {point['frequency_hz']:g} Hz", point) for point in felt["at"]]
    rows.append(row("Rigid object", commas([pressed, *stiff])))
    if first["mass_kg"] is not None:
        mass: Part = "a restoring spring" if first["mass_kg"] < 0 else Value(first["mass_kg"], "mass")
        drag = fill(f", drag {{drag_ns_per_m}} at {first['frequency_hz']:g} Hz; impedance error", first)
        points = ((Value(point["free_error"], "share"), f"at {point['frequency_hz']:g} Hz") for point in felt["at"])
        errors = commas(points)
        far = max(point["free_error"] for point in felt["at"]) > 1
        rows.append(row("Free motion", mass, drag, errors, mark=caution(far)))
    elif first["drag_ns_per_m"]:
        rows.append(row("Drag", fill("{drag_ns_per_m} wherever the device is, by its own dampers", first)))
    return rows


def thin(certificate: Mapping[str, Any]) -> bool:
    """Return whether the gain margins of a pair are too small for a tick."""
    return bool(certificate["gain_margin"] < 1.5 or min(certificate["motor_margins"]) < Robustness().gain_margin)


def stability(end: End, certificate: Mapping[str, Any]) -> list[Row]:
    """Return whether all loops to an end are stable, with their margins, and the worst or least damped of them."""
    rows, mode = [], certificate["least_damped"]
    if not certificate.get("stable", True):
        rows.append(row("Stability", fill("not all of {loops:9} loops are stable", certificate), mark=Mark.FAIL))
    else:
        steady = certificate.get("mismatch_stable") is not False
        text = f"corner hands, released, end stop: {{loops:9}} loops{'' if steady else '; not on devices 10 % away'}"
        rows.append(row("Stability", fill(text, certificate), mark=grade(steady, Mark.CAUTION)))
        factors = [
            f"{math.floor(100 * margin) / 100:.3g}" if margin < WIDEST_MARGIN else f"{WIDEST_MARGIN:g} or more"
            for margin in (certificate["gain_margin"], *certificate["motor_margins"])
        ]
        loops = ("K and B", "the motor alone", "the follower's")
        margins = ", ".join(f"{factor} of {loop}" for factor, loop in zip(factors, loops, strict=False))
        rows.append(row("Gain margin", margins, ": thin" * thin(certificate), mark=caution(thin(certificate))))
    if case := certificate.get("worst"):
        place, ticks = worst_end(end, case)
        radius = fill(f"; spectral radius {{spectral_radius:6}} {ticks}", {**case, **certificate})
        rows.append(row("Worst loop", subject.hand(case["hand"]), ";" if place else None, place, radius))
    if certificate.get("stable", True) and mode["damping_ratio"] < 1:
        rows.append(row("Damping ratio", fill("{damping_ratio:2} at {frequency_hz} (least damped loop)", mode)))
    return rows


@singledispatch
def worst_end(end: End, case: Mapping[str, Any]) -> tuple[Parts, str]:  # noqa: ARG001
    """Return an end in the worst loop, and the ticks by which its spectral radius counts."""
    return None, "a sample"


@worst_end.register
def _worst_tool(end: Simulation, case: Mapping[str, Any]) -> tuple[Parts, str]:  # noqa: ARG001
    tool = case["tool"]
    on = _in_contact(tool["contact_stiffness_n_per_m"])
    at = "fixed place" if tool["mass_kg"] is None else (*fill("tool of {mass_kg},", tool), on)
    return at, "a step of {step_s}"


@worst_end.register
def _worst_follower(end: Follower, case: Mapping[str, Any]) -> tuple[Parts, str]:  # noqa: ARG001
    at = *fill("follower of {mass_kg},", case["follower"]), _in_contact(case["environment_n_per_m"])
    return at, "a sample, at the worst phase of the clocks"


def _in_contact(stiffness_n_per_m: float | None) -> Parts:
    """Return what a body touches: nothing, a spring, or where the stiffness is None a rigid object."""
    if stiffness_n_per_m is None:
        return "held rigidly"
    return ("on", Value(stiffness_n_per_m, "stiffness")) if stiffness_n_per_m else "free"


def _pair_simulated(trial: Mapping[str, Any]) -> Row:
    text, settle = f"{{settled:9}} of {{hands:9}} hands settle ({', '.join(trial['motions'])})", [trial["settled"]]
    if "settled_without_friction" in trial:
        settle += [trial["settled_without_friction"], trial["settled_with_dropped_steps"]]
        text += ", {settled_without_friction:9} without friction"
        text += ", {settled_with_dropped_steps:9} with {dropped_share} of the steps missed"
    elif "jitter" in trial:
        text += "; {jitter:share} of jitter, {lost_share} lost"
    mark = grade(min(settle) == trial["hands"], Mark.CAUTION if len(settle) > 1 else Mark.FAIL)
    return row("Simulated", fill(text, trial), mark=mark)


def _same_k(pair: Mapping[str, Any], problem: Problem, rank: int = 0) -> list[Row]:
    """Return lightest tool, slowest step and exchanges with which the same K is linearly stable, each with its B."""
    texts = {
        "least_tool_mass_kg": "a tool from {least_tool_mass_kg}",
        "slowest_step_s": "a step up to {slowest_step_s}",
    }
    conditions: list[tuple[Part, ...]] = []
    for key, gains in sorted(pair["same_k"].items(), key=lambda item: [*texts, item[0]].index(item[0])):
        local = " and {local_damping_ns_per_m} of the device" * bool(gains["local_damping_ns_per_m"])
        with_b = fill(f"with B {{damping_ns_per_m}}{local}", gains)
        conditions.append((*fill(texts.get(key, f"exchange {key}"), pair), *with_b))
    if pair["exchanges"] and not any(pair["exchanges"].values()):
        conditions.append(("no exchange",))
    margin = f"; linearly, gain margin {problem.robustness.gain_margin:g}"
    return [row("Same K", commas(conditions), margin, rank=rank)] if conditions else []
