"""Rows of judgements: certificates, regions of stable walls and pairs, simulated scenes, trials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import sample_rows
from avc_casadi.model import EFFECTS
from avc_casadi.model.effects import SaturationEffect
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, count, doubted, listed, marked, parts, row, written
from avc_casadi.present.rows.pair import stability
from avc_casadi.present.rows.subject import (
    answer,
    deployable,
    gains,
    hand,
    name_of,
    not_used,
    notes,
    pair,
    passive_limit,
)

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.model.problem import Problem

_CLAIMS = {
    "hands": "Corner hands",
    "let-go": "Released",
    "dead-zone": "Dead zone",
    "detent": "Detents",
    "disk-margin": "Disk margin",
    "renders": "Rendering",
}
_OUTCOMES = {"proved": Mark.PASS, "refuted": Mark.FAIL, "open": Mark.CAUTION}
_SETTLES = {"asymptotic": Mark.PASS, "held-by-friction": Mark.CAUTION, "unstable": Mark.FAIL}
_WORDS = {"asymptotic": "settles", "held-by-friction": "settles by dry friction alone", "unstable": "does not settle"}
# A force this near to its limit counts as limited; smaller travel, forces and energies are round-off.
_AT_LIMIT, _ROUND_OFF = 0.97, 1e-12
_CURVES = {
    "passive-paper": "Passive, paper",
    "passive-sampled-data": "Passive, sampled",
    "passive-delayed": "Passive, 1 sample late",
    "stable-released": "Stable, released",
    "stable-hands": "Stable, all hands",
}
_ROWS = 16


def certificate(data: Mapping[str, Any], problem: Problem, shown: str | None = None) -> Answer:
    """Return the answer of `certify` of a coupling to a wall; ``gains`` is None where they stand in no file."""
    file, verdict = data["gains"], data["deployable"]
    shown = name_of(problem) if shown is None else shown
    rows = [
        deployable(verdict),
        *_claims(verdict, data["levels"]["L5"]),
        *(
            row(one["title"].capitalize(), f"{one['outcome']}: {one['claim']}", mark=_OUTCOMES[one["outcome"]])
            for one in data["levels"].values()
            if one["outcome"]
        ),
        _per_frequency(data["levels"]),
        passive_limit(data["passive_limit_n_per_m"]),
        *notes(data["notes"]),
        *written(*data["proof_files"]),
        *levels(data["levels"]),
    ]
    if "claimed" in data:
        claimed = data["levels"][data["claimed"]]
        rows.append(row("Asked for", f"{claimed['title']}: {'met' if claimed['pass'] else 'not met'}", rank=1))
    onwards = [f"avc recommend {quote(shown)} --out coupling.json"] if shown and not verdict["pass"] else []
    if file is not None:
        beside = f" --problem {quote(shown)}" if file.endswith(".csv") else ""
        onwards += [f"avc export {quote(file)} --c firmware{beside}"] if verdict["pass"] else []
        onwards.append(f"avc certify {quote(file)} -v")
    complaint = "" if verdict["pass"] else f"avc: {problem.name}: {file} is not deployable"
    return answer("certify", data, problem, file or shown, rows, onwards, complaint)


def _claims(verdict: Mapping[str, Any], hands: Mapping[str, Any]) -> list[Row]:
    """Return each claim with its worst spectral radius; of those on detents the worst alone."""
    worst: dict[str, Mapping[str, Any]] = {}
    for one in verdict.get("claims", ()):
        label = _CLAIMS["detent" if one["name"].startswith("detent") else one["name"]]
        hardest = (not one["pass"], one["spectral_radius"] or 0.0)
        if label not in worst or hardest > (not worst[label]["pass"], worst[label]["spectral_radius"] or 0.0):
            worst[label] = one
    rows = []
    for label, one in worst.items():
        if not one["pass"] or one["spectral_radius"] is None:
            rows.append(row(label, one["sentence"], mark=marked(one["pass"])))
            continue
        less = None
        if one["name"] == "hands" and hands["margin_ns_per_m"] is not None:
            less = ("; stays stable down to", Value(hands["margin_ns_per_m"], "damping"), "less device damping")
        radius = ("spectral radius", Value(one["spectral_radius"], "number", 5), "at most")
        rows.append(row(label, radius, less, mark=Mark.PASS))
    return rows


def _per_frequency(found: Mapping[str, Any]) -> Row:
    """Return the claims of the paper, which deployment does not need."""
    others = {name: one for name, one in found.items() if not one["outcome"] and name != "L5"}
    words = {"met": "pass", "not met": "fail", "not judged": "refused"}
    text = []
    for word, state in words.items():
        names = [one["title"].removeprefix("passive ") for one in others.values() if _state(one) == state]
        text += [f"{word}: {', '.join(names)}"] if names else []
    return row("Passivity", "; ".join(text))


def _state(level: Mapping[str, Any]) -> str:
    return "refused" if level["refused"] else "pass" if level["pass"] else "fail"


def levels(found: Mapping[str, Any]) -> list[Row]:
    """Return each level of a certificate with its meaning and worst margin, of lower rank."""
    rows = []
    for name, one in found.items():
        margin: tuple[Part, ...] = ()
        if one["margin_ns_per_m"] is not None:
            at = ("at", Value(one["frequency_hz"], "frequency")) if one["frequency_hz"] is not None else None
            margin = parts(", margin", Value(one["margin_ns_per_m"], "damping"), at)
        word = one.get("outcome") or _state(one)
        rows.append(row(name, f"{one['title']}: {word}", margin, f"; {one['claim']}", rank=1))
    return rows


def pair_certificate(data: Mapping[str, Any], problem: Problem, shown: str) -> Answer:
    """Return the answer of `certify` of a coupling to a simulation: stability, and passivity apart."""
    rows = [row("Coupling", pair(data)), *stability(data), *passivity(data["passivity"], problem)]
    rows += [*not_used(data["not_used"]), row("Claim", data["claim"], rank=1)]
    complaint = "" if data["stable"] else f"avc: {problem.name}: {data['gains']} is not deployable"
    return answer("certify", data, problem, shown, rows, complaint=complaint)


def passivity(found: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Return whether the engine's port is passive, and the engines to which that applies."""
    tool = problem.simulation
    if tool is None or tool.tool_mass_kg is None:  # where the tool is fixed the engine is no port
        return []
    if found["refused"]:
        return [row("Engine's port", f"not judged: {found['refused']}", mark=Mark.CAUTION)]
    margin = Value(None if found["margin_ns_per_m"] is None else abs(found["margin_ns_per_m"]), "damping")
    text: tuple[Part, ...] = ("not passive: with the tool held in place the device is unstable",)
    if found["passive"]:
        text = ("passive with", margin, "to spare: stable with any passive engine, whatever its tool touches")
    elif found["margin_ns_per_m"] is not None:
        at = ("at", Value(found["frequency_hz"], "frequency"))
        text = ("not passive: lacks", margin, *at, ",", *hand(found["hand"]))
    if found["any_hand"] is not None:
        text = (*text, f"; {'with' if found['any_hand'] else 'not with'} any passive hand (Llewellyn)")
    rows = [row("Engine's port", text, mark=Mark.PASS if found["passive"] else Mark.NONE)]
    if not found["engine_is_implicit"]:
        why = f"{tool.integrator} is none: it integrates the tool explicitly; Stability holds, for the declared tools"
        rows.append(row("Passive engine", why, mark=doubted(found["passive"])))
    return rows


