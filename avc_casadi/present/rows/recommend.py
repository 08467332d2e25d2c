"""Rows of a recommendation: a coupling to a wall, and the stiffest wall."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi.present.row import Answer, Mark, Part, Quantity, Row, Value, count, listed, marked, parts, row, span
from avc_casadi.present.rows.pair import AT_LIMIT, MOST_HELPS, pair_rows
from avc_casadi.present.rows.subject import (
    gains,
    headline,
    name_of,
    notes,
    settled,
    thin,
)
from avc_casadi.recommendation.contact_onset import REACHED_M
from avc_casadi.recommendation.preconditions import SLIP, asked_of_others, not_judged

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.recommendation import Recommendation

# An impedance error of a hand's motion above which it feels unlike a static press.
_SOFTER = 0.2
# Impedance of device and wall together over that of the wall below which errors are relative to hardly anything.
_RESONANT = 0.3
# Frequencies up to this are those of hands; a longer settling time is marked.
_OF_HANDS_HZ, _SLOW_S = 10.0, 1.0
# Half of the usual margins, 6 dB and 20 degrees.
_THIN_GAIN, _THIN_DEG = 10 ** (3 / 20), 10.0
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


def recommendation(found: Recommendation, shown: str = "", written: str | None = None) -> Answer:
    """Return the answer of `recommend`; ``written`` is the file that holds the coupling."""
    problem, data, shown = found.problem, found.data(), shown or name_of(found.problem)
    rows = wall_rows(data, problem) if found.pair is None else pair_rows(data, problem)
    if written is not None:
        rows.append(row("Written", written))
    rows += _details(data)
    onwards = f"avc recommend {quote(shown)} --out coupling.json"
    nothing = data["reason"].startswith("nothing") or problem.environment.stiffness_n_per_m == 0
    if found.deployable and written is not None:
        onwards = f"avc export {quote(written)} --c firmware"
    elif found.coupling is None or (not found.deployable and (nothing or _slips(data))):
        onwards = f"avc check {quote(shown)}"
    elif not found.deployable:
        onwards = f"avc recommend {quote(shown)} --stiffest"
    return Answer(
        "recommend",
        data,
        headline(problem, shown),
        tuple(rows),
        (onwards, f"avc recommend {quote(shown)} -v"),
        problem.units,
        code=0 if found.deployable else 1,
        complaint="" if found.deployable else f"avc: {problem.name}: no coupling is deployable",
    )


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
    found = [*_slips(data), _coupling(data, problem), *_rendered(data, problem), *_stability(data)]
    if data["deployable"]:
        found += [*_margins(data), *_trade_off(data)]
    found += _simulated(data)
    if not data["deployable"]:
        return found
    return [
        *found,
        *_unmodelled(data),
        *_tap(data, problem),
        *_contact(data, problem),
        *_friction(data, problem),
        *notes(asked_of_others(data["not_used"]), "Not used", Mark.NONE),
        *_limit(data),
    ]


def _slips(data: Mapping[str, Any]) -> list[Row]:
    told = [what.removeprefix(SLIP) for what in data["assumed"] if what.startswith(SLIP)]
    return [row("Values", "; ".join(told), mark=Mark.CAUTION)] if told else []


def _coupling(data: Mapping[str, Any], problem: Problem) -> Row:
    coupling, trial = data["coupling"], data["trial"]
    runtime, law = coupling["runtime"], coupling["runtime"]["state_feedback"]
    found: list[Any] = [
        None if law is None else f"observer ({len(law['innovation'])} states) with state feedback",
        gains(coupling["table"], problem),
    ]
    if runtime["observer_mass_kg"] is not None:
        found.append(("observer of assumed", Value(runtime["observer_mass_kg"], "mass")))
    if not coupling["constant"]:
        found.append(f"{len(coupling['table']['frequency_hz'])} rows")
    if not data["deployable"]:
        named = data["reason"].startswith("nothing") or _failed(data)
        why = "" if named else f": {data['reason']}"
        return row("Coupling", listed(found), ": NOT deployable", why, mark=Mark.FAIL)
    wall, felt = problem.environment.stiffness_n_per_m, data["felt"]
    names = [what.partition(" (")[0] for what in not_judged(data["not_used"])]
    doubt: tuple[Part, ...] = ()
    if trial["at_force_limit"] > _PUSH_THROUGH * trial["hands"]:
        limit = Value(coupling["max_force_n"], "force")
        doubt = (
            ", but",
            count(trial["at_force_limit"]),
            "of",
            count(trial["hands"]),
            "hands push through the wall (limit",
            limit,
            ")",
        )
    elif (
        wall > 0
        and min(felt["share_of_wall"] or 1.0, felt["stiffness_in_motion_n_per_m"].get("1", wall) / wall) < _HARDLY
    ):
        doubt = (", but hardly anything of the wall is rendered to a moving hand",)
    without = f"without {', '.join(names)}, which is declared and not used" if names else ""
    low = thin(min(one["disk"] for one in data["margins"].values()))
    mark = Mark.CAUTION if doubt or without or low else Mark.PASS
    return row("Coupling", listed(found), ": deployable", without, doubt, low, mark=mark)


def _rendered(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    felt, trial, wall = data["felt"], data["trial"], problem.environment
    errors = listed((Value(error, "share"), f"at {hz} Hz") for hz, error in felt["complex_error"].items())
    moving = {hz: one for hz, one in felt["stiffness_in_motion_n_per_m"].items() if float(hz) <= _OF_HANDS_HZ}
    if wall.stiffness_n_per_m == 0:
        damping = {hz: one for hz, one in felt["damping_in_motion_ns_per_m"].items() if float(hz) <= _OF_HANDS_HZ}
        off = any(abs(one / wall.damping_ns_per_m - 1) > _SOFTER for one in damping.values())
        found = listed((Value(one, "damping"), f"at {hz} Hz") for hz, one in damping.items())
        error = row("Impedance error", errors, "of the whole cycle: a wall never pulls")
        return [row("Rendered", "damper of", found, mark=Mark.CAUTION if off else Mark.NONE), error]
    if felt["stiffness_n_per_m"] is None or data["reason"].startswith("nothing"):
        what = data["reason"] if data["reason"].startswith("nothing") else "nothing: every press reaches the limit"
        return [row("Rendered", what, mark=Mark.FAIL)]
    sensed, share, handle = felt["stiffness_n_per_m"], felt["share_of_wall"], felt["stiffness_at_handle_n_per_m"]
    stiffer = any(
        one > (1 + _SOFTER) * math.hypot(wall.stiffness_n_per_m, 2 * math.pi * float(hz) * wall.damping_ns_per_m)
        for hz, one in moving.items()
    )
    low, high = trial["stiffness_n_per_m"]["nine_in_ten"]
    stiffnesses = [
        (Value(sensed, "stiffness"), "static (", Value(share, "share"), "of the wall)"),
        *((Value(one, "stiffness"), f"at {hz} Hz") for hz, one in moving.items()),
        None if handle == sensed else (Value(handle, "stiffness"), "at the handle"),
        None if 0.9 * sensed <= low <= high <= 1.1 * sensed else (span((low, high), "stiffness"), "over 90 % of hands"),
        "above the wall in motion, damping included" if stiffer else None,
    ]
    worst = max((error for hz, error in felt["complex_error"].items() if float(hz) <= _OF_HANDS_HZ), default=0.0)
    near = _near_resonance(felt["complex_error"], problem)
    sine = (", sine of", Value(felt["shaken"]["amplitude_m"], "length"))
    return [
        row("Rendered", listed(stiffnesses), mark=Mark.CAUTION if stiffer or share > _STIFFER else Mark.NONE),
        row(
            "Impedance error",
            errors,
            sine,
            f"; resonance of device and wall near {' and '.join(near)}, where |Z| is small" if near else "",
            mark=Mark.CAUTION if worst > max(_SOFTER, 1 - share) else Mark.NONE,
        ),
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


def _stability(data: Mapping[str, Any]) -> list[Row]:
    failed, rest = _failed(data), data["rest"]["word"]
    if failed:
        return [row("Stability", failed[0], mark=Mark.FAIL)]
    linear = "linearly stable with every corner hand and released"
    cycles = {
        "proved": "proved to settle from any state, making and breaking contact",
        "refuted": "a limit cycle without friction exists",
        "open": "freedom from limit cycles is open",
        "simulated": "freedom from limit cycles is simulated, not proved",
    }[rest]
    mark = Mark.CAUTION if rest == "refuted" else Mark.PASS
    return [row("Stability", f"{linear}; {cycles}", mark=mark)]


_WHO = {"released": "released", "worst_hand": "worst corner hand"}


def _margins(data: Mapping[str, Any]) -> list[Row]:
    """Return the smallest margins and the loop of each, the settling time, and the least damped oscillation."""
    smallest: dict[str, tuple[float | None, str]] = {}
    for key in ("gain", "phase_deg", "delay_samples", "disk"):
        known = [(one[key], _WHO[who]) for who, one in data["margins"].items() if one[key] is not None]
        smallest[key] = min(known, default=(None, ""))
    gain, phase = smallest["gain"][0], smallest["phase_deg"][0]
    thin = (gain is not None and gain < _THIN_GAIN) or (phase is not None and phase < _THIN_DEG)
    kinds: tuple[tuple[str, str, Quantity], ...] = (
        ("gain", "gain", "gain"),
        ("phase_deg", "phase", "phase"),
        ("delay_samples", "delay", "samples"),
        ("disk", "disk", "number"),
    )
    whose = [smallest[key][1] for key, _, _ in kinds]
    alike = len({*whose}) == 1
    found = [
        (word, Value(smallest[key][0], of), f"({who})" if who and not (alike and place < 3) else "")
        for place, ((key, word, of), who) in enumerate(zip(kinds, whose, strict=True))
    ]
    free, held = data["transient"]["released"], data["transient"]["worst_hand"]
    seconds = "never" if free["settling_s"] is None else Value(free["settling_s"], "time")
    slow = free["settling_s"] is None or free["settling_s"] > _SLOW_S
    nyquist_hz = 0.5 / data["coupling"]["sample_time_s"]
    damped: tuple[Part, ...] = ("no oscillation below the Nyquist frequency",)
    if 0 < held["frequency_hz"] < 0.99 * nyquist_hz:
        damped = (Value(held["damping_ratio"], "number", 2), "at", Value(held["frequency_hz"], "frequency"))
    return [
        row("Margins", listed(found), mark=Mark.CAUTION if thin else Mark.NONE),
        row("Settling time", seconds, "(released)", mark=Mark.CAUTION if slow else Mark.NONE),
        row("Damping ratio", damped, "(worst corner hand)"),
    ]


def _simulated(data: Mapping[str, Any]) -> list[Row]:
    total, off = data["simulated"], data["off_file"]
    mark = settled(total)
    if mark is Mark.PASS and total["hands"] - total["quiet"] > _FEW_FEEL * total["hands"]:
        mark = Mark.CAUTION
    quiet = (";", count(total["quiet"]), "below the vibrotactile threshold")
    rows = [row("Simulated", _resting(total), quiet, mark=mark)]
    if off is None:
        return rows
    unstable = off["linearly_unstable"]
    mark = Mark.CAUTION if unstable and off["at_rest"] == off["hands"] else settled(off)
    devices = ("on", count(off["devices"]), "devices with values changed by", Value(off["share"], "share"))
    more = ("; linearly unstable on", count(unstable)) if unstable else None
    return [*rows, row("Model mismatch", _resting(off), devices, more, mark=mark)]


def _resting(found: Mapping[str, Any]) -> tuple[Part, ...]:
    free = ("settle,", count(found["at_rest_without_friction"]), "without friction")
    return (count(found["at_rest"]), "of", count(found["hands"]), "hands", *free)


def _unmodelled(data: Mapping[str, Any]) -> list[Row]:
    """Return how many hands settle with each unmodelled effect, and how many of those that hold the device."""
    rows = []
    for label, found in (
        ("Unmodelled", [one for one in data["beyond_file"] if one["key"] != "held"]),
        ("Declared grip", [one for one in data["beyond_file"] if one["key"] == "held"]),
    ):
        if not found:
            continue
        # A requirement is met, if not without dry friction, then with it where that may be counted on.
        counted = [
            "at_rest" if one["asked"] and one["at_rest"] is not None else "at_rest_without_friction" for one in found
        ]
        each = listed(
            (
                count(one[key]),
                None if place else ("of", count(one["hands"]), "hands settle"),
                "with",
                _effect(one),
            )
            for place, (one, key) in enumerate(zip(found, counted, strict=True))
        )
        whole = all(one[key] == one["hands"] for one, key in zip(found, counted, strict=True))
        free = all(one["at_rest_without_friction"] == one["hands"] for one in found)
        mark = Mark.PASS if whole and free else Mark.CAUTION
        rows.append(row(label, each, mark=mark))
    return rows


def _effect(one: Mapping[str, Any]) -> tuple[Part, ...]:
    value = one["value"]
    if one["key"] == "held":
        return ("one fingertip" if value == "fingertip" else f"hands on a {value}",)
    return (Value(value, "share"), "less mass" if one["key"] == "mass_share" else "of samples lost")


def _tap(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    trial, limit, felt = data["trial"], data["coupling"]["max_force_n"], data["felt"]
    ripple, steps = felt["ripple"], felt["encoder_step_n"]
    tap = Value(trial["tap_force_n"], "force")
    rows = [row("Peak force", tap, "in a tap,", Value(trial["tap_depth_m"], "length"), "deep")]
    if limit is not None and trial["tap_force_n"] >= AT_LIMIT * limit:
        presses = ("; so do", count(trial["at_force_limit"]), "presses") if trial["at_force_limit"] else None
        rows = [row("Peak force", "a tap saturates at", Value(limit, "force"), presses, mark=Mark.CAUTION)]
    loud = ripple["hands"] - ripple["quiet"] > _FEW_FEEL * ripple["hands"]
    if loud or sum(steps.values()) > _NOTICED_STEP_N * problem.device.metres_per_unit:
        step = (Value(steps["spring"], "force"), "by the spring and", Value(steps["damping"], "force"), "by the damper")
        slow = Value(next(iter(ripple["force_n"].values())), "force")
        quiet = (count(ripple["quiet"]), "of", count(ripple["hands"]), "hands below the vibrotactile threshold")
        mark = Mark.CAUTION if loud else Mark.NONE
        rows.append(row("Quantisation", step, "per encoder step; ripple", slow, "in slow motion,", quiet, mark=mark))
    return rows


def _contact(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return where the force sets in for a moving hand, and rebounds of the released device that exceed its speed."""
    felt, size, rows = data["felt"], problem.device.metres_per_unit, []
    stiffness, noticed = felt["stiffness_n_per_m"], felt["edge_force_n"]
    give, elsewhere = noticed / stiffness if stiffness else 0.0, _ELSEWHERE_M / size
    if not all(depth is not None and -elsewhere < depth < elsewhere + give for depth in felt["edge_m"].values()):
        places = [
            (
                ("no force in the first", Value(REACHED_M / size, "length"))
                if depth is None
                else (Value(abs(depth), "length"), "before the face" if depth < 0 else "behind the face"),
                "at",
                Value(float(speed), "speed"),
            )
            for speed, depth in felt["edge_m"].items()
        ]
        rows.append(row("Contact onset", listed(places), mark=Mark.CAUTION))
    fast = {speed: share for speed, share in felt["rebound"].items() if share > _FASTER}
    if fast:
        each = listed((Value(share, "number"), "times", Value(float(speed), "speed")) for speed, share in fast.items())
        rows.append(row("Rebound", "the released device leaves the wall at", each, mark=Mark.CAUTION))
    return rows


