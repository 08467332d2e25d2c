"""Rows and charts of the page: a law of one's own beside the coupling of a method, to any other end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.text import quantity
from avc_casadi.claims.certify import certify
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.own_law import certify_law, first_law
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.design.tool_region import ToolRegion, tool_region
from avc_casadi.design.virtual_tool import FollowerSearch, ToolSearch, certify_pair
from avc_casadi.model.declared import with_gains
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.gains import NO_COUPLING, GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import perceived_bounds
from avc_casadi.paper.rows import gain_schedule
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.settings import Settings, gains_of
from avc_casadi.present.row import Row, grade, row
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.judge import ENDINGS, own_law, passivity
from avc_casadi.present.rows.recommend import felt_rows, stability
from avc_casadi.recommendation.felt import rendered_band, rendered_pair
from avc_casadi.simulation.scene import Run

Answers = tuple[dict[str, Any], list[Row], list[Row], list[dict[str, Any]]]
"""Gains of one's own, rows of them and of the method, charts of both."""
_HZ = ("frequency, Hz", "log")


def chart(
    name: str, title: str, x: tuple[str, str], y: tuple[str, str], series: Sequence[Mapping[str, Any]], **more: Any
) -> dict[str, Any]:
    """Return a chart: lines of values over x, with bands and points."""
    axes = {axis: {"label": label, "kind": kind} for axis, (label, kind) in (("x", x), ("y", y))}
    return {"id": name, "title": title, **axes, "series": series, **more}


def line(name: str, cls: str, x: Any, y: Any) -> dict[str, Any]:
    """Return a line of a chart; null where there is no value."""
    return {"name": name, "cls": cls, "x": six_digits(x), "y": six_digits(y)}


def six_digits(values: Any) -> list[float | None]:
    """Return numbers to six significant digits; None where there is none."""
    flat = np.atleast_1d(np.asarray(values, dtype=np.float64)).tolist()
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in flat]


def region(
    problem: Problem, title: str, of: str, lines: Sequence[Mapping[str, Any]], pairs: Mapping[tuple[str, str], Any]
) -> dict[str, Any]:
    """Return a chart of stiffness over damping, with pairs of stiffness and damping by name and class."""
    b, k = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    least = min(x for one in lines for x in one["x"])
    points = [
        {"name": name, "cls": cls, "x": max(damping, least), "y": stiffness}
        for (name, cls), (stiffness, damping) in pairs.items()
        if stiffness
    ]
    x, y = (f"{of} damping, {b}", "log"), (f"{of} stiffness, {k}", "log")
    return chart("region", title, x, y, lines, points=points, wide=True)


