"""The parts of the page, each a question that the server answers: a few milliseconds to a second of work."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import AvcError, Fault, InputError, fault_document
from avc_casadi._util.json_values import json_text, plain
from avc_casadi.claims.certify import certify
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.design.registry import METHODS
from avc_casadi.files.catalogue import catalogue_names
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.files.device_file import device_catalogue, load_device, parse_device
from avc_casadi.files.gain_file import gain_csv
from avc_casadi.files.problem_file import dump_problem
from avc_casadi.loops.sampled_loop import passive_limit_n_per_m
from avc_casadi.loops.walls import stiffest_wall
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.own_law.certificate import certify_law
from avc_casadi.own_law.remedies import first_law
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import perceived_bounds
from avc_casadi.present.explore.fields import dotted_units, fields_document, labels_of, words_document
from avc_casadi.present.explore.requests import RequestError
from avc_casadi.present.explore.settings import (
    Settings,
    dropped_ranges,
    kept_of,
    problem_of_settings,
    require_motion,
    settings_of,
    values_of,
)
from avc_casadi.present.rows.own_law import own_law
from avc_casadi.simulation.scene import simulate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from avc_casadi.model.problem import Problem
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.present.explore.explorer import Explorer
    from avc_casadi.simulation.run import Run

_DIGITS = 6
# Points of a trace: a lowest and a highest in each of half as many stretches.
_TRACE_POINTS = 1200
# A command that the page does itself.
_OF_PROBLEM = re.compile(r"\b(avc [a-z][a-z0-9-]*) P\b")
_METHOD = re.compile(r"`?avc (?:recommend P|solve P --method ([a-z-]+))`?(?! --)")


def asked_settings(explorer: Explorer, asked: Mapping[str, Any]) -> Settings:
    """Read the settings of a question."""
    return settings_of(asked.get("settings"), explorer.form)


def start(explorer: Explorer, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page is built from: words, fields, devices, methods and the base."""
    base, form = explorer.base.device, explorer.form
    own = explorer.source not in catalogue_names()
    return {
        "end": form.end,
        "words": words_document(base.units),
        "fields": fields_document(base, form.fields),
        "gains": fields_document(base, form.gains),
        "own": fields_document(base, form.own),
        "values": values_of(explorer.base),
        "devices": [
            {"name": file.name, "title": file.title, "gaps": labels_of(file.gaps, base.units)}
            for file in device_catalogue()
            if file.device.motion == base.motion
        ],
        "live": list(form.live),
        "slow": list(form.slow),
        # A file of one's own is asked about for what to deploy; the catalogue shows the paper's question.
        "opens": "recommend" if own or form.end != "wall" else "direct",
        "papers": [name for name, one in METHODS.items() if one.answers_paper],
    }


