"""Rows of the paper's question: the gains of one method, the methods side by side, a whole run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.text import sample_rows
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, count, listed, marked, parts, row, span, written
from avc_casadi.present.rows.deploy import in_the_loop
from avc_casadi.present.rows.judge import levels
from avc_casadi.present.rows.subject import (
    HAND,
    answer,
    counts,
    deployable,
    gains,
    name_of,
    notes,
    passive_limit,
    plural,
)

if TYPE_CHECKING:
    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.model.gains import GainSchedule
    from avc_casadi.model.problem import Problem

_GAINS = (("b", "damping_ns_per_m"), ("k", "stiffness_n_per_m"), ("b_p", "contact_damping_ns_per_m"))
# Rows of the recommendation in the answer of a run.
_FIRST = 8


def solution(data: Mapping[str, Any], problem: Problem, shown: str = "", file: str | None = None) -> Answer:
    """Return the answer of `solve`."""
    shown, status = shown or name_of(problem), data["status"]
    have = sum(b is not None for b in data["damping_ns_per_m"])
    by = data["method"] + (f" ({data['solver']})" if data["solver"] else "")
    seconds = Value(data["seconds"]["solve"], "time")
    real = data["realism"]
    inside = ("between U and L at", Value(real["share_inside_bounds"], "share"), "of the frequencies, within")
    near = (Value(real["jnd"], "share"), "of the impedance at", Value(real["share_inside_jnd"], "share"))
    text = (f"{by}: at", count(have), "of", count(len(status)), "frequencies in", seconds)
    rows = [
        row("Gains", text, mark=marked(have == len(status))),
        *([row("Coupling", gains(data, problem))] if have else []),
        row("Status", counts(data["counts"])),
        *_errors(data),
        row("Realism", inside, near),
        deployable(data["deployable"]),
        passive_limit(data["passive_limit_n_per_m"]),
    ]
    if "paper_errors" in data:
        errors = f"{len(data['paper_errors'])} in the printed paper; these gains have those of (10) and (17)"
        rows.append(row("Paper's errors", errors, mark=Mark.CAUTION))
    rows += [*written(file), *gain_rows(data), *notes(data["notes"], rank=1, mark=Mark.NONE)]
    rows += [*levels(data["certificate"]["levels"]), *printed_errors(data.get("paper_errors", ()))]
    printed = " --as-printed" if "paper_errors" in data else ""
    again = f"avc solve {quote(shown)} --method {data['method']}{printed}"
    beside = f"{quote(shown)} " if file and file.endswith(".csv") else ""
    onwards = f"avc certify {beside}{quote(file)}" if file and data["deployable"] else f"{again} --out gains.json"
    return answer("solve", data, problem, shown, rows, (onwards, f"{again} -v"), without_gains(data))


def printed_errors(errors: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return the errors of the printed paper, of lower rank."""
    return [
        row(one["equation"], f"printed {one['as_printed']}; correct {one['correct']}; {one['effect']}", rank=1)
        for one in errors
    ]


def without_gains(data: Mapping[str, Any]) -> str:
    """Describe the rows without gains, with reasons; empty where all have."""
    states, reasons, frequency = data["status"], data["reason"], data["frequency_hz"]
    missing = [at for at, b in enumerate(data["damping_ns_per_m"]) if b is None]
    if not missing:
        return ""
    lines = [f"avc: {len(missing)} of {len(states)} frequencies have no gains ({data['method']})"]
    for state in dict.fromkeys(states[at] for at in missing):
        alike = [at for at in missing if states[at] == state]
        lines += [f"  {state} at {frequency[at]:.4g} Hz: {reasons[at]}" for at in dict.fromkeys((alike[0], alike[-1]))]
        lines += [f"  and {len(alike) - 2} more {state} between"] if len(alike) > 2 else []
    return "\n".join(lines)