def touches(runs: Mapping[str, Run], problem: Problem, begins: str, names: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return position and force of simulated touches over time, with all their peaks."""
    time, position, force = ("time, s", "linear"), [], []
    for cls, run in runs.items():
        inside = slice(0, run.samples_in_reach)
        rows = _peaks(run.force_n[inside], run.position_m[inside])
        name = f"{names[cls]}: {ENDINGS[run.claim][0]}{', buzzes' if run.buzzing else ''}"
        position.append(line(name, cls, run.time_s[inside][rows], 1e3 * run.position_m[inside][rows]))
        force.append(line(name, cls, run.time_s[inside][rows], run.force_n[inside][rows]))
    deepest = max((value for one in position for value in one["y"] if value is not None), default=0.0)
    span = [-deepest, 1.3 * deepest] if deepest > 0 else None
    if runs:
        first = next(iter(runs.values()))
        position.insert(0, line("target of the hand", "desired", first.time_s[::10], 1e3 * first.target_m[::10]))
    mm, newton, turns = problem.units.unit("mm"), problem.units.unit("N"), problem.units.key("force")
    found = [
        chart("position", f"Simulated touch: position, {begins}", time, (mm, "linear"), position),
        chart("force", f"Simulated touch: {turns}", time, (newton, "linear"), force),
    ]
    found[0]["y"]["span"] = span
    return found


def _peaks(*traces: Any) -> Any:
    """Return the rows of each trace's lowest and highest value in 300 stretches."""
    rows = np.arange(len(traces[0]))
    stretches = np.array_split(rows, min(300, len(rows)))
    ends = [one[pick(trace[one])] for one in stretches for trace in traces for pick in (np.argmin, np.argmax)]
    return np.unique([*rows[[0, -1]], *ends])


LAW = {"k": "stiffness_n_per_m", "b": "damping_ns_per_m", "b_p": "local_damping_ns_per_m", "cutoff_hz": "cutoff_hz"}
"""Names of a law in `certify` by those of its fields."""


def found_by_method(
    explorer: Explorer, settings: Settings, problem: Problem
) -> tuple[GainSchedule | None, Coupling | None]:
    """Return gains and coupling of the method; None where it has found none, or is not done."""
    if settings.method in explorer.form.live:
        gains = explorer.cached(f"solve {settings.key('method')}", lambda: solve(problem, settings.method))
        key = f"coupling {settings.key('method', 'motion')}"
        return gains, explorer.cached(key, lambda: Coupling.of(problem, gains)) if gains.usable.any() else None
    if (run := explorer.coupling(settings)) is None:
        return None, None
    hz, law = problem.frequencies_hz(), run.runtime.state_feedback
    solved = (Status.SOLVED,) * len(hz)
    gains = gain_schedule(problem, run.method, tuple(run.table(hz)), solved, state_feedback=law)
    return gains, replace(run, problem=problem, versions=explorer.versions)


def wall_answer(explorer: Explorer, settings: Settings, problem: Problem, *, whole: bool) -> Answers:
    """Return the law of one's own before a wall beside the coupling of the method."""
    stated = settings.key()
    law = vars(explorer.cached("first", lambda: first_law(explorer.base))) | gains_of(settings, explorer.form)
    given = {name: law[key] for name, key in LAW.items() if law.get(key) is not None}
    found = explorer.cached(f"law {stated} {given}", lambda: certify_law(problem, **given, remedies=False))
    wall = {"stiffness_n_per_m": law["stiffness_n_per_m"] or 0.0}
    wall["damping_ns_per_m"] = (law["damping_ns_per_m"] or 0.0) + (law.get("local_damping_ns_per_m") or 0.0)
    direct = problem.changed(environment=wall, boundaries={"upper": wall, "lower": wall})
    schedule, coupling = found_by_method(explorer, settings, problem)
    method: list[Row] = []
    if schedule is not None and settings.method in explorer.form.live:
        method.append(row("Gains", f"{settings.method}: {subject.counts(schedule.counts())}"))
        if whole:
            method.append(subject.deployable(None if coupling is None else deployable(coupling).document()))
    charts = _impedances(problem, direct, schedule)
    if whole:
        runs = {}
        if "cutoff_hz" not in given and wall["stiffness_n_per_m"]:
            key = f"touch {stated} {settings.motion} {wall}"
            runs["own"] = explorer.cached(key, lambda: simulate(direct, NO_COUPLING))
        if coupling is not None:
            key = f"touch {settings.key('method', 'motion')}"
            runs["method"] = explorer.cached(key, lambda: simulate(problem, coupling.on(problem)))
        charts += touches(runs, problem, "the wall begins at 0", {"own": "your k and b", "method": settings.method})
        charts.append(_region(explorer, problem, stated, wall))
    return law, [one for one in own_law(found).rows if one.rank == 0], method, charts


def _impedances(problem: Problem, direct: Problem, schedule: GainSchedule | None) -> list[dict[str, Any]]:
    hz = problem.frequencies_hz()
    loop = loop_at(problem, hz)
    upper, lower = perceived_bounds(problem, loop)
    own = np.asarray(loop_at(direct, hz).without_coupling)
    curves = [("your k and b", "own", own)]
    if schedule is not None:
        curves.append((schedule.method, "method", np.where(schedule.usable, schedule.impedance, np.nan)))
    z, k = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    without = np.asarray(loop.without_coupling)
    size = [line("desired", "desired", hz, np.abs(loop.target)), line("no coupling", "without", hz, np.abs(without))]
    ends = {"low": six_digits(np.abs(lower)), "high": six_digits(np.abs(upper))}
    band = {"name": "feels real", "cls": "real", "x": six_digits(hz), **ends}
    size += [line(name, cls, hz, np.abs(one)) for name, cls, one in curves]
    real = [line(name, cls, hz, one.real) for name, cls, one in [("no coupling", "without", without), *curves]]
    title = "Real part of Z: below 0 the loop gives out energy"
    found = [
        chart("magnitude", "Impedance |Z| that the hand meets", _HZ, (z, "log"), size, bands=[band]),
        chart("real", title, _HZ, (z, "symlog"), real),
    ]
    if schedule is not None and len(np.unique(schedule.stiffness_n_per_m)) > 1:
        for name, title, unit, gains in (
            ("damping", "Damper b of the coupling", z, schedule.damping_ns_per_m),
            ("stiffness", "Spring k of the coupling", k, schedule.stiffness_n_per_m),
        ):
            found.append(chart(name, title, _HZ, (unit, "symlog"), [line(schedule.method, "method", hz, gains)]))
    return found


def _region(explorer: Explorer, problem: Problem, stated: str, law: Mapping[str, float]) -> dict[str, Any]:
    found, wall = explorer.cached(f"region {stated}", lambda: zwidth(problem)), problem.environment
    damping = found.damping_ns_per_m[1:]
    lines = [line(one.claim, one.key, damping, one.stiffness_n_per_m[1:]) for one in found.curves]
    pairs = {
        ("wanted wall", "desired"): (wall.stiffness_n_per_m, wall.damping_ns_per_m),
        ("your k and b", "own"): (law["stiffness_n_per_m"], law["damping_ns_per_m"]),
    }
    title = "Walls without coupling that this device renders: stiffness below each curve"
    return region(problem, title, "wall", lines, pairs)


def wall_coupling(explorer: Explorer, settings: Settings, problem: Problem) -> tuple[Coupling, str]:
    """Return the coupling to save, and what is said of it."""
    _, found = found_by_method(explorer, settings, problem)
    if found is None:
        raise InputError.of("no coupling yet: there is nothing to save", key="method")
    verdict = deployable(found).document()
    certificate = dict(found.certificate or certify(problem, found).document()) | {"deployable": verdict}
    return found.with_certificate(certificate), verdict["sentence"]


_NAMES = {"own": "your K and B", "method": "recommended"}


def pair_answer(explorer: Explorer, settings: Settings, problem: Problem, *, whole: bool) -> Answers:
    """Return K and B of one's own to a simulation or a follower beside the recommendation."""
    stated, tool = settings.key(), problem.simulation
    search = explorer.cached(
        f"search {stated}", lambda: FollowerSearch(problem) if tool is None else ToolSearch(problem)
    )
    first = explorer.cached("first", lambda: _first(explorer.base, search.loops))
    own = ToolGains(**(vars(first) | _typed(explorer, settings)))
    found = explorer.coupling(settings)
    pairs = {"own": own} | ({} if found is None else {"method": found.gains})
    rows = explorer.cached(f"rows {stated} {own}", lambda: _rows(problem, search, own))
    charts = _felt(problem, pairs)
    if tool is not None:
        rates: dict[str, Any] = {} if whole else {"rates": ()}
        stable = explorer.cached(f"region {whole} {stated}", lambda: tool_region(problem, summits=False, **rates))
        charts.insert(0, _pairs_region(problem, stable, pairs))
        if whole:
            runs = {}
            for cls, one in pairs.items():
                key = f"touch {stated} {settings.motion} {one}"
                runs[cls] = explorer.cached(key, partial(simulate, with_gains(problem, one)))
            charts += touches(runs, problem, "the contact begins at 0", _NAMES)
    return vars(own), rows, [], charts


def _typed(explorer: Explorer, settings: Settings) -> dict[str, float]:
    return {key: value or 0.0 for key, value in gains_of(settings, explorer.form).items()}


def _first(problem: Problem, loops: Any) -> ToolGains:
    """Return the stiffest of some springs and dampers that all loops bear 1.5 times; the softest where none is."""
    device, end = problem.device, problem.simulation or problem.follower
    mass, wanted = device.mass_kg, None if end is None else end.stiffness_n_per_m
    local = problem.simulation is not None and problem.simulation.damped_locally
    for stiffness in (wanted or mass / device.sample_time_s**2) / 1.5 ** np.arange(40):
        critical = 2 * math.sqrt(stiffness * mass)
        for ratio in (1.0, 0.5, 0.25):
            values = stiffness, ratio * critical, critical if local else 0.0
            pair = ToolGains(*(float(f"{value:.2g}") for value in values))
            if loops.stable(pair.times(1.5)):
                return pair
    return pair


def _rows(problem: Problem, search: ToolSearch | FollowerSearch, gains: ToolGains) -> list[Row]:
    rows = [row("Coupling", subject.pair(vars(gains)))]
    at = [asdict(one) for one in rendered_pair(problem, gains)]
    felt = felt_rows({"stiffness_n_per_m": None, "on_stiffest_contact_n_per_m": None, "at": at})
    if isinstance(search, FollowerSearch):
        stable = search.loops.stable_over_ranges(gains)
        text = f"{'corner hands, released, end stop:' if stable else 'not all of'} {len(search.loops)} loops"
        return [*rows, row("Stability", text, mark=grade(stable)), *felt]
    certificate = certify_pair(problem, gains, search)
    return [*rows, *stability(certificate), *felt, *passivity(certificate["passivity"], problem)]


def _felt(problem: Problem, pairs: dict[str, ToolGains]) -> list[dict[str, Any]]:
    z, k = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    free: list[dict[str, Any]] = []
    rigid: list[dict[str, Any]] = []
    for cls, gains in pairs.items():
        band, body_kg, body_ns_per_m = rendered_band(problem, gains)
        hz, drag, mass, stiffness = (
            np.array([getattr(one, key) for one in band])
            for key in ("frequency_hz", "drag_ns_per_m", "mass_kg", "stiffness_n_per_m")
        )
        rigid.append(line(_NAMES[cls], cls, hz, stiffness))
        if band[0].mass_kg is not None:
            omega = 2 * np.pi * hz
            if not free:
                name = "device and other end as one body"
                free.append(line(name, "desired", hz, np.hypot(body_ns_per_m, omega * body_kg)))
            free.append(line(_NAMES[cls], cls, hz, np.hypot(drag, omega * mass)))
    charts = [chart("free", "Impedance |Z| in free motion", _HZ, (z, "log"), free)] if free else []
    return [*charts, chart("rigid", "Stiffness on a rigid object", _HZ, (k, "log"), rigid)]


def _pairs_region(problem: Problem, found: ToolRegion, pairs: dict[str, ToolGains]) -> dict[str, Any]:
    damping, lines = found.damping_ns_per_m[1:], []
    for one in found.curves:
        name = f"{quantity(1 / one.step_s, 'Hz')}{', as declared' if one.declared else ''}"
        stiffness = np.where(one.stiffness_n_per_m[1:] > 0, one.stiffness_n_per_m[1:], np.nan)
        lines.append(line(name, "stable-hands" if one.declared else "without", damping, stiffness))
    marks = {(_NAMES[cls], cls): (one.stiffness_n_per_m, one.damping_ns_per_m) for cls, one in pairs.items()}
    title = "Springs and dampers that are stable with every corner hand, tool and contact: below each curve"
    return region(problem, title, "coupling's", lines, marks)


def pair_coupling(explorer: Explorer, settings: Settings, problem: Problem) -> tuple[Coupling, str]:
    """Return the coupling to save, and what is said of it: one's own K and B where they were typed."""
    if not settings.gains and (found := explorer.coupling(settings)) is not None:
        return replace(found, versions=explorer.versions), "the recommended coupling"
    if problem.simulation is None or not settings.gains:
        raise InputError.of("no coupling yet: there is nothing to save", key="method")
    search = explorer.cached(f"search {settings.key()}", lambda: ToolSearch(problem))
    own = ToolGains(**({"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0} | _typed(explorer, settings)))
    certificate = certify_pair(problem, own, search)
    verdict = f"your K and B, {'stable' if certificate['stable'] else 'not stable'}, without a trial"
    return Coupling.between(problem, own, certificate, None, explorer.versions), verdict