def now(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return impedances and gains against frequency."""
    settings = asked_settings(explorer, asked)
    problem = explorer.problem(settings)
    frequency = problem.frequencies_hz()
    loop = loop_at(problem, frequency)
    upper, lower = perceived_bounds(problem, loop)
    return {
        "title": problem.title or problem.name,
        "values": values_of(problem),
        "kept": kept_of(problem),
        "dropped": dropped_ranges(explorer.base, settings, problem),
        "frequency_hz": short(frequency),
        "desired": _impedance(np.asarray(loop.target)),
        "without": _impedance(np.asarray(loop.without_coupling)),
        "upper": short(np.abs(upper)),
        "lower": short(np.abs(lower)),
        "passive_limit_n_per_m": plain(passive_limit_n_per_m(problem.device)),
        "gains": _gains(explorer.schedule(settings)),
    }


def law(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the certificate of the law of one's own, what a hand meets of it, and a touch."""
    settings = asked_settings(explorer, asked)
    problem = explorer.problem(settings)
    loop = f"{problem.device!r} {problem.hands!r} {problem.environment!r}"
    own = vars(explorer.laws(f"first law {loop}", lambda: first_law(problem))) | dict(settings.own)
    wrong = [
        Fault("", None, f"own.{key}", f"is {one!r}, not a number") for key, one in own.items() if isinstance(one, str)
    ]
    if wrong:
        raise InputError(wrong)
    given = {short_name: own[key] for short_name, key in _OWN.items() if own[key] is not None}
    try:
        key = f"law {loop} {sorted(given.items())}"
        found = explorer.laws(key, lambda: certify_law(problem, **given, remedies=False))
    except InputError as error:
        raise InputError([replace(one, key=f"own.{_OWN[one.key]}") for one in error.faults]) from error
    rows = [
        {"label": row.label, "text": page_text(explorer, row.text(problem.units)), "mark": row.mark.value.strip()}
        for row in own_law(found).rows
    ]
    wall = {"stiffness_n_per_m": given.get("k", 0.0), "damping_ns_per_m": given.get("b", 0.0) + given.get("b_p", 0.0)}
    direct = problem.changed(environment=wall, boundaries={"upper": wall, "lower": wall})
    frequency = problem.frequencies_hz()
    touched = None
    if "cutoff_hz" not in given and wall["stiffness_n_per_m"]:
        run = explorer.laws(f"touch {loop} {settings.motion} {wall}", lambda: simulate(direct, NO_COUPLING))
        touched = traces(run)
    felt = _impedance(np.asarray(loop_at(direct, frequency).without_coupling))
    return {
        "own": own,
        "rows": rows,
        "passed": found.passed,
        "frequency_hz": short(frequency),
        **felt,
        "touch": touched,
    }


def judge(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the certificate, the verdict on deployment and the stiffest wall of a spring and damper."""
    settings = asked_settings(explorer, asked)
    problem, coupling = explorer.problem(settings), explorer.coupling(settings)
    low_high = explorer.heavy(
        f"stiffest {problem.device!r} {problem.hands!r}",
        lambda: stiffest_wall(problem.device, with_released(hand_corners(problem.hands))),
    )
    found: dict[str, Any] = {"stiffest": plain(vars(low_high)), "deployable": None}
    schedule = explorer.schedule(settings)
    if coupling is None or schedule is None:
        return found
    return found | {
        "deployable": _verdict_text(
            explorer, explorer.heavy(f"deployable {settings.key}", lambda: deployable(coupling)).document()
        ),
    }


def touch(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return a simulated hand that presses, taps or holds the wall."""
    settings = asked_settings(explorer, asked)
    problem, coupling = explorer.problem(settings), explorer.coupling(settings)
    if coupling is None:
        return {"touch": None}
    run = explorer.heavy(f"touch {settings.key}", lambda: simulate(problem, coupling.on(problem)))
    return {"touch": traces(run)}


def region(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the K-B region of the device with its hands, and the wall that is wanted."""
    problem = explorer.problem(asked_settings(explorer, asked))
    found = explorer.regions(f"region {problem.device!r} {problem.hands!r}", lambda: zwidth(problem))
    return {
        "damping_ns_per_m": short(found.damping_ns_per_m),
        "curves": [
            {
                "key": curve.key,
                "claim": page_text(explorer, curve.claim),
                "stiffness_n_per_m": short(curve.stiffness_n_per_m),
            }
            for curve in found.curves
        ],
        "encoder_limit_n_per_m": found.encoder_limit_n_per_m,
    }


def work(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Begin a slow method, or say how far it is."""
    settings = asked_settings(explorer, asked)
    told = explorer.work(settings, begin=bool(asked.get("begin")))
    saved = f"{stem_of(explorer.problem(settings), asked)}.toml" if changed(settings) else explorer.source
    told["lines"] = [
        _OF_PROBLEM.sub(lambda found: f"{found[1]} {shlex.quote(saved)}", line) for line in told.get("lines", [])
    ]
    return told | {key: page_text(explorer, told[key]) for key in ("lines", "error", "what") if key in told}


def cancel(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """End a slow method."""
    return explorer.cancel(asked_settings(explorer, asked))


def device(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a device file that was read in the browser, or of a device of the catalogue."""
    text, name = asked.get("text"), asked.get("name")
    if isinstance(text, str):
        found = parse_device(text, file=str(asked.get("file", "device.toml"))[:200])
    elif isinstance(name, str):
        found = load_device(name)
    else:
        raise RequestError(400, "device needs text or name")
    require_motion(found.device, explorer.base.device)
    table = found.device.model_dump(mode="json", exclude_unset=True)
    return {"title": found.title, "gaps": labels_of(found.gaps, found.device.units), "device": table}


def file(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem or the coupling as a file, or both as commands to type."""
    settings, kind = asked_settings(explorer, asked), asked.get("kind")
    problem = explorer.problem(settings)
    whole = problem_of_settings(explorer.base, settings, to_save=True)
    stem = stem_of(problem, asked)
    if kind == "problem":
        return {"name": f"{stem}.toml", "text": dump_problem(whole)}
    if kind == "command":
        return {"name": "", "text": _command(explorer, settings, whole, stem)}
    if kind not in {"coupling", "csv"}:
        raise RequestError(400, "kind is problem, coupling, csv or command")
    coupling = explorer.coupling(settings)
    if coupling is None:
        raise InputError.of("no frequency has gains, or the run is not done: there is nothing to save", key="method")
    if kind == "csv":
        return {"name": f"{stem}-gains.csv", "text": gain_csv(coupling.schedule)}
    verdict = deployable(coupling).document()
    certificate = dict(coupling.certificate or certify(problem, coupling).document()) | {"deployable": verdict}
    text = json_text(coupling_document(coupling.with_certificate(certificate)), problem.units)
    return {"name": f"{stem}-coupling.json", "text": text, "told": page_text(explorer, verdict["sentence"])}


Part = Callable[["Explorer", Mapping[str, Any]], dict[str, Any]]
PARTS: Mapping[str, Part] = {
    each.__name__: each for each in (start, now, law, judge, touch, region, work, cancel, device, file)
}
"""What can be asked for, by name."""
_OWN = {
    "k": "stiffness_n_per_m",
    "b": "damping_ns_per_m",
    "b_p": "local_damping_ns_per_m",
    "cutoff_hz": "cutoff_hz",
}
_B, _K = "damping_ns_per_m", "stiffness_n_per_m"


def answer(explorer: Explorer, part: Part, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Answer a question; what is wrong with the settings is an answer too, each fault with its field."""
    try:
        return part(explorer, asked)
    except InputError as error:
        return {"errors": [_fault(explorer, one) for one in fault_document(error)["errors"]]}
    except RequestError:
        raise
    except AvcError as error:
        return {"refused": page_text(explorer, str(error))}


def _fault(explorer: Explorer, fault: dict[str, Any]) -> dict[str, Any]:
    form, bare = explorer.form, fault["key"].partition(".")[2]
    of_field = fault["key"] in form.keys or bare in (*form.gain_names, *form.own_names)
    key = fault["key"] if of_field else explorer.units.key(fault["key"])
    return fault | {"key": key, "message": page_text(explorer, fault["message"])}


def _verdict_text(explorer: Explorer, verdict: dict[str, Any]) -> dict[str, Any]:
    """Return a verdict whose advice is what to choose on the page, in place of a command."""
    claims = [one | {"advice": _METHOD.sub(_chosen, one["advice"])} for one in verdict["claims"]]
    told: dict[str, Any] = page_text(explorer, verdict | {"claims": claims})
    return told


def _chosen(found: re.Match[str]) -> str:
    return f"{found[1] or 'recommend'}, under Method"


def page_text(explorer: Explorer, told: Any) -> Any:
    """Return a text, or every text of an answer, in the words and with the units of the page."""
    if isinstance(told, str):
        return dotted_units(told)
    if isinstance(told, Mapping):
        return {key: page_text(explorer, one) for key, one in told.items()}
    return [page_text(explorer, one) for one in told] if isinstance(told, list | tuple) else told


def to_type(explorer: Explorer, settings: Settings, problem: Problem, stem: str) -> tuple[list[str], str, str]:
    """Return what to type before a verb, and how that takes problem and coupling: the file, where it is none yet."""
    stem = f"./{stem}" if stem.startswith("-") else stem  # no option
    name, out = (shlex.quote(f"{stem}{ending}") for ending in (".toml", "-coupling.json"))
    if not changed(settings):
        return [], shlex.quote(explorer.source), out
    return [f"cat > {name} <<'AVC_PROBLEM'", dump_problem(problem).rstrip(), "AVC_PROBLEM"], name, out


def _command(explorer: Explorer, settings: Settings, problem: Problem, stem: str) -> str:
    """Return what to type for the same: the problem as a file where it is none yet, then the verb."""
    lines, which, out = to_type(explorer, settings, problem, stem)
    if settings.method == "recommend":
        lines.append(f"avc recommend {which} --out {out}")
    elif settings.method == "constant" and settings.gains.get("contact_damping_ns_per_m"):
        return f"avc certify {out}  # the file of Save coupling\n"
    elif settings.method == "constant":
        given = [f"{settings.gains.get(key, 0.0):.15g}" for key in (_K, _B)]
        lines.append(f"avc compare {which} --mine {','.join(given)}")
    else:
        lines.append(f"avc solve {which} --method {settings.method} --out {out}")
    return "\n".join(lines) + "\n"


def changed(settings: Settings) -> bool:
    """Whether the settings mean another problem than the base."""
    return bool(settings.values) or settings.device is not None


def stem_of(problem: Problem, asked: Mapping[str, Any]) -> str:
    """Return how the files of one column are named; those of the second, which stand beside the first's, otherwise."""
    stem = problem.name.replace("/", "-") or "problem"
    return f"{stem}-b" if asked.get("column") == "b" else stem


def _gains(schedule: GainSchedule | None) -> dict[str, Any] | None:
    if schedule is None:
        return None
    usable = schedule.usable
    return {
        "method": schedule.method,
        "constant": bool(usable.all()) and bool(np.ptp(schedule.stiffness_n_per_m) == 0),
        "damping_ns_per_m": short(schedule.damping_ns_per_m),
        "stiffness_n_per_m": short(schedule.stiffness_n_per_m),
        "contact_damping_ns_per_m": short(schedule.contact_damping_ns_per_m),
        **_impedance(np.where(usable, schedule.impedance, np.nan)),
        "counts": schedule.counts(),
        "reasons": [*dict.fromkeys(filter(None, schedule.reason))][:3],
    }


def _impedance(values: Any) -> dict[str, Any]:
    return {"magnitude": short(np.abs(values)), "real": short(np.real(values))}


def traces(run: Run) -> dict[str, Any]:
    """Return the traces with their peaks kept, and what became of the run."""
    kept = slice(0, run.samples_in_reach)
    rows = _peaks(run.force_n[kept], run.position_m[kept])
    found = run.judgement
    return {
        "time_s": short(run.time_s[kept][rows]),
        "position_m": short(run.position_m[kept][rows]),
        "target_m": short(run.target_m[kept][rows]),
        "force_n": short(run.force_n[kept][rows]),
        "claim": run.claim,
        "buzzing": run.buzzing,
        "stiffness_n_per_m": plain(run.apparent_stiffness_n_per_m),
        "peak_force_n": plain(np.max(np.abs(run.force_n[kept]), initial=0.0)),
        "ripple_n": plain(found.force_ripple_n),
        "effects": list(run.effects),
    }


def _peaks(*traces: Any) -> Any:
    """Return the rows of each trace's lowest and highest value in every stretch; all rows of a short one."""
    samples = len(traces[0])
    if samples <= _TRACE_POINTS:
        return np.arange(samples)
    edges = np.linspace(0, samples, _TRACE_POINTS // (2 * len(traces)) + 1).astype(int)
    found = {0, samples - 1}
    for first, last in pairwise(edges.tolist()):
        for trace in traces:
            found |= {first + int(np.argmin(trace[first:last])), first + int(np.argmax(trace[first:last]))}
    return np.array(sorted(found))


def short(values: ArrayLike) -> list[float | None]:
    """Return numbers to so many significant digits; None where there is none."""
    return [
        float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
        for value in np.atleast_1d(np.asarray(values, dtype=np.float64)).tolist()
    ]
