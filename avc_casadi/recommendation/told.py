"""Text of a recommendation: the conclusion first, one sentence a line."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import starmap
from typing import Any

from avc_casadi._util.text import number, percent
from avc_casadi._util.units import FORCE, KG, M_PER_S, MASS, METRE, MM, N_PER_M, NEWTON, NS_PER_M, UM
from avc_casadi.recommendation.contact_onset import NOTICED_N, REACHED_M
from avc_casadi.recommendation.preconditions import asked_of_others, not_judged
from avc_casadi.simulation.population.motions import TRIAL_S

# Shares of the force limit and of the rendered stiffness above which a line is printed.
_AT_LIMIT, _STIFFER = 0.97, 1.1
# Rendered stiffness (share of the wall) that is negligible, and impedance error at 1 Hz that is worth a line.
_HARDLY, _OTHERWISE = 0.1, 0.2
# A larger share of hands that push through a wall is told first.
_PUSH_THROUGH = 0.5
# A spring this many times stiffer than the wall counts as rigid.
_RIGID = 100.0
# Noticeable deviation from the median of the hands.
_SPREAD = 0.1
# Phrases for grips whose document key is not one.
_HELD = {"one fingertip": "with one fingertip"}
# Noticeable offset of the contact onset.
_ELSEWHERE_M = 5e-4


def conclusion_lines(document: dict[str, Any]) -> list[str]:
    """Return what to deploy and what it renders, or that nothing can be deployed."""
    coupling, felt, trial = document["coupling"], document["felt"], document["trial"]
    if coupling is None:
        return [f"deploy nothing on {document['problem']}: {document['reason']}"]
    errors = ", ".join(f"{100 * error:.3g} % at {hz} Hz" for hz, error in felt["complex_error"].items())
    first = "deploy on" if document["deployable"] else "DO NOT deploy on"
    asked = [trial, *([document["confirmed"]] if document["confirmed"] else [])]
    hands, at_rest = (sum(one[key] for one in asked) for key in ("hands", "at_rest"))
    if document["deployable"] and at_rest < hands:
        first = f"the least bad, which {hands - at_rest} of {hands} hands do not settle at, on"
    springy = coupling["wall"]["stiffness_n_per_m"] > 0
    if first == "deploy on" and pushed_through(document):
        first = "deploy, though most hands push through the wall, on"
    elif first == "deploy on" and hardly_rendered(document):
        first = "deploy, though hardly anything of the wall is left, on"
    stiffness = _felt(felt, trial, springy=springy)
    alone = "" if felt["stiffness_n_per_m"] is not None or not springy else " of the law alone, which no hand feels,"
    return [
        f"{first} {document['problem']}: {gains_line(coupling)}",
        *(f"not used: {what}: nothing that follows holds for it" for what in not_judged(document["not_used"])),
        f"rendered: {stiffness}; impedance error{alone} against the physical wall {errors}",
        (
            f"trial{_nominal(document['confirmed'])}: {trial['at_rest']} of {trial['hands']} hands settle, "
            f"{trial['at_rest_without_friction']} without friction; {_quietly(document)}; a tap reaches "
            f"{number(trial['tap_force_n'], 3)} {NEWTON} and {_depth(trial['tap_depth_m'])}{_watched(trial)}"
        ),
        _settling(document["transient"]),
        _ripple(felt["ripple"]),
        f"margins at the actuator: {'; '.join(starmap(_margins, document['margins'].items()))}",
        rest_line(document["rest"]),
        *_unlike_the_proof(document["rest"], trial),
        *([] if coupling["runtime"]["state_feedback"] is None else _in_motion(felt)),
        *_edge(felt),
        *_limits(document),
        *_off_file(document["off_file"]),
        *_beyond_file(document["beyond_file"]),
        f"hands outside the design set: {_other_hands(document['other_hands'])}",
        *(f"not used: {told}" for told in asked_of_others(document["not_used"])),
        f"why: {document['reason']}",
    ]


def hardly_rendered(document: Mapping[str, Any]) -> bool:
    """Return whether a wall with a spring is nearly lost, at rest or to a hand that moves at 1 Hz.

    Args:
        document: of `avc recommend --json`, with a coupling.
    """
    wall, felt = document["coupling"]["wall"]["stiffness_n_per_m"], document["felt"]
    moving = felt["stiffness_in_motion_n_per_m"].get("1", wall)
    return bool(wall > 0 and min(felt["share_of_wall"] or 1.0, moving / wall) < _HARDLY)


def pushed_through(document: Mapping[str, Any]) -> bool:
    """Return whether most hands end at the force limit.

    Args:
        document: of `avc recommend --json`, with a coupling.
    """
    return bool(document["trial"]["at_force_limit"] > _PUSH_THROUGH * document["trial"]["hands"])


def _watched(trial: dict[str, Any]) -> str:
    """Return the trial's duration where hand and device alone oscillate for longer than the usual one."""
    return "" if trial["longest_s"] <= TRIAL_S else f"; all are watched for {number(trial['longest_s'])} s"