def gain_rows(data: Mapping[str, Any], most: int = 20) -> list[Row]:
    """Return the gains and errors at some of the frequencies, of lower rank."""
    rows = []
    for at in sample_rows(len(data["frequency_hz"]), most):
        each: list[Any] = [
            (symbol, Value(data[key][at], "stiffness" if symbol == "k" else "damping"))
            for symbol, key in _GAINS
            if data[key][at]
        ]
        each.append(("error of |Z|", Value(data["magnitude_error"][at], "damping")))
        each.append(("impedance error", Value(data["complex_error"][at], "share")))
        each += [("Re Z_h", Value(data["real_part"][at], "damping")), data["status"][at]]
        rows.append(row(f"{data['frequency_hz'][at]:.4g} Hz", listed(each), rank=1))
    return rows


def _errors(data: Mapping[str, Any]) -> list[Row]:
    """Return the largest errors of magnitude and impedance, and their frequencies."""
    rows = []
    for label, key in (("Error of |Z|", "magnitude_error"), ("Impedance error", "complex_error")):
        found = zip(data[key], data["frequency_hz"], data["damping_ns_per_m"], strict=True)
        known = [(error, at) for error, at, b in found if None not in (error, b)]
        if known:
            error, at = max(known)
            value = Value(error, "damping" if key == "magnitude_error" else "share")
            rows.append(row(label, "at most", value, ", at", Value(at, "frequency")))
    return rows


def comparison(data: Mapping[str, Any], problem: Problem, shown: str = "", drawn: str | None = None) -> Answer:
    """Return the answer of `compare`."""
    shown, realism = shown or name_of(problem), {name: one["realism"] for name, one in data["methods"].items()}
    if data["mine"] is not None:
        realism["mine"] = data["mine"]["realism"]
    between, near = (
        listed((name.replace("-", " "), Value(one[key], "share")) for name, one in realism.items())
        for key in ("share_inside_bounds", "share_inside_jnd")
    )
    rows = [
        *(_method(name, one, data) for name, one in data["methods"].items()),
        row("Verdicts", f"{counts(data['counts'])}, pointwise"),
        _deployable(data),
        row("Between U, L", "of the frequencies:", between),
        row("Impedance error", "within", Value(next(iter(realism.values()))["jnd"], "share"), ":", near),
        _injection(data["damping_injection"]),
        *_mine(data),
        passive_limit(data["passive_limit_n_per_m"]),
    ]
    if data["problem_scope"] != data["scope"]:
        rows.append(row("Not compared", f"gains of scope {data['problem_scope']} (avc solve)", mark=Mark.CAUTION))
    rows += written(drawn, label="Drawn")
    missing = [at for at, verdict in enumerate(data["verdict"]) if verdict == "infeasible"]
    complaint = ""
    if missing:
        first = f"first at {data['frequency_hz'][missing[0]]:.4g} Hz: {data['reason'][missing[0]]}"
        complaint = f"avc: {len(missing)} of {len(data['verdict'])} frequencies are infeasible, {first}"
    rows += [*_verdicts(data), *gain_rows(data["methods"][data["optimum"]])]
    onwards = (f"avc recommend {quote(shown)}", f"avc compare {quote(shown)} -v")
    return answer("compare", data, problem, shown, rows, onwards, complaint)


def _method(name: str, found: Mapping[str, Any], data: Mapping[str, Any]) -> Row:
    """Return where a method has gains, and the first reason why not, or its distance from the other optimum."""
    damping, check = found["damping_ns_per_m"], data["cross_check"]
    missing = [at for at, b in enumerate(damping) if b is None]
    text: tuple[Part, ...] = parts("at", count(len(damping) - len(missing)), "of", count(len(damping)), "frequencies")
    mark = Mark.PASS if not missing else Mark.FAIL if name == data["optimum"] else Mark.CAUTION
    if name == "exact" and check is not None:
        agreement, agrees = _cross_check(check)
        text, mark = parts(text, ";", agreement), mark if agrees is Mark.PASS else agrees
    elif missing:
        text = parts(text, "; at", Value(data["frequency_hz"][missing[0]], "frequency"), found["reason"][missing[0]])
    return row(name.replace("-", " ").capitalize(), text, mark=mark)