def region(data: Mapping[str, Any], problem: Problem, shown: str = "", drawn: str | None = None) -> Answer:
    """Return the answer of `zwidth` of a problem with [simulation]: a row for each engine rate."""
    shown, curves, damping, rows = shown or name_of(problem), data["curves"], data["damping_ns_per_m"], []
    for one in curves:
        text: tuple[Part, ...] = ("no coupling is stable",)
        if one["stiffest_n_per_m"] is not None:
            best = {
                "stiffness_n_per_m": one["stiffest_n_per_m"],
                "damping_ns_per_m": one["stiffest_with_ns_per_m"],
                "local_damping_ns_per_m": one["stiffest_with_local_ns_per_m"],
            }
            text = ("stiffest", *pair(best))
        label = Value(one["rate_hz"], "frequency").text(problem.units)
        mark = Mark.NONE if one["stiffest_n_per_m"] is not None else Mark.FAIL
        rows.append(row(label, text, ", as declared" if one["declared"] else "", mark=mark))
    rows += written(drawn, label="Drawn")
    for at in sample_rows(len(damping), _ROWS // 2):
        each = [(Value(one["rate_hz"], "frequency"), _stiffest(one["stiffness_n_per_m"][at])) for one in curves]
        rows.append(row("Largest K", "with B", Value(damping[at], "damping"), ":", listed(each), rank=1))
    return answer("zwidth", data, problem, shown, rows, [f"avc recommend {quote(shown)} --out coupling.json"])


def _stiffest(stiffness_n_per_m: float | None) -> Part:
    return Value(stiffness_n_per_m, "stiffness") if stiffness_n_per_m else "none"


def walls(data: Mapping[str, Any], problem: Problem, shown: str = "", drawn: str | None = None) -> Answer:
    """Return the answer of `zwidth`: the walls that the device can render."""
    shown, curves, damping = shown or name_of(problem), data["curves"], data["wall_damping_ns_per_m"]
    met = [one["claim"] for one in curves.values() if one["wanted_wall"]]
    if curves["stable-hands"]["wanted_wall"] and not curves["stable-released"]["wanted_wall"]:
        met.append("unstable when released")
    bare = f"this wall is {'; '.join(met)}" if met else "this wall is neither passive nor stable"
    whole = len(met) == len(curves) and all(one["wanted_wall"] for one in curves.values())
    rows = [row("Without coupling", bare, mark=marked(whole, Mark.CAUTION))]
    if data["not_used"]:
        unused = ", ".join(map(problem.units.key, data["not_used"]))
        rows.append(row("Not used", f"{unused}: declared, and no part of these claims", mark=Mark.CAUTION))
    for key, one in curves.items():
        known = [(k, b) for k, b in zip(one["stiffness_n_per_m"], damping, strict=True) if k is not None]
        text: tuple[Part, ...] = ("no wall",)
        if known:
            k, b = max(known)
            ends = "; beyond it not looked at" if b == damping[-1] else ""
            text = parts("up to", Value(k, "stiffness"), "with a wall damping of", Value(b, "damping"), ends)
        # A device that is a sample later is another device.
        rows.append(row(_CURVES[key], text, rank=1 if key == "passive-delayed" else 0))
    rows += [*_constant(data), passive_limit(data["passive_limit_n_per_m"])]
    if data["encoder_limit_n_per_m"] is not None:
        limit = Value(data["encoder_limit_n_per_m"], "stiffness")
        rows.append(row("Encoder limit", limit, "for a passive wall, 2 f_c/Delta (Abbott and Okamura 2005)"))
    rows += [*notes(data["refused"], "Not judged"), *written(drawn, label="Drawn")]
    for at in sample_rows(len(damping), _ROWS):
        each = [(_CURVES[key].lower(), _stiffest(one["stiffness_n_per_m"][at])) for key, one in curves.items()]
        rows.append(row("Largest K", "with B", Value(damping[at], "damping"), ":", listed(each), rank=1))
    onwards = (f"avc recommend {quote(shown)} --stiffest", f"avc zwidth {quote(shown)} -v")
    return answer("zwidth", data, problem, shown, rows, onwards)


def _constant(data: Mapping[str, Any]) -> list[Row]:
    """Return the best constant coupling for this wall in both models."""
    rows = []
    for one in data["static"]:
        if one["condition"] != "all":
            continue
        text: tuple[Part, ...] = ("no constant coupling is passive at all frequencies",)
        if one["found"]:
            b_p = one["contact_damping_ns_per_m"]
            k, b = Value(one["stiffness_n_per_m"], "stiffness"), Value(one["damping_ns_per_m"], "damping")
            found = listed([("k", k), ("b", b), ("b_p", Value(b_p, "damping")) if b_p else None])
            text = (*found, ": passive at all frequencies, error", Value(one["error"], "share"))
        rows.append(row(f"Constant, {one['model'].removesuffix('-data')}", text))
    return rows


def scene(data: Mapping[str, Any], problem: Problem, shown: str = "", drawn: str | None = None) -> Answer:
    """Return the answer of `simulate`, of a coupling to a wall or to a simulation."""
    shown, tool = shown or name_of(problem), "local_damping_ns_per_m" in data
    trace = None if data["trace"] is None else f"{data['trace']} and its manifest"
    end, swing = _kept(data["mean_force_n"]), _kept(data["position_peak_to_peak_m"])
    hard = None if tool else data["rate_hardness_n_per_m"]
    rows = [row("Outcome", _outcome(data), f"({data['steps']} samples)", mark=_mark(data))]
    rows.append(row("Coupling", f"{data['coupling']}:", pair(data)) if tool else _coupling(data, problem))
    rows += [
        _rendered(data, problem),
        *([row("Rate-hardness", Value(hard, "stiffness"), "at contact")] if hard is not None else []),
        row("At the end", Value(end, "force"), ",", Value(swing, "length"), "peak to peak"),
        row("Ripple", Value(_kept(data["force_ripple_n"]), "force"), "rms between 20 and 500 Hz"),
        row("Energy", Value(_kept(data["energy_generated_j"]), "energy"), "given out beyond that taken in"),
        *([_beside("No guard", guarded)] if (guarded := data.get("without_guard")) is not None else []),
        *(_beside(f"With {one['coupling']}", one) for one in data.get("against", ())),
        *notes(data.get("notes", ())),
    ]
    if data.get("left_out"):
        left = f"declared, but not listed in the scene: {', '.join(map(problem.units.key, data['left_out']))}"
        rows.append(row("Left out", left, mark=Mark.CAUTION))
    rows += [*written(trace, drawn), *_explanation(data)]
    if "criterion" in data:
        rows.append(row("Criterion", data["criterion"], rank=1))
    settles = data["stable"]
    complaint = "" if settles else f"avc: {problem.name}: the device {outcome(data)}"
    onwards = () if tool else (f"avc simulate {quote(shown)} --explain",)
    return answer("simulate", data, problem, shown, rows, onwards, complaint)


def outcome(data: Mapping[str, Any]) -> str:
    """Return the outcome for the one simulated hand."""
    kinds = [one if isinstance(one, str) else one["kind"] for one in data["effects"]]
    held = any(EFFECTS[kind].role == "hand" for kind in kinds)
    return f"{_WORDS[data['outcome']]}{' with this hand' if held else ''}"


def _outcome(data: Mapping[str, Any]) -> str:
    free = ", without need of dry friction" if data["outcome"] == "asymptotic" else ""
    return f"{outcome(data)}{free}{'; buzzes' if data['buzzing'] else ''}"


def _mark(data: Mapping[str, Any]) -> Mark:
    mark = _SETTLES[data["outcome"]]
    return Mark.CAUTION if mark is Mark.PASS and data["buzzing"] else mark


def _coupling(data: Mapping[str, Any], problem: Problem) -> Row:
    if data["coupling"] == "none":
        return row("Coupling", "none: the wall itself")
    keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
    table = {key: [math.inf if data[key] is None else data[key]] for key in keys}
    read: tuple[Part, ...] = ()
    if data["gains_from_hz"] is not None:
        adapts = any(effect["kind"] == "adaptation" for effect in data["effects"])
        read = ("; at first" if adapts else ";", "the table at", Value(data["gains_from_hz"], "frequency"))
    return row("Coupling", f"{data['coupling']}:", gains(table, problem), read)


def _rendered(data: Mapping[str, Any], problem: Problem) -> Row:
    sensed, wall = data["apparent_stiffness_n_per_m"], problem.environment.stiffness_n_per_m
    if sensed is None:
        return row("Rendered", "no stiffness: the scene does not end in steady contact")
    kinds = {one if isinstance(one, str) else one["kind"] for one in data["effects"]}
    beside = ", with the slope of the detents" if "detent" in kinds else ""
    share = f"({100 * sensed / wall:.2g} % of the wall)" if wall and problem.simulation is None else ""
    text = parts(Value(sensed, "stiffness"), "at the sensor", share, beside)
    own = [one.force_n for one in problem.scene.effects if isinstance(one, SaturationEffect)]
    limit = own[0] if own and own[0] is not None else problem.device.max_force_n
    if "saturation" not in kinds or limit is None or data["mean_force_n"] < _AT_LIMIT * limit:
        return row("Rendered", text)
    return row("Rendered", text, "; ends at the limit of", Value(limit, "force"), mark=Mark.CAUTION)


def _beside(label: str, one: Mapping[str, Any]) -> Row:
    """Return the outcome of another run of the scene."""
    what = f"{_WORDS[one['outcome']]}{', buzzes' if one['buzzing'] else ''}:"
    sensed, swing = one["apparent_stiffness_n_per_m"], Value(_kept(one["position_peak_to_peak_m"]), "length")
    stiffness = "no stiffness" if sensed is None else Value(sensed, "stiffness")
    energy = (",", Value(_kept(one["energy_generated_j"]), "energy"), "given out")
    return row(label, what, stiffness, ",", swing, "peak to peak", energy, mark=_mark(one))


def _kept(value: float | None) -> float | None:
    """Return a value; 0 for a rounding residue."""
    return 0.0 if value is not None and abs(value) < _ROUND_OFF else value


def _explanation(data: Mapping[str, Any]) -> list[Row]:
    """Return what each effect adds to a sample: states, instructions and time."""
    if "states" not in data or "absent" not in data:
        return []
    rows = []
    for one in data["effects"]:
        states = (count(one["states"]), "states,")
        made = ("the only mass",) if one["instructions"] is None else (count(one["instructions"]), "instructions,")
        cost = _cost(one["ns_per_step"], data["scatter_ns"])
        rows.append(row(f"Effect {one['kind']}", states, made, cost, rank=1))
    whole = (count(data["states"]), "states,", count(data["instructions"]), "instructions,")
    rows.append(row("Whole sample", whole, f"{data['ns_per_step']:.0f} ns", rank=1))
    rows.append(row("States", ", ".join(data["state_names"]), rank=1))
    return [*rows, row("Absent", ", ".join(data["absent"]), rank=1)]


def _cost(cost_ns: float | None, scatter_ns: float) -> str:
    """Return a cost in ns, or an upper bound within the scatter of the clock."""
    if cost_ns is None:
        return "-"
    return f"{cost_ns:.0f} ns" if cost_ns > scatter_ns else f"below {max(scatter_ns, 1):.0f} ns"


def screening(data: Mapping[str, Any], problem: Problem, shown: str) -> Answer:
    """Return the answer of `simulate --screen`: a row for each effect that the scene needs."""
    together, tolerance = data["together"], Value(data["tolerance"], "share")
    all_effects = f"{_WORDS[data['outcome']]}, coupling {data['coupling']}"
    rows = [row("All effects", all_effects, mark=_SETTLES[data["outcome"]])]
    for one in data["effects"]:
        ending, rank = f", {_WORDS[one['outcome']]}{': needed' if one['needed'] else ''}", 0 if one["needed"] else 1
        saves = ("; saves", count(one["instructions"]), "instructions,", _cost(one["ns_per_step"], data["scatter_ns"]))
        rows.append(row(f"No {one['kind']}", _changes(one, problem.units), ending, saves if rank else None, rank=rank))
    if data["essential"]:
        rows.append(row("Only mass", f"cannot be left out: {', '.join(data['essential'])}"))
    if together is None:
        rows.append(row("Not needed", "none at a tolerance of", tolerance))
    else:
        rows.append(row("Not needed", "at a tolerance of", tolerance, f": {', '.join(data['unneeded'])}"))
        rows.append(row("Without these", _changes(together, problem.units), f", {_WORDS[together['outcome']]}"))
    rows += notes(data["notes"])
    onwards = (f"avc simulate {quote(shown)} --screen -v",)
    return answer("screen", data, problem, shown, rows, onwards)


def _changes(found: Mapping[str, Any], units: Units) -> tuple[Part, ...]:
    """Return relative changes, rms over the run for position and force."""
    names = ("position", "force", "stiffness")
    return listed((units.key(name), Value(found[f"{name}_change"], "share")) for name in names)


def trial(data: Mapping[str, Any], units: Units, shown: str) -> Answer:
    """Return the answer of `trial`: how many simulated hands settle."""
    hands, rests, moving = data["hands"], data["at_rest"], data["moving"]
    low, high = (f"{100 * end:.4g}" for end in data["at_rest_interval"])
    interval = f"hands in every motion ({100 * data['confidence']:g} % interval {low} to {high} %)"
    rows = [
        row("Settle", count(rests), "of", count(hands), interval, mark=marked(rests == hands, Mark.CAUTION)),
        row("By motion", listed((name, count(one)) for name, one in data["by_motion"].items())),
        row("Simulated", ", ".join(data["effects"])),
    ]
    if moving:
        more = " and others" if hands - rests > len(moving) else ""
        numbers = f"by their number in the draw: {', '.join(map(str, moving))}{more}"
        rows.append(row("Do not settle", numbers, mark=Mark.FAIL))
    friction = "" if data["friction"] else ", without dry friction"
    title = f"{shown}   coupling {data['coupling']} · {hands} hands, seed {data['seed']}{friction}"
    return Answer("trial", data, (title,), tuple(rows), units=units)
