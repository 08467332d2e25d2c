"""Questions of the page: one, `evaluate`, returns rows and charts of the settings; others begin runs or save files."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import AvcError, Fault, InputError, fault_document
from avc_casadi._util.json_values import json_text
from avc_casadi.files.catalogue import catalogue_names, device_names
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.files.device_file import load_device, parse_device
from avc_casadi.files.problem_file import dump_problem, problem_document
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.fields import value_of
from avc_casadi.present.explore.pair import pair_answer, pair_coupling
from avc_casadi.present.explore.settings import (
    RequestError,
    Settings,
    dropped_ranges,
    problem_of_settings,
    require_motion,
)
from avc_casadi.present.explore.wall import LAW, wall_answer, wall_coupling
from avc_casadi.present.row import Row, text_of
from avc_casadi.present.rows.subject import headline

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def start(explorer: Explorer, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page is built from: fields, devices, methods."""
    base, form = explorer.base, explorer.form
    own = explorer.source not in catalogue_names()
    return {
        "fields": [field.document() for field in form.fields],
        "gains": [field.document() for field in form.gains],
        "devices": [
            {"name": file.name, "title": file.title}
            for file in map(load_device, device_names())
            if file.device.motion == base.device.motion
        ],
        "live": form.live,
        "slow": form.slow,
        # A file of one's own is opened to deploy; the catalogue shows the paper's question.
        "method": "recommend" if own or not form.live else "direct",
    }


def evaluate(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return rows and charts of one's own gains and of the method; with ``whole`` what takes a second or more too."""
    settings, whole = explorer.settings(question), bool(question.get("whole"))
    problem = explorer.problem(settings)
    run = explorer.run(settings)
    answer = wall_answer if explorer.form.live else pair_answer
    gains, own, method, charts = answer(explorer, settings, problem, whole=whole)
    if settings.method in explorer.form.slow:
        method = [*explorer.run_rows(settings), *method]
    tables = problem_document(problem)
    units = problem.units
    return {
        "title": problem.title or problem.name,
        "headline": text_of(headline(problem, ""), units).strip(),
        "values": {field.key: value_of(tables, field) for field in explorer.form.fields},
        "dropped": dropped_ranges(explorer.base, settings, problem),
        "gains": gains,
        "rows": {"own": _rows(own, problem), "method": _rows(method, problem)},
        "running": run is not None and not run.over,
        "done": run is not None and run.result is not None,
        "charts": charts,
    }


def _rows(rows: Sequence[Row], problem: Problem) -> list[dict[str, str]]:
    return [{"label": one.label, "text": one.text(problem.units), "mark": one.mark.name.lower()} for one in rows]


def run(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Begin or cancel the run of a slow method, and return its rows."""
    settings = explorer.settings(question)
    if settings.method not in explorer.form.slow:
        raise RequestError(400, f"{settings.method} follows at once and is no run")
    found = explorer.run(settings, begin=bool(question.get("begin")), cancel=bool(question.get("cancel")))
    rows = _rows(explorer.run_rows(settings), explorer.base)
    done = found is not None and found.result is not None
    return {"rows": rows, "running": found is not None and not found.over, "done": done}


def device(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a device file that was read in the browser, or of a device of the catalogue."""
    text, name = question.get("text"), question.get("name")
    if isinstance(text, str):
        found = parse_device(text, file=str(question.get("file", "device.toml"))[:200])
    elif isinstance(name, str):
        found = load_device(name)
    else:
        raise RequestError(400, "device needs text or name")
    require_motion(found.device, explorer.base.device)
    gaps = ", ".join(map(found.device.units.key, found.gaps))
    note = f"Not known of it, and taken cautiously: {gaps}." if gaps else ""
    return {"note": note, "device": found.device.model_dump(mode="json", exclude_unset=True)}


def file(explorer: Explorer, question: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem or the coupling as a file, or both as commands to type."""
    settings, kind = explorer.settings(question), question.get("kind")
    problem = explorer.problem(settings)
    whole = problem_of_settings(explorer.base, settings, explorer.form, to_save=True)
    stem = f"{problem.name.replace('/', '-') or 'problem'}{'-b' if question.get('column') == 'b' else ''}"
    stem = f"./{stem}" if stem.startswith("-") else stem  # no option
    if kind == "problem":
        return {"name": f"{stem}.toml", "text": dump_problem(whole)}
    if kind == "command":
        return {"name": "", "text": _command(explorer, settings, whole, stem)}
    if kind != "coupling":
        raise RequestError(400, "kind is problem, coupling or command")
    of = wall_coupling if explorer.form.live else pair_coupling
    coupling, verdict = of(explorer, settings, problem)
    text = json_text(coupling_document(coupling), problem.units)
    return {"name": f"{stem}-coupling.json", "text": text, "note": verdict}


def _command(explorer: Explorer, settings: Settings, problem: Problem, stem: str) -> str:
    """Return what to type for the same: the problem as a file where it is none yet, then the verbs."""
    lines, which, out = [], shlex.quote(explorer.source), shlex.quote(f"{stem}-coupling.json")
    if settings.values or settings.device is not None:
        which = shlex.quote(f"{stem}.toml")
        lines = [f"cat > {which} <<'AVC_PROBLEM'", dump_problem(problem).rstrip(), "AVC_PROBLEM"]
    method = "" if settings.method == "recommend" else f" --method {settings.method}"
    lines.append(f"avc {'solve' if method else 'recommend'} {which}{method} --out {out}")
    if explorer.form.live:
        law = {name: settings.gains[key] for name, key in LAW.items() if settings.gains.get(key) is not None}
        typed = " ".join(f"--{name.replace('_', '-')} {value!r}" for name, value in law.items())
        lines += [f"avc certify {which} {typed}"] if typed else []
    return "\n".join(lines) + "\n"


Part = Callable[[Explorer, Mapping[str, Any]], dict[str, Any]]
PARTS: Mapping[str, Part] = {each.__name__: each for each in (start, evaluate, run, device, file)}
"""What the page can ask, by name."""


def answer(explorer: Explorer, part: Part, question: Mapping[str, Any]) -> dict[str, Any]:
    """Answer a question; what is wrong with the settings is an answer too, each fault with its field."""
    try:
        return part(explorer, question)
    except InputError as error:
        return {"errors": fault_document(error)["errors"]}
    except RequestError:
        raise
    except AvcError as error:
        return {"errors": [asdict(Fault("", None, "", str(error)))]}