def _friction(data: Mapping[str, Any], problem: Problem) -> list[Row]:
    leaning, sensed, rows = data["with_friction_n_per_m"], data["felt"]["stiffness_n_per_m"], []
    short = data["felt"]["rest_error_m"]
    if short is not None and short > _NOTICED_SHORT_M / problem.device.metres_per_unit:
        rows.append(
            row("Dry friction", "holds the handle up to", Value(short, "length"), "from rest", mark=Mark.CAUTION)
        )
    if leaning is not None and sensed is not None and leaning > _STIFFER * sensed:
        stiffer = Value(leaning, "stiffness")
        rows.append(row("With friction", "at least", stiffer, "if its help is enough: --lean-on-friction"))
    return rows


def _trade_off(data: Mapping[str, Any]) -> list[Row]:
    """Return what a disk margin costs in impedance error at 1, 10 and 30 Hz, and the ripple of an encoder step."""
    points = data["trade_off"]
    if not points:
        return []
    each = (
        (
            "disk margin",
            Value(one["disk_margin"], "number", 2),
            ": error",
            *((Value(share, "share"), ",") for share in one["error"]),
            "ripple",
            Value(one["ripple_n"], "force"),
            None if one["met"] else "(contact or decay not met)",
        )
        for one in points
    )
    return [row("At 1, 10, 30 Hz", listed(each, ";"))]