def _settling(found: dict[str, Any]) -> str:
    """Return the settling time of the released device and the damping ratio with the worst corner hand."""
    free, held = found["released"], found["worst_hand"]
    told = "not at all" if free["settling_s"] is None else f"in {number(free['settling_s'], 3)} s"
    ringing = f"damping ratio {number(held['damping_ratio'], 2)} at {number(held['frequency_hz'], 3)} Hz"
    return f"settling: released {told}; worst corner hand: {ringing if held['frequency_hz'] else 'no oscillation'}"


def _ripple(found: dict[str, Any]) -> str:
    """Return the force ripple of the encoder in motion, and how many hands detect it."""
    told = " and ".join(
        f"{number(force, 3)} {NEWTON} rms at {number(float(speed), 3)} {M_PER_S}"
        for speed, force in found["force_n"].items()
    )
    slowest = number(float(next(iter(found["force_n"]))), 3)
    return (
        f"ripple in motion: {told}; {found['quiet']} of {found['hands']} hands at {slowest} {M_PER_S} feel no vibration"
    )


def _margins(who: str, found: dict[str, Any]) -> str:
    """Return the stability margins at the actuator, released or with the worst corner hand of each."""
    units = (
        ("gain", " times", "gain_hz"),
        ("phase_deg", " degrees", "phase_hz"),
        ("delay_samples", " samples", "delay_hz"),
    )
    told = ", ".join(
        f"{key.partition('_')[0]} without limit"
        if found[key] is None
        else f"{key.partition('_')[0]} {number(found[key], 3)}{unit} at {number(found[hz], 3)} Hz"
        for key, unit, hz in units
    )
    return f"{who.replace('worst_hand', 'worst corner hand')} {told}"


def _nominal(confirmed: dict[str, int] | None) -> str:
    """Return a phrase for a trial on the nominal device, where others were on devices of its ranges."""
    return " on the nominal device" if confirmed and confirmed["devices"] > 1 else ""


def _quietly(document: dict[str, Any]) -> str:
    """Return how many hands press below the vibrotactile detection threshold."""
    trial, confirmed, declared_n = document["trial"], document["confirmed"], document["felt"]["friction_n"]
    friction = ", with the declared friction" if declared_n else ""
    others = f", and {confirmed['quiet']} of {confirmed['hands']} others" if confirmed else ""
    where = f" on {confirmed['devices']} devices of the ranges" if confirmed and confirmed["devices"] > 1 else ""
    return f"{trial['quiet']} press without a vibration above the vibrotactile threshold{friction}{others}{where}"


def rest_line(rest: dict[str, Any]) -> str:
    """Return the line on limit-cycle freedom with every hand: proved, refuted, open or simulated."""
    return f"settling with every hand: {rest['word']}: {rest['sentence']}"


def _unlike_the_proof(rest: dict[str, Any], trial: dict[str, Any]) -> list[str]:
    """Return a line if hands do not settle despite a proof, owing to effects that it leaves out."""
    moving = trial["hands"] - trial["at_rest_without_friction"]
    if rest["word"] != "proved" or not moving:
        return []
    who = f"{moving} of {trial['hands']} simulated hands"
    return [f"beyond the proof: with what it leaves out {who} do not settle without dry friction"]


