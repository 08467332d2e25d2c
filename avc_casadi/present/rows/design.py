"""Rows of the paper's question: the gains of one method, the methods side by side, a whole run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from shlex import quote
from typing import Any

from avc_casadi.model.problem import Problem
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, commas, fill, grade, parts, quantity_of, row, span
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.deploy import in_the_loop
from avc_casadi.present.rows.judge import levels


def solution(data: Mapping[str, Any], problem: Problem, shown: str = "", file: str | None = None) -> Answer:
    """Return the answer of `solve`."""
    status = data["status"]
    have = sum(b is not None for b in data["damping_ns_per_m"])
    by = data["method"] + (f" ({data['solver']})" if data["solver"] else "")
    solved = fill(f"{by}: at {have} of {len(status)} frequencies in {{solve:time}}", data["seconds"])
    inside = "between U and L at {share_inside_bounds:share} of the frequencies, within {jnd:share} of the impedance at"
    rows = [
        row("Gains", solved, mark=grade(have == len(status))),
        *([row("Coupling", subject.gains(data, problem))] if have else []),
        row("Status", subject.counts(data["counts"])),
        *_errors(data),
        row("Realism", fill(f"{inside} {{share_inside_jnd:share}}", data["realism"])),
        subject.deployable(data["deployable"]),
        subject.passive_limit(data["passive_limit_n_per_m"]),
    ]
    if "paper_errors" in data:
        errors = f"{len(data['paper_errors'])} in the printed paper; these gains have those of (10) and (17)"
        rows.append(row("Paper's errors", errors, mark=Mark.CAUTION))
    rows += subject.notes(data["notes"], rank=1, mark=Mark.NONE)
    rows += [*levels(data["certificate"]["levels"]), *printed_errors(data.get("paper_errors", ()))]
    printed = " --as-printed" if "paper_errors" in data else ""
    onwards = "recommend {} --out coupling.json"
    if data["deployable"] and file:
        onwards = f"certify {'{} ' * file.endswith('.csv')}{quote(file)}"
    elif data["deployable"]:
        onwards = f"solve {{}} --method {data['method']}{printed} --out gains.json"
    return subject.answer("solve", data, problem, shown, rows, onwards, complaint=without_gains(data))


def printed_errors(errors: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return the errors of the printed paper, of lower rank."""
    return [
        row(one["equation"], f"printed {one['as_printed']}; correct {one['correct']}; {one['effect']}", rank=1)
        for one in errors
    ]


def without_gains(data: Mapping[str, Any]) -> str:
    """Describe the rows without gains, each state with its first reason; empty where all have."""
    missing = [at for at, b in enumerate(data["damping_ns_per_m"]) if b is None]
    if not missing:
        return ""
    lines = [f"avc: {len(missing)} of {len(data['status'])} frequencies have no gains ({data['method']})"]
    for state in dict.fromkeys(data["status"][at] for at in missing):
        first, *more = (at for at in missing if data["status"][at] == state)
        also = f"; {len(more)} more {state}" if more else ""
        lines.append(f"  {state} at {data['frequency_hz'][first]:.4g} Hz: {data['reason'][first]}{also}")
    return "\n".join(lines)


def _errors(data: Mapping[str, Any]) -> list[Row]:
    """Return the largest errors of magnitude and impedance, and their frequencies."""
    rows = []
    keys = {"magnitude_error": ("Error of |Z|", "damping"), "complex_error": ("Impedance error", "share")}
    for key, (label, of) in keys.items():
        found = zip(data[key], data["frequency_hz"], data["damping_ns_per_m"], strict=True)
        if known := [(error, at) for error, at, b in found if None not in (error, b)]:
            error, at = max(known)
            rows.append(row(label, fill(f"at most {{error:{of}}}, at {{at:frequency}}", {"error": error, "at": at})))
    return rows


def comparison(data: Mapping[str, Any], problem: Problem, shown: str = "") -> Answer:
    """Return the answer of `compare`."""
    realism, mine = {name: one["realism"] for name, one in data["methods"].items()}, list[Row]()
    if (pair := data["methods"].get("mine")) is not None:
        met = [real >= data["margin_ns_per_m"] for real in pair["real_part"]]
        gains = {key: pair[key][0] for key in ("stiffness_n_per_m", "damping_ns_per_m")}
        text = fill(f"{{stiffness_n_per_m}}, {{damping_ns_per_m}}: meets (12) at {sum(met)} of {len(met)}", gains)
        mine.append(row("Mine", text, mark=grade(all(met), Mark.CAUTION)))
    between, near = (
        commas((name.replace("-", " "), Value(one[key], "share")) for name, one in realism.items())
        for key in ("share_inside_bounds", "share_inside_jnd")
    )
    rows = [
        *methods(data),
        _deployable(data),
        row("Between U, L", "of the frequencies:", between),
        row("Impedance error", fill("within {jnd:share}:", next(iter(realism.values()))), near),
        *mine,
        subject.passive_limit(data["passive_limit_n_per_m"]),
    ]
    if data["problem_scope"] != data["scope"]:
        rows.append(row("Not compared", f"gains of scope {data['problem_scope']} (avc solve)", mark=Mark.CAUTION))
    complaint = without_gains(data["methods"][data["optimum"]])
    return subject.answer("compare", data, problem, shown, rows, "recommend {}", complaint=complaint)