def _cross_check(check: Mapping[str, Any]) -> tuple[tuple[Part, ...], Mark]:
    """Return how the exact optimum and that of the NLP agree."""
    if not check["agree"]:
        return ("DISAGREES with direct",), Mark.FAIL
    differ = f", differs at {len(check['partings'])} frequencies" if check["partings"] else ""
    text = parts("agrees with direct within", Value(check["magnitude_error"], "number", 1), "of |Z|", differ)
    return text, marked(not differ, Mark.CAUTION)


def _deployable(data: Mapping[str, Any]) -> Row:
    found = {name: one["deployable"] is True for name, one in data["safety"].items()}
    passing, failing = ([name for name, passed in found.items() if passed is right] for right in (True, False))
    if not failing:
        return row("Deployable", f"all: {', '.join(passing)}", mark=Mark.PASS)
    if not passing:
        what = f"none of {', '.join(failing)}: not stable with every corner hand and released"
        return row("Deployable", what, mark=Mark.FAIL)
    return row("Deployable", f"{', '.join(passing)}; not {', '.join(failing)}", mark=Mark.CAUTION)


def _injection(found: Mapping[str, Any]) -> Row:
    """Return what the closed form adds to the desired wall."""
    delta = found["injected_damping_ns_per_m"]
    needed = [at for at, value in enumerate(delta) if value > 0]
    if not needed:
        return row("Injected", "nothing: the desired wall meets (12) everywhere")
    worst = max(needed, key=delta.__getitem__)
    most = ("damper", Value(delta[worst], "damping"), ", virtual mass", Value(found["virtual_mass_kg"][worst], "mass"))
    return row("Injected", f"by the closed form at {len(needed)} frequencies:", most, "at most")


def _mine(data: Mapping[str, Any]) -> list[Row]:
    mine = data["mine"]
    if mine is None:
        return []
    pair = (Value(mine["stiffness_n_per_m"], "stiffness"), ",", Value(mine["damping_ns_per_m"], "damping"))
    meets = f": meets (12) at {sum(mine['meets_margin'])} of {len(mine['meets_margin'])} frequencies"
    nearer = (f"; {mine['compared']} better at", Value(mine["share_schedule_better"], "share"))
    outside = "" if mine["inside_box"] else "; outside the gain box"
    mark = marked(all(mine["meets_margin"]), Mark.CAUTION)
    return [row("Mine", pair, meets, nearer, outside, mark=mark), row("Mine", mine["safety_reason"], rank=1)]


def _verdicts(data: Mapping[str, Any]) -> list[Row]:
    """Return each verdict with the first frequency where it applies and why."""
    rows = []
    for verdict, times in data["counts"].items():
        if times:
            at = data["verdict"].index(verdict)
            first = ("at", count(times), "frequencies, first at", Value(data["frequency_hz"][at], "frequency"))
            rows.append(row(verdict.capitalize(), first, f": {data['reason'][at]}", rank=1))
    return rows


def run(data: Mapping[str, Any], found: Answer, files: str) -> Answer:
    """Return the answer of `run`: what to deploy; before a wall what the device received and the paper's question."""
    shown = [one for one in found.rows if one.rank == 0 and one.label != "Written"]
    beside = (device(data["push"]), *paper(data)) if "push" in data else ()
    first = shown[:_FIRST] if beside else shown
    later = [replace(one, rank=1) for one in shown[len(first) :]] + [one for one in found.rows if one.rank > 0]
    return replace(found, kind="run", data=data, rows=(*first, *beside, *written(files), *later))


def paper(data: Mapping[str, Any]) -> list[Row]:
    """Answer the paper's question: closed form, CasADi's NLP, the exact optimum, the verdict."""
    rows, closed, check, have = data["rows"], data["closed_form"], data["cross_check"], data["rows_with_gains"]
    realisable = closed.get("solved", 0) + closed.get("active-bound", 0)
    spans = listed(
        (symbol, span(data[key], "stiffness" if symbol == "k" else "damping"))
        for symbol, key in _GAINS[:2]
        if data[key] is not None
    )
    scope = "" if data["scope"] == "pointwise" else f", scope {data['scope']}"
    solved = ("gains at", count(have), "of", count(rows), "frequencies in", Value(data["seconds"]["solve"], "time", 2))
    buildable = (f"realisable at {realisable} of", count(rows), "frequencies")
    found = [
        row("Closed form", buildable, mark=marked(realisable == rows, Mark.CAUTION)),
        row(f"CasADi, {data['method']}", solved, scope, ":" if spans else "", spans, mark=marked(have == rows)),
    ]
    if check is not None:
        text, mark = _cross_check(check)
        found.append(row("Exact optimum", text, mark=mark))
    return [*found, row("Verdicts", f"{counts(data['counts'])}, pointwise")]