def _felt(felt: dict[str, Any], trial: dict[str, Any], *, springy: bool) -> str:
    limited = trial["at_force_limit"]
    if not springy:
        return "a damper, no stiffness"
    if felt["stiffness_n_per_m"] is None:
        return f"nothing but the {FORCE} limit" if limited else "nothing: no press ends in contact"
    sensed, handle = felt["stiffness_n_per_m"], felt["stiffness_at_handle_n_per_m"]
    share = f"{100 * (felt['share_of_wall'] or 0):.3g} % of the wall"
    behind = "" if handle == sensed else f" at the sensor, and {number(handle)} {N_PER_M} at the handle"
    below = trial["hands"] - limited
    most = f" (median of the {below} hands that stay below the {FORCE} limit)" if limited else ""
    return f"{number(sensed)} {N_PER_M}, {share}{behind}{most}{_spread(trial['stiffness_n_per_m'])}"


def _spread(over_hands: dict[str, Any]) -> str:
    """Return the spread over hands, where more than one in twenty differs noticeably from the median."""
    median, (low, high) = over_hands["median"], over_hands["nine_in_ten"]
    if (1 - _SPREAD) * median <= low <= high <= (1 + _SPREAD) * median:
        return ""
    return f"; {number(low)} to {number(high)} {N_PER_M} for nine hands in ten"


def _in_motion(felt: dict[str, Any]) -> list[str]:
    """Return a line if a wall behind an observer is softer in motion than at rest."""
    error = felt["complex_error"].get("1", 0.0)
    if felt["stiffness_n_per_m"] is None or felt["share_of_wall"] < 1 - _OTHERWISE or error < _OTHERWISE:
        return []
    line = (
        f"in motion: softer than at rest, as the error of {100 * error:.3g} % at 1 Hz says: the observer gives way "
        "before it pushes, and a press is as stiff as that some tenths of a second after it began"
    )
    return [line]


def _edge(felt: dict[str, Any]) -> list[str]:
    """Return the contact onset for a moving hand, if noticeably off the wall's face."""
    noticed = felt["edge_force_n"]
    if not begins_elsewhere(felt):
        return []
    nowhere = f"not in its first {_depth(REACHED_M * NOTICED_N / noticed)}"
    where = ", ".join(
        f"{nowhere if depth is None else _from_face(depth)} at {number(float(speed), 3)} {M_PER_S}"
        for speed, depth in felt["edge_m"].items()
    )
    return [f"edge: a hand that comes fast meets the wall's first {noticed:g} {NEWTON} elsewhere: {where}"]


def _from_face(depth_m: float) -> str:
    return f"{_depth(abs(depth_m))} {'before' if depth_m < 0 else 'behind'} its face"


def begins_elsewhere(felt: dict[str, Any]) -> bool:
    """Return whether the force sets in noticeably off the wall's face for a moving hand, or not at all.

    Args:
        felt: of `avc recommend --json`.
    """
    noticed, stiffness = felt["edge_force_n"], felt["stiffness_n_per_m"]
    give, elsewhere = noticed / stiffness if stiffness else 0.0, _ELSEWHERE_M * NOTICED_N / noticed
    return not all(depth is not None and -elsewhere < depth < elsewhere + give for depth in felt["edge_m"].values())


def _depth(depth_m: float) -> str:
    return f"{number(depth_m, 3)} {METRE}" if depth_m >= 1 else f"{number(1e3 * depth_m, 3)} {MM}"


def _off_file(off: dict[str, Any] | None) -> list[str]:
    """Return the result of the corner hands on perturbed devices."""
    if off is None:
        return []
    enough = off["at_rest_without_friction"] == off["hands"] and not off["linearly_unstable"]
    shaky = (
        f"; on {off['linearly_unstable']} of them the loop is linearly unstable all the same: with other hands of "
        "[hands], near rest, or released"
    )
    advice = "" if enough else "; state in [device.range] how far yours may be off, to have it searched for"
    line = (
        f"model mismatch: on {off['devices']} devices with {_listed(off['keys'])} {100 * off['share']:g} % off, "
        f"{off['at_rest']} of {off['hands']} trials of the corner hands settle, {off['at_rest_without_friction']} "
        f"without friction{shaky if off['linearly_unstable'] else ''}{advice}"
    )
    return [line]


def _beyond_file(found: list[dict[str, Any]]) -> list[str]:
    """Return the results with one unmodelled effect each, and with the grip that the device is made for."""
    parts = []
    for one in found:
        friction = "" if one["at_rest"] is None else f", {one['at_rest']} with friction"
        plain = "" if one["plain"] is None else f"; {one['plain']} with a plain spring and damper"
        what = "declared grip: " if one["key"] == "held" else "unmodelled: "
        asked = ", asked for" if one["asked"] else ""
        rest = f"{one['at_rest_without_friction']} of {one['hands']} hands settle without friction{friction}{plain}"
        parts.append(f"{what}{beyond_file_text(one)}{asked}: {rest}")
    return parts


