"""Summary of a recommendation: coupling, rendering, claims, limits."""

from __future__ import annotations

import math
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import percent, quantity
from avc_casadi._util.units import FORCE
from avc_casadi.present.pages.contact import contact_rows
from avc_casadi.present.pages.subject import gains_text, headline
from avc_casadi.present.terminal import Mark, Page, Row
from avc_casadi.recommendation.preconditions import SLIP, asked_of_others, not_judged
from avc_casadi.recommendation.told import beyond_file_text, hardly_rendered, pushed_through

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.model.problem import Problem

# An impedance error of a hand's motion above which it feels unlike a static press; a tap this near to the limit counts
# as saturated.
_SOFTER, _AT_LIMIT = 0.2, 0.97
# Impedance of device and wall together over that of the wall below which errors are relative to hardly anything.
_RESONANT = 0.3
# Frequencies up to this are those of hands; a longer settling time is marked.
_OF_HANDS_HZ, _SLOW_S = 10.0, 1.0
# Half of the usual margins, 6 dB and 20 degrees.
_THIN_GAIN, _THIN_DEG = 10 ** (3 / 20), 10.0
# A stiffness gain by friction that is worth a row, and a share of the wall that is beyond what is asked.
_STIFFER = 1.1
_MOST_HELPS = 3
# Share of hands that may notice the encoder steps, or a vibration at rest, without a caution.
_FEW_FEEL = 0.1
# Steps of the force, and shortfalls of the handle, from which on they are printed.
_NOTICED_STEP_N, _NOTICED_SHORT_M = 0.1, 1e-3


def recommendation_page(
    document: dict[str, Any], problem: Problem, page: Page, shown: str = "P", written: str | None = None
) -> str:
    """Return the `recommend` document as a headline and about ten rows.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        written: file that holds the coupling, if one was written.
    """
    rows = recommendation_rows(document, problem)
    if written is not None:
        rows.append(Row("Written", written))
    nothing = document["reason"].startswith("nothing") or problem.environment.stiffness_n_per_m == 0
    if document["coupling"] is None or (not document["deployable"] and (nothing or _slips(document))):
        onwards = f"avc check {quote(shown)}"
    elif not document["deployable"]:
        onwards = f"avc recommend {quote(shown)} --stiffest"
    elif written is None:
        onwards = f"avc recommend {quote(shown)} --out coupling.json"
    else:
        onwards = f"avc export {quote(written)} --c DIR"
    spare = (_force_label(problem), "With friction", "Linear limit", "Not used")
    return page.rendered(headline(problem, shown), rows, [onwards, f"avc recommend {quote(shown)} -v"], spare)


def recommendation_rows(document: dict[str, Any], problem: Problem, *, briefly: bool = False) -> list[Row]:
    """Return the rows of the `recommend` document.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
        briefly: coupling and claims alone, without limits.
    """
    if document["coupling"] is None:
        none = Row("Coupling", f"none is deployable: {document['reason']}", Mark.FAIL)
        return [none] if briefly else [*_slips(document), none, *_limit(document, problem)]
    rows = [
        *_slips(document),
        _coupling(document, problem),
        *_rendered(document, problem),
        _stability(document),
        *([_damped(document["margins"], document["transient"])] if document["deployable"] else []),
        *_simulated(document),
    ]
    if briefly or not document["deployable"]:
        return rows
    return [
        *rows,
        *_beyond_file(document["beyond_file"]),
        *_outside(document),
        *_force(document, problem),
        *contact_rows(document, problem),
        *_friction(document, problem),
        *(Row("Not used", told) for told in asked_of_others(document["not_used"])),
        *_limit(document, problem),
    ]


def _slips(document: dict[str, Any]) -> list[Row]:
    """Describe implausible values before their consequences."""
    told = [what.removeprefix(SLIP) for what in document["assumed"] if what.startswith(SLIP)]
    return [Row("Values", "; ".join(told), Mark.CAUTION)] if told else []


