"""The parts of the page where an engine is at the other end: K against B, what is claimed, what is felt.

Until a run of `recommend` is done the page shows the pair with which that begins, tried by nobody.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import InputError
from avc_casadi._util.json_values import json_text, plain
from avc_casadi._util.text import quantity
from avc_casadi.coupling import Coupling
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.design.tool_certificate import tool_certificate
from avc_casadi.design.tool_region import tool_region
from avc_casadi.design.virtual_tool import ToolSearch, designed
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.files.problem_file import dump_problem
from avc_casadi.model.declared import with_gains
from avc_casadi.model.virtual_tool import ToolGains
from avc_casadi.present.explore.answers import (
    Part,
    asked_settings,
    cancel,
    device,
    page_text,
    short,
    start,
    stem_of,
    to_type,
    traces,
    work,
)
from avc_casadi.present.explore.requests import RequestError
from avc_casadi.present.explore.settings import (
    Settings,
    constant_gains,
    dropped_ranges,
    kept_of,
    problem_of_settings,
    values_of,
)
from avc_casadi.present.row import Mark, Row, row, text_of
from avc_casadi.present.rows.judge import contacts, passivity, stability
from avc_casadi.present.rows.recommend import felt_rows
from avc_casadi.present.rows.subject import headline, pair
from avc_casadi.recommendation.tool_impedance import rendered_band, rendered_tool
from avc_casadi.recommendation.virtual_tool import unusual, why_infeasible

if TYPE_CHECKING:
    from avc_casadi.design.tool_region import ToolCurve, ToolRegion
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.explore.explorer import Explorer


def now(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the pair, what is claimed of it and what the handle feels like."""
    settings = asked_settings(explorer, asked)
    # Before the gains: a run that ends in between is asked for again.
    awaited = settings.method != "constant" and not explorer.done(settings)
    problem, gains = explorer.problem(settings), _gains(explorer, settings)
    found: dict[str, Any] = {
        "title": problem.title or problem.name,
        "headline": page_text(explorer, text_of(headline(problem, ""), problem.units).strip()),
        "values": values_of(problem),
        "kept": kept_of(problem),
        "dropped": dropped_ranges(explorer.base, settings, problem),
        "gains": None,
        "awaited": awaited,
    }
    if gains is None:
        _limit(explorer, problem)
        why = why_infeasible(problem, _search(explorer, problem)) or "none was found: the run says why"
        return found | {"rows": _rows(explorer, [row("Coupling", why, mark=Mark.FAIL)])}
    band, search = rendered_band(problem, gains), _search(explorer, problem)
    certificate = explorer.heavy(f"claims {settings.key}", lambda: tool_certificate(problem, gains, search))
    felt = {
        "stiffness_n_per_m": _pressed(explorer, settings),
        "on_stiffest_contact_n_per_m": None,
        "at": [asdict(one) for one in rendered_tool(problem, gains)],
    }
    rows = [
        row("Coupling", pair(vars(gains)), _tried(explorer, settings)),
        *stability(certificate),
        *contacts(search.loops, gains, problem),
        *felt_rows(felt),
    ]
    # Where the engine moves nothing it is no port.
    if problem.simulation is not None and problem.simulation.tool_mass_kg is not None:
        rows += passivity(certificate["passivity"], problem)
    return found | {
        "gains": {"method": settings.method, **vars(gains)},
        "stable": certificate["stable"],
        "rows": _rows(explorer, rows),
        "felt": {
            "frequency_hz": short([one.frequency_hz for one in band.felt]),
            "drag_ns_per_m": _known([one.drag_ns_per_m for one in band.felt]),
            "mass_kg": _known([one.mass_kg for one in band.felt]),
            "stiffness_n_per_m": short([one.stiffness_n_per_m for one in band.felt]),
            "wanted": plain({"mass_kg": band.mass_kg, "damping_ns_per_m": band.damping_ns_per_m}),
        },
    }