def device(push: Mapping[str, Any]) -> Row:
    """Return what became of the push."""
    if "skipped" in push:
        return row("Device", f"push skipped; {push['skipped']}", mark=Mark.CAUTION)
    if "refused" in push:
        advice = "the coupling is not deployable; --unsafe overrides"
        why = advice if push.get("deployable") is False else push["refused"]
        return row("Device", f"push refused; {why}", mark=Mark.FAIL)
    equal, loop = (
        "read back equal" if push["readback_equal"] else "read back NOT EQUAL",
        in_the_loop(push["in_the_loop"]),
    )
    unsafe = f"; {push['unsafe']}" if push["unsafe"] else ""
    mark = marked(loop.mark is Mark.PASS and not unsafe, Mark.CAUTION) if push["readback_equal"] else Mark.FAIL
    what = f"coupling {push['coupling_id']} on {push['port']}, {equal};"
    return row("Device", what, loop.values, unsafe, mark=mark)


def new(data: Mapping[str, Any], problem: Problem, shown: str) -> Answer:
    """Return the answer of `new`: what was written, what is unknown and what is unlikely."""
    hands, units = problem.hands, problem.units
    ranges = listed(span(getattr(hands, key), of) for key, of in HAND)
    assumed = ", ".join(f"{units.key(key)} {value}" for key, value in data["assumed"].items())
    not_known = [f"{one['key'].partition('.')[2]}: {one['message']}" for one in data["not_known"]]
    rows = [
        row("Written", data["file"], mark=Mark.PASS),
        *_model(data["model"]),
        row("Hands", f"{data['held']}:", ranges),
        *([row("Assumed", assumed)] if assumed else []),
        *notes(not_known, "Not known"),
        *notes((f"{one['key']} {one['message']}" for one in data["warnings"]), "Warning"),
    ]
    onwards = (f"avc recommend {quote(shown)} --out coupling.json",)
    return answer("new", data, problem, shown, rows, onwards)


def _model(model: Mapping[str, Any] | None) -> list[Row]:
    """Return what a model says of the mass, and what was left out of it."""
    if model is None:
        return []
    poses = f"over {plural(model['poses'], 'pose')} and all normals of {model['tip']}"
    rows = [row("Mass", Value(model["mass_kg"], "mass"), ",", span(model["range_kg"], "mass"), poses)]
    if left := model["singular_poses"]:
        near = f"{plural(left, 'pose')} near a singular one, where the mass grows without limit"
        rows.append(row("Left out", near, mark=Mark.CAUTION))
    if model["has_dry_friction"]:
        rows += notes(["dry friction of the model's joints; that at the tip: --friction"], "Not used")
    return rows


def paper_data(found: Comparison, best: GainSchedule) -> dict[str, Any]:
    """Return the numbers of the paper's question as JSON values: of the comparison and of the gains of its scope."""
    usable, check = best.usable, found.cross_check
    ends = {
        key: [float(values[usable].min()), float(values[usable].max())] if usable.any() else None
        for key, values in (
            ("damping_ns_per_m", best.damping_ns_per_m),
            ("stiffness_n_per_m", best.stiffness_n_per_m),
        )
    }
    data: dict[str, Any] = plain(
        {
            "structure": found.structure,
            "model": found.model,
            "scope": found.scope,
            "passive_limit_n_per_m": found.passive_limit_n_per_m,
            "method": best.method,
            "solver": best.solver,
            "rows": best.rows,
            "rows_with_gains": int(usable.sum()),
            "seconds": {"build": best.build_seconds, "solve": best.solve_seconds},
            **ends,
            "cross_check": check,
            "counts": found.counts(),
            "closed_form": found.methods["closed-form"].counts(),
        }
    )
    return data