def _coupling(document: dict[str, Any], problem: Problem) -> Row:
    coupling, unit = document["coupling"], problem.units.unit
    table, runtime = coupling["table"], coupling["runtime"]
    parts = [gains_text(table, problem)]
    if runtime["state_feedback"] is not None:
        parts.insert(0, f"observer ({len(runtime['state_feedback']['innovation'])} states) with state feedback")
    if runtime["observer_mass_kg"] is not None:
        noun = problem.units.key("mass")
        parts.append(f"observer of assumed {noun} {quantity(runtime['observer_mass_kg'], unit('kg'))}")
    if not coupling["constant"]:
        parts.append(f"{len(table['frequency_hz'])} rows")
    trial, limit, without = document["trial"], coupling["max_force_n"], _without(document)
    if not document["deployable"]:
        # Rows of their own tell that nothing is rendered, and a claim that fails.
        told = document["reason"].startswith("nothing") or _failed(document)
        why = "" if told else f": {document['reason']}"
        return Row("Coupling", f"{', '.join(parts)}: NOT deployable{why}", Mark.FAIL)
    through = ""
    if pushed_through(document):
        hands = f"{trial['at_force_limit']} of {trial['hands']} hands push through the wall"
        through = f", but {hands} (limit {quantity(limit, unit('N'))})"
    lost = ""
    if hardly_rendered(document) and not through:
        lost = ", but hardly anything of the wall is rendered to a moving hand"
    mark = Mark.CAUTION if through or lost or without else Mark.PASS
    return Row("Coupling", f"{', '.join(parts)}: deployable{without}{through}{lost}", mark)


def _without(document: dict[str, Any]) -> str:
    """Name what is declared and not used: no claim covers it."""
    names = [what.partition(" (")[0] for what in not_judged(document["not_used"])]
    return f" without {', '.join(names)}, which is declared and not used" if names else ""


def _rendered(document: dict[str, Any], problem: Problem) -> list[Row]:
    felt, trial, unit = document["felt"], document["trial"], problem.units.unit
    errors = ", ".join(f"{percent(error)} at {hz} Hz" for hz, error in felt["complex_error"].items())
    worst = max((error for hz, error in felt["complex_error"].items() if float(hz) <= _OF_HANDS_HZ), default=0.0)
    if problem.environment.stiffness_n_per_m == 0:
        return [_damper(document, problem, errors)]
    if felt["stiffness_n_per_m"] is None or document["reason"].startswith("nothing"):
        what = document["reason"]
        if document["deployable"] or not what.startswith("nothing"):
            what = f"nothing: no press ends below the {FORCE} limit"
        return [Row("Rendered", what, Mark.FAIL)]
    sensed, handle = felt["stiffness_n_per_m"], felt["stiffness_at_handle_n_per_m"]
    low, high = trial["stiffness_n_per_m"]["nine_in_ten"]
    spread = ""
    if not 0.9 * sensed <= low <= high <= 1.1 * sensed:
        spread = f", {quantity(low, unit('N/m'))} to {quantity(high, unit('N/m'))} over 90 % of hands"
    stiffnesses = [(sensed, f"static ({percent(felt['share_of_wall'])} of the wall)")]
    moving = felt["stiffness_in_motion_n_per_m"].items()
    stiffnesses += [(stiffness, f"at {hz} Hz") for hz, stiffness in moving if float(hz) <= _OF_HANDS_HZ]
    stiffnesses += [] if handle == sensed else [(handle, "at the handle")]
    told, before = [], ""
    for stiffness, where in stiffnesses:
        # A unit serves the numbers after it up to the next one.
        number, _, shown = quantity(stiffness, unit("N/m")).partition(" ")
        told.append(f"{number} {where}" if shown == before else f"{number} {shown} {where}")
        before = shown
    stiffer = _stiffer_in_motion(felt["stiffness_in_motion_n_per_m"], problem)
    spread += "; above the wall in motion, damping included" if stiffer else ""
    above = stiffer or felt["share_of_wall"] > _STIFFER
    shaken = f"handle shaken by {quantity(felt['shaken']['amplitude_m'], unit('m'))}"
    softer = worst > max(_SOFTER, 1 - felt["share_of_wall"])
    return [
        Row("Rendered", f"{', '.join(told)}{spread}", Mark.CAUTION if above else Mark.NONE),
        Row(
            "Impedance error",
            f"{errors}, {shaken}{_resonant(felt['complex_error'], problem)}",
            Mark.CAUTION if softer else Mark.NONE,
        ),
    ]