def methods(data: Mapping[str, Any]) -> list[Row]:
    """Return a row for each method of a comparison, and the verdicts on the frequencies."""
    each = [_method(name, one, data) for name, one in data["methods"].items() if name != "mine"]
    return [*each, row("Verdicts", f"{subject.counts(data['counts'])}, pointwise")]


def _method(name: str, found: Mapping[str, Any], data: Mapping[str, Any]) -> Row:
    """Return where a method has gains, and the first reason why not, or its distance from the other optimum."""
    damping, check = found["damping_ns_per_m"], data["cross_check"]
    missing = [at for at, b in enumerate(damping) if b is None]
    text: tuple[Part, ...] = (f"at {len(damping) - len(missing)} of {len(damping)} frequencies",)
    mark = Mark.PASS if not missing else Mark.FAIL if name == data["optimum"] else Mark.CAUTION
    if name == "exact" and check is not None:
        differ = f", differs at {len(check['partings'])} frequencies" if check["partings"] else ""
        agrees = fill(f"agrees with direct within {{magnitude_error:1}} of |Z|{differ}", check)
        text = parts(text, ";", agrees if check["agree"] else "DISAGREES with direct")
        mark = Mark.FAIL if not check["agree"] else Mark.CAUTION if differ else mark
    elif missing:
        text = parts(text, "; at", Value(data["frequency_hz"][missing[0]], "frequency"), found["reason"][missing[0]])
    return row(name.replace("-", " ").capitalize(), text, mark=mark)


def _deployable(data: Mapping[str, Any]) -> Row:
    passing, failing = (
        ", ".join(name for name, one in data["safety"].items() if (one["deployable"] is True) is right)
        for right in (True, False)
    )
    no = failing and f"not {failing}: not stable with every hand and released"
    mark = Mark.PASS if not failing else Mark.CAUTION if passing else Mark.FAIL
    return row("Deployable", "; ".join(filter(None, [passing, no])), mark=mark)


def run(data: Mapping[str, Any], found: Answer) -> Answer:
    """Return the answer of `run`: what to deploy, what the device received, the paper's question."""
    shown = [one for one in found.rows if one.rank == 0]
    beside = (device(data["push"]), *methods(data["compare"]))
    doubts = [one for one in shown[8:] if one.mark in {Mark.CAUTION, Mark.FAIL}]
    first = [*shown[:8], *doubts]
    later = [replace(one, rank=1) for one in shown if one not in first] + [one for one in found.rows if one.rank > 0]
    return replace(found, kind="run", data=data, rows=(*first, *beside, *later))


def device(push: Mapping[str, Any]) -> Row:
    """Return what became of the push."""
    if "skipped" in push:
        return row("Device", f"push skipped; {push['skipped']}", mark=Mark.CAUTION)
    if "refused" in push:
        advice = "the coupling is not deployable; --unsafe overrides"
        why = advice if push.get("deployable") is False else push["refused"]
        return row("Device", f"push refused; {why}", mark=Mark.FAIL)
    loop, unsafe = in_the_loop(push["in_the_loop"]), f"; {push['unsafe']}" if push["unsafe"] else ""
    what = f"coupling {push['coupling_id']} on {push['port']}, read back;"
    mark = Mark.CAUTION if unsafe and loop.mark is Mark.PASS else loop.mark
    return row("Device", what, loop.values, unsafe, mark=mark)


def new(data: Mapping[str, Any], problem: Problem, shown: str) -> Answer:
    """Return the answer of `new`: what is assumed, what is unknown and what is unlikely."""
    units, model = problem.units, data["model"]
    ranges = commas(span(getattr(problem.hands, key), quantity_of(key)) for key in subject.HAND)
    assumed = ", ".join(f"{units.key(key)} {value}" for key, value in data["assumed"].items())
    not_known = [f"{one['key'].partition('.')[2]}: {one['message']}" for one in data["not_known"]]
    rows: list[Row] = []
    if model is not None:
        poses = f"over {subject.plural(model['poses'], 'pose')} and all normals of {model['tip']}"
        rows.append(row("Mass", fill("{mass_kg},", model), span(model["range_kg"], "mass"), poses))
        if left := model["singular_poses"]:
            near = f"{subject.plural(left, 'pose')} near a singular one, where the mass grows without limit"
            rows.append(row("Left out", near, mark=Mark.CAUTION))
        if model["has_dry_friction"]:
            rows += subject.notes(["dry friction of the model's joints; that at the tip: --friction"], "Not used")
    rows += [
        row("Hands", f"{data['held']}:", ranges),
        *([row("Assumed", assumed)] if assumed else []),
        *subject.notes(not_known, "Not known"),
        *subject.notes((f"{one['key']} {one['message']}" for one in data["warnings"]), "Warning"),
    ]
    return subject.answer("new", data, problem, shown, rows, "recommend {} --out coupling.json")