def judge(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stiffest pair, and what is unusual of tool and engine."""
    problem = explorer.problem(asked_settings(explorer, asked))
    search = _search(explorer, problem)
    stiffest = _limit(explorer, problem)
    limit = row("Linear limit", why_infeasible(problem, search), mark=Mark.FAIL)
    if stiffest.stiffness_n_per_m > 0:
        limit = row("Linear limit", "stiffest stable pair:", pair(vars(stiffest)))
    keys = problem.units.key
    odd = [row("Unusual", f"{keys(key)} {text}", mark=Mark.CAUTION) for key, text in unusual(problem).items()]
    return {"stiffest": plain(vars(stiffest)), "rows": _rows(explorer, [limit, *odd])}


def touch(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return a simulated hand that presses, taps or holds the tool on its stiffest contact."""
    settings = asked_settings(explorer, asked)
    problem, gains = explorer.problem(settings), _gains(explorer, settings)
    if gains is None:
        return {"touch": None}
    return {"touch": traces(explorer.heavy(f"touch {settings.key}", lambda: simulate(with_gains(problem, gains))))}


def curve(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return K against B at the declared step alone, and with the pair's own local damper where it has one."""
    settings = asked_settings(explorer, asked)
    problem, gains = explorer.problem(settings), _gains(explorer, settings)
    stated, own = _stated(problem), 0.0 if gains is None else gains.local_damping_ns_per_m
    found = explorer.regions(f"curve {stated}", lambda: tool_region(problem, rates=(), summits=False))
    if own == 0:
        return _drawn(found) | {"with_own_damper": None}
    beside = explorer.regions(
        f"curve {own} {stated}", lambda: tool_region(problem, rates=(), local_damping_ns_per_m=own, summits=False)
    )
    return _drawn(found) | {"with_own_damper": _limits(beside.curves[0])}


def region(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return K against B at the declared step of the engine, and at faster and slower ones."""
    problem = explorer.problem(asked_settings(explorer, asked))
    return _drawn(explorer.regions(f"region {_stated(problem)}", lambda: tool_region(problem, summits=False)))


def file(explorer: Explorer, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem or the coupling as a file, or both as commands to type."""
    settings, kind = asked_settings(explorer, asked), asked.get("kind")
    problem = problem_of_settings(explorer.base, settings, to_save=True)
    stem = stem_of(problem, asked)
    if kind == "problem":
        return {"name": f"{stem}.toml", "text": dump_problem(problem)}
    if kind == "command":
        lines, which, out = to_type(explorer, settings, problem, stem)
        verbs = [f"avc recommend {which} --out {out}"]
        if settings.method == "constant":
            verbs = [f"avc zwidth {which}", f"avc certify {out}  # the file of Save coupling"]
        return {"name": "", "text": "\n".join([*lines, *verbs]) + "\n"}
    if kind != "coupling":
        raise RequestError(400, "kind is problem, coupling or command")
    gains = _gains(explorer, settings)
    if gains is None:
        raise InputError.of("no pair is stable: there is nothing to save", key="method")
    ran: Coupling | None = explorer.found(settings)
    certificate = tool_certificate(problem, gains, _search(explorer, problem))
    coupling = Coupling.between(problem, gains, certificate, None if ran is None else ran.trial, explorer.versions)
    told = stability(certificate)[0].text(problem.units) + _tried(explorer, settings)
    return {
        "name": f"{stem}-coupling.json",
        "text": json_text(coupling_document(coupling), explorer.units),
        "told": page_text(explorer, told),
    }


TOOL_PARTS: Mapping[str, Part] = {
    each.__name__: each for each in (start, now, judge, touch, curve, region, work, cancel, device, file)
}
"""What can be asked for, by name, where an engine is at the other end."""


def _stated(problem: Problem) -> str:
    """Return what loops and limits depend on, as a text."""
    return f"{problem.device!r} {problem.hands!r} {problem.simulation!r}"


def _search(explorer: Explorer, problem: Problem) -> ToolSearch:
    return explorer.schedules(f"search {_stated(problem)}", lambda: ToolSearch(problem))


def _limit(explorer: Explorer, problem: Problem) -> ToolGains:
    """Return the stiffest stable pair; asked before what asks for it again, so that no two threads work it out."""
    search = _search(explorer, problem)
    return explorer.schedules(f"limit {_stated(problem)}", lambda: search.limit)[0]


def _gains(explorer: Explorer, settings: Settings) -> ToolGains | None:
    """Return the pair that is typed, that a run has found, or with which one begins; None where there is none."""
    problem = explorer.problem(settings)
    if settings.method == "constant":
        return ToolGains(**constant_gains(settings, explorer.form))
    if explorer.done(settings):
        ran: Coupling | None = explorer.found(settings)
        return None if ran is None else ran.gains
    _limit(explorer, problem)
    search = _search(explorer, problem)
    return explorer.schedules(f"designed {_stated(problem)}", lambda: designed(search))


def _tried(explorer: Explorer, settings: Settings) -> str:
    """Say who has tried the pair, where nobody has."""
    return "" if settings.method != "constant" and explorer.done(settings) else "; not tried yet"


def _pressed(explorer: Explorer, settings: Settings) -> float | None:
    """Return the stiffness that the hands of a run met, where there was one."""
    ran: Coupling | None = explorer.found(settings)
    return None if ran is None or ran.trial is None else ran.trial["rendered_stiffness_n_per_m"]


def _rows(explorer: Explorer, rows: list[Row]) -> list[dict[str, str]]:
    units = explorer.units
    found = [{"label": one.label, "text": one.text(units), "mark": one.mark.name.lower()} for one in rows]
    told: list[dict[str, str]] = page_text(explorer, found)
    return told


def _drawn(found: ToolRegion) -> dict[str, Any]:
    return {
        "damping_ns_per_m": short(found.damping_ns_per_m),
        "critical_damper": found.local_damping_ratio > 0,
        "curves": [
            {
                "rate": quantity(1 / one.step_s, "Hz"),
                "declared": one.declared,
                "stiffness_n_per_m": _limits(one),
            }
            for one in found.curves
        ],
    }


def _limits(curve: ToolCurve) -> list[float | None]:
    """Return K at each B; None where none is stable, which no logarithm shows."""
    return [k or None for k in short(curve.stiffness_n_per_m)]


def _known(values: list[float | None]) -> list[float | None]:
    return short([float("nan") if one is None else one for one in values])