def _damper(document: dict[str, Any], problem: Problem, errors: str) -> Row:
    """Describe a rendered damper: a wall never pulls, so that of a sine it renders the half, and errors tell that."""
    wanted, unit = problem.environment.damping_ns_per_m, problem.units.unit("N.s/m")
    moving = document["felt"]["stiffness_in_motion_n_per_m"].items()
    rendered = {hz: stiffness / (math.pi * float(hz)) for hz, stiffness in moving if float(hz) <= _OF_HANDS_HZ}
    told = ", ".join(f"{quantity(damping, unit)} at {hz} Hz" for hz, damping in rendered.items())
    off = any(abs(damping / wanted - 1) > _SOFTER for damping in rendered.values())
    never = "which never pulls: impedance error of the whole cycle"
    return Row("Rendered", f"a damper of {told}, {never} {errors}", Mark.CAUTION if off else Mark.NONE)


def _stiffer_in_motion(moving: Mapping[str, float], problem: Problem) -> bool:
    """Return whether a hand in motion meets more than the wall itself, as of a contact damper at a low rate."""
    wall = problem.environment
    return any(
        stiffness > (1 + _SOFTER) * math.hypot(wall.stiffness_n_per_m, 2 * math.pi * float(hz) * wall.damping_ns_per_m)
        for hz, stiffness in moving.items()
        if float(hz) <= _OF_HANDS_HZ
    )


def _resonant(errors: Mapping[str, float], problem: Problem) -> str:
    """Name the frequencies near the resonance of device and wall: errors are relative to a |Z| that nearly vanishes."""
    device, wall, near = problem.device, problem.environment, []
    for hz in errors:
        s = 2j * math.pi * float(hz)
        of_wall = wall.damping_ns_per_m + wall.stiffness_n_per_m / s
        if abs(device.mass_kg * s + device.damping_ns_per_m + of_wall) < _RESONANT * abs(of_wall):
            near.append(f"{hz} Hz")
    return f"; {' and '.join(near)} near the resonance of device and wall, where |Z| is small" if near else ""


def _damped(margins: dict[str, Any], transient: dict[str, Any]) -> Row:
    """Describe the smallest margins, released or with a hand, the settling time and the least damped oscillation."""
    gain, phase, late = (
        min((one[key] for one in margins.values() if one[key] is not None), default=None)
        for key in ("gain", "phase_deg", "delay_samples")
    )
    free, held = transient["released"], transient["worst_hand"]
    told = [
        "gain unlimited" if gain is None else f"gain {20 * math.log10(gain):.1f} dB",
        "phase unlimited" if phase is None else f"phase {phase:.2g} deg",
        "delay unlimited" if late is None else f"delay {late:.2g} T",
    ]
    rings = "for ever" if free["settling_s"] is None else quantity(free["settling_s"], "s")
    ringing = f"zeta {held['damping_ratio']:.2g} at {quantity(held['frequency_hz'], 'Hz')} held"
    if held["frequency_hz"] == 0:
        ringing = "no oscillation held"
    slow = free["settling_s"] is None or free["settling_s"] > _SLOW_S
    thin = (gain is not None and gain < _THIN_GAIN) or (phase is not None and phase < _THIN_DEG)
    mark = Mark.CAUTION if slow or thin else Mark.NONE
    return Row("Margins", f"{', '.join(told)}; rings {rings} free, {ringing}", mark)