def _limit(data: Mapping[str, Any]) -> list[Row]:
    helps = data["what_would_help"]
    if not helps:
        return []
    plain = ("plain coupling", Value(data["plain_wall_n_per_m"], "stiffness"))
    each = [(_change(one), Value(one["stiffest_wall_n_per_m"], "stiffness")) for one in helps]
    rows = [row("Linear limit", listed([plain, *each[:MOST_HELPS]], ";"))]
    return rows + [row("What would help", one, rank=1) for one in each[MOST_HELPS:]]


def _change(one: Mapping[str, Any]) -> str:
    return str(one["change"]).removesuffix(" of the device")


def _details(data: Mapping[str, Any]) -> list[Row]:
    """Return the rows of lower rank: margins of each loop, claims, effects, assumptions."""
    rows = []
    for who, one in data.get("margins", {}).items():
        found = (
            ("gain", Value(one["gain"], "gain"), Value(one["gain_hz"], "frequency")),
            ("phase", Value(one["phase_deg"], "phase"), Value(one["phase_hz"], "frequency")),
            ("delay", Value(one["delay_samples"], "samples"), Value(one["delay_hz"], "frequency")),
        )
        each = listed((word, margin, ("at", hz) if hz.number is not None else None) for word, margin, hz in found)
        rows.append(row(f"Margins, {_WHO[who]}", each, rank=1))
    claims = (data["certificate"] or {}).get("deployable", {}).get("claims", ())
    rows += [row(f"Claim: {one['name']}", one["sentence"], mark=marked(one["pass"]), rank=1) for one in claims]
    if data.get("rest"):
        rows.append(row("Limit cycles", f"{data['rest']['word']}: {data['rest']['sentence']}", rank=1))
    trial = data["trial"]
    if trial is not None:
        effects = [", ".join(trial.get("effects", ())), ", ".join(trial["motions"])]
        rows.append(row("Simulated effects", "; ".join(filter(None, effects)), rank=1))
    rows.append(row("Reason", data["reason"], rank=1))
    rows += notes((one for one in data["assumed"] if not one.startswith(SLIP)), "Assumed", Mark.NONE, 1)
    return rows