def beyond_file_text(one: dict[str, Any]) -> str:
    """Return the name of an unmodelled effect, or of a grip."""
    value = one["value"]
    if one["key"] == "held":
        return "one fingertip" if value == "fingertip" else f"hands on a {value}"
    return {
        "mass_share": f"{percent(value)} less {MASS}",
        "dropped_share": f"{percent(value)} of samples lost",
    }[one["key"]]


def _listed(keys: list[str]) -> str:
    return keys[0] if len(keys) == 1 else f"{', '.join(keys[:-1])} and {keys[-1]}"


def _other_hands(tried: dict[str, Any]) -> str:
    return "; ".join(
        f"{_HELD.get(holding, holding)} {of['at_rest']} of {of['hands']} settle, {of['at_rest_without_friction']} "
        "without friction"
        for holding, of in tried.items()
    )


def _limits(document: dict[str, Any]) -> list[str]:
    """Return the effect of the force limit, and the gain from counting on dry friction."""
    trial, lines = document["trial"], []
    limit = document["coupling"]["max_force_n"]
    if limit is not None and trial["tap_force_n"] >= _AT_LIMIT * limit:
        presses = f"; so do the presses of {trial['at_force_limit']} hands" if trial["at_force_limit"] else ""
        lines.append(
            f"{FORCE}: a tap reaches the limit of {number(limit)} {NEWTON}, beyond which no coupling is "
            f"stiffer{presses}"
        )
    leaning, felt = document["with_friction_n_per_m"], document["felt"]["stiffness_n_per_m"]
    if leaning is not None and felt is not None and leaning > _STIFFER * felt:
        lines.append(
            f"friction: if the declared {number(document['felt']['friction_n'])} {NEWTON} of dry friction may hold it, "
            f"{number(leaning)} {N_PER_M} at least; avc recommend P --lean-on-friction searches for it"
        )
    return lines


def gains_line(coupling: dict[str, Any]) -> str:
    """Return the gains and the runtime, as numbers to type into any firmware."""
    rows = coupling["table"]
    named = (
        ("b", "damping_ns_per_m", NS_PER_M),
        ("k", "stiffness_n_per_m", N_PER_M),
        ("b_p", "contact_damping_ns_per_m", NS_PER_M),
    )
    told = {symbol: f"{symbol} = {_span(rows[key])} {unit}" for symbol, key, unit in named}
    wall = coupling["wall"]
    if min(rows["stiffness_n_per_m"]) >= _RIGID * wall["stiffness_n_per_m"] > 0:
        told = {"k": f"wall rendered directly ({told['k']})", "b_p": told["b_p"]}
    gains = ", ".join(told.values())
    runtime = coupling["runtime"]
    beside = []
    if runtime["observer_mass_kg"] is not None:
        beside.append(
            f"observer of {number(runtime['observer_mass_kg'])} {KG} (in exported C, not in the packaged firmware)"
        )
    if runtime["state_feedback"] is not None:
        law = runtime["state_feedback"]
        beside.append(
            f"observer of {len(law['innovation'])} states with a dead zone of +-{number(1e6 * law['dead_zone_m'])} "
            f"{UM}, and state feedback (numbers in the coupling file, C by avc export)"
        )
    if not coupling["constant"]:
        beside.append(f"estimator {runtime['estimator']} and adaptation over {len(rows['frequency_hz'])} rows")
    if runtime["guard"] is not None:
        beside.append(f"guard {runtime['guard']}")
    return (
        f"{coupling['method']}: {gains}; beside them: {', '.join(beside) or 'nothing'}; wall "
        f"{number(wall['stiffness_n_per_m'])} {N_PER_M}, {number(wall['damping_ns_per_m'])} {NS_PER_M}; T "
        f"{number(1e3 * coupling['sample_time_s'])} ms (coupling {coupling['id']})"
    )


def _span(values: list[float]) -> str:
    low, high = min(values), max(values)
    return number(low) if low == high else f"{number(low)} to {number(high)}"