def _failed(document: dict[str, Any]) -> list[str]:
    return [claim["sentence"] for claim in document["certificate"]["deployable"]["claims"] if not claim["pass"]]


def _stability(document: dict[str, Any]) -> Row:
    failed, rest = _failed(document), document["rest"]["word"]
    if failed:
        return Row("Stability", failed[0], Mark.FAIL)
    if rest == "proved":
        return Row("Stability", "every hand and released, from any state: proved (L7)", Mark.PASS)
    told = {
        "refuted": "limit cycle without friction (L7)",
        "open": "limit cycles open (L7)",
        "simulated": "limit cycles not proved",
    }[rest]
    mark = Mark.CAUTION if rest == "refuted" else Mark.PASS
    return Row("Stability", f"linearly stable with every hand and released; {told}", mark)


def _simulated(document: dict[str, Any]) -> list[Row]:
    asked = [document["trial"], *([document["confirmed"]] if document["confirmed"] else [])]
    hands, settled, free, quiet = (
        sum(one[key] for one in asked) for key in ("hands", "at_rest", "at_rest_without_friction", "quiet")
    )
    mark = settled_mark(settled, free, hands)
    if mark is Mark.PASS and hands - quiet > _FEW_FEEL * hands:
        mark = Mark.CAUTION
    told = f"{settled} of {hands} hands settle, {free} without friction; {quiet} below the vibrotactile threshold"
    rows = [Row("Simulated", told, mark)]
    off = document["off_file"]
    if off is not None:
        unstable = f"; linearly unstable on {off['linearly_unstable']}" if off["linearly_unstable"] else ""
        rows.append(
            Row(
                "Mismatch",
                f"{off['at_rest']} of {off['hands']} settle on {off['devices']} devices {100 * off['share']:g} % off, "
                f"{off['at_rest_without_friction']} without friction{unstable}",
                Mark.CAUTION
                if unstable and off["at_rest"] == off["hands"]
                else settled_mark(off["at_rest"], off["at_rest_without_friction"], off["hands"]),
            )
        )
    return rows


def _beyond_file(found: list[dict[str, Any]]) -> list[Row]:
    """Describe how many hands settle with an unmodelled effect, and how many of those that hold the device."""
    grips = [one for one in found if one["key"] == "held"]
    effects = [one for one in found if one["key"] != "held"]
    return [*_withstood("Unmodelled", effects), *_withstood("Declared grip", grips)]


def _withstood(label: str, found: list[dict[str, Any]]) -> list[Row]:
    """Describe how many hands settle, beside a plain coupling; by dry friction where that met what was asked."""
    if not found:
        return []
    hands, least = found[0]["hands"], min(one["at_rest_without_friction"] for one in found)
    # What is asked of a deployable coupling is met, if not without dry friction, then where that may be counted on.
    settled = [
        one["at_rest"] if one["asked"] and one["at_rest"] is not None else one["at_rest_without_friction"]
        for one in found
    ]
    names = [beyond_file_text(one) for one in found]
    if min(settled) == hands:
        without = f", {least} without friction" if least < hands else ""
        mark = settled_mark(hands, least, hands)
        return [Row(label, f"{hands} of {hands} settle with {', '.join(names)}{without}", mark)]
    told = ", ".join(f"{count} with {name}" for count, name in zip(settled, names, strict=True))
    plain = [str(one["plain"]) for one in found if one["plain"] is not None]
    beside = f" (plain {', '.join(plain)})" if plain else ""
    return [Row(label, f"of {hands}: {told}{beside}", Mark.CAUTION)]


def settled_mark(settled: int, free: int, hands: int) -> Mark:
    """Return the mark of a trial: fails where hands do not settle, a caution where some need dry friction for it.

    Args:
        settled: how many settle.
        free: how many of them without dry friction.
        hands: how many were simulated.
    """
    return Mark.FAIL if settled < hands else Mark.CAUTION if free < hands else Mark.PASS