def stiffest(data: Mapping[str, Any], problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `recommend --stiffest`."""
    shown, others, limited = shown or name_of(problem), data["confirmed"], data["at_force_limit"]
    helps = data["what_would_help"]
    wall = data["stiffest_wall_n_per_m"]
    if wall is None:
        rows = [row("Stiffest wall", "none was found", mark=Mark.FAIL)]
    else:
        reached = parts(Value(wall, "stiffness"), f"({data['by']})", ":", _resting(data))
        rows = [row("Stiffest wall", reached, mark=settled(data))]
    if limited:
        limit = Value(problem.device.max_force_n, "force")
        at = (count(limited), "of", count(data["hands"]), "presses end at the limit of", limit)
        rows.append(row("Limit", at, mark=Mark.CAUTION))
    if others is not None:
        quiet = (";", count(others["quiet"]), "below the vibrotactile threshold")
        rows.append(row("Confirmed", _resting(others), quiet, mark=settled(others)))
    if data["plain_wall_n_per_m"]:
        plain = ("plain coupling", Value(data["plain_wall_n_per_m"], "stiffness"))
        rows.append(row("Linear limit", plain, ", with damping of", span(data["damping_ns_per_m"], "damping")))
    else:
        rows.append(row("Linear limit", "a plain coupling is stable at no wall", mark=Mark.CAUTION))
    rows += [row(_change(one).capitalize(), Value(one["stiffest_wall_n_per_m"], "stiffness")) for one in helps]
    rows += [*notes(data["assumed"], "Assumed", Mark.NONE, 1), *notes(data["not_used"], "Not used", rank=1)]
    onwards = (f"avc recommend {quote(shown)} --out coupling.json", f"avc recommend {quote(shown)} --stiffest -v")
    return Answer("stiffest", data, headline(problem, shown), tuple(rows), onwards, problem.units)