def _outside(document: dict[str, Any]) -> list[Row]:
    tried = document["other_hands"]
    if not tried:
        return []
    if all(of["at_rest"] == of["hands"] for of in tried.values()):
        return []
    told = ", ".join(f"{holding} {of['at_rest']} of {of['hands']}" for holding, of in tried.items())
    return [Row("Outside hands", f"not of the design set: {told} settle", Mark.CAUTION)]


def _force(document: dict[str, Any], problem: Problem) -> list[Row]:
    trial, limit, unit = document["trial"], document["coupling"]["max_force_n"], problem.units.unit
    label = _force_label(problem)
    reached, depth = quantity(trial["tap_force_n"], unit("N")), quantity(trial["tap_depth_m"], unit("m"))
    coarse, ripple = _steps(document["felt"], problem), document["felt"]["ripple"]
    if limit is None or trial["tap_force_n"] < _AT_LIMIT * limit:
        vibrates = ripple["hands"] - ripple["quiet"] > _FEW_FEEL * ripple["hands"]
        mark = Mark.CAUTION if vibrates else Mark.NONE
        return [Row(label, f"a tap reaches {reached}, {depth} deep{coarse}", mark)]
    presses = f"; so do {trial['at_force_limit']} presses" if trial["at_force_limit"] else ""
    told = f"a tap reaches the {quantity(limit, unit('N'))} limit{presses}{coarse}"
    return [Row(label, told, Mark.CAUTION)]


def _steps(felt: dict[str, Any], problem: Problem) -> str:
    """Describe the force of an encoder step, where it is large or noticed by slowly moving hands."""
    unit, ripple, steps = problem.units.unit, felt["ripple"], felt["encoder_step_n"]
    loud = ripple["hands"] - ripple["quiet"]
    noticed = sum(steps.values()) > _NOTICED_STEP_N * problem.device.metres_per_unit
    if not noticed and loud <= _FEW_FEEL * ripple["hands"]:
        return ""
    force = next(iter(ripple["force_n"].values()))
    what = "vibration with the noise " if problem.device.position_noise_rms_m else ""
    noticed_by = f", {what}noticed by {loud} of {ripple['hands']}" if loud else ""
    moving = f"ripple {quantity(force, unit('N'))}{noticed_by}"
    return f"; encoder step {quantity(sum(steps.values()), unit('N'))}, {moving}"


def _force_label(problem: Problem) -> str:
    return problem.units.key("force").capitalize()


def _friction(document: dict[str, Any], problem: Problem) -> list[Row]:
    leaning, sensed = document["with_friction_n_per_m"], document["felt"]["stiffness_n_per_m"]
    rows, short = [], document["felt"]["rest_error_m"]
    if short is not None and short > _NOTICED_SHORT_M / problem.device.metres_per_unit:
        told = f"holds the handle up to {quantity(short, problem.units.unit('m'))} from where the spring leads it"
        rows.append(Row("Dry friction", told, Mark.CAUTION))
    if leaning is not None and sensed is not None and leaning > _STIFFER * sensed:
        stiffer = quantity(leaning, problem.units.unit("N/m"))
        rows.append(Row("With friction", f"at least {stiffer} if its help is enough: --lean-on-friction"))
    return rows


def _limit(document: dict[str, Any], problem: Problem) -> list[Row]:
    if not document["what_would_help"]:
        return []
    unit = problem.units.unit("N/m")
    helps = [
        f"{change_text(one)} {quantity(one['stiffest_wall_n_per_m'], unit)}"
        for one in document["what_would_help"][:_MOST_HELPS]
    ]
    plain = quantity(document["plain_wall_n_per_m"], unit)
    return [Row("Linear limit", f"plain coupling {plain}; {'; '.join(helps)}")]


def change_text(one: dict[str, Any]) -> str:
    """Return a change of the device that would help, in few words.

    Args:
        one: of `what_would_help`.
    """
    change = str(one["change"])
    return "half T" if change == "half the sample time" else change.removesuffix(" of the device")
