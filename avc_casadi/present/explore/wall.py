"""Answers of the page for a wall: a law of one's own beside the coupling of a method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.claims.certify import certify
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.own_law import certify_law, first_law
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.model.gains import NO_COUPLING, GainSchedule, Status
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import perceived_bounds
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.present.explore.series import HZ, chart, line, region, short, touches
from avc_casadi.present.row import Row, row
from avc_casadi.present.rows.judge import own_law
from avc_casadi.present.rows.subject import counts
from avc_casadi.present.rows.subject import deployable as verdict_row
from avc_casadi.simulation.scene import simulate

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.explore.explorer import Explorer
    from avc_casadi.present.explore.settings import Settings

LAW = {"k": "stiffness_n_per_m", "b": "damping_ns_per_m", "b_p": "local_damping_ns_per_m", "cutoff_hz": "cutoff_hz"}
"""Names of a law in `certify` by those of its fields."""


def coupling_of(explorer: Explorer, settings: Settings, problem: Problem) -> Coupling | None:
    """Return the coupling of the method; None where it has found none, or is not done."""
    if settings.method in explorer.form.live:
        schedule = explorer.cached(f"solve {settings.key('method')}", lambda: solve(problem, settings.method))
        key = f"coupling {settings.key('method', 'motion')}"
        usable = bool(schedule.usable.any())
        return explorer.cached(key, lambda: Coupling.of(problem, schedule)) if usable else None
    found = explorer.coupling(settings)
    return None if found is None else replace(found, problem=problem, versions=explorer.versions)


def wall_answer(
    explorer: Explorer, settings: Settings, problem: Problem, *, whole: bool
) -> tuple[dict[str, Any], list[Row], list[Row], list[dict[str, Any]]]:
    """Return the law of one's own, rows of it and of the method, and charts of both."""
    stated = settings.key()
    law = vars(explorer.cached("first", lambda: first_law(explorer.base))) | dict(settings.gains)
    wrong = [Fault("", None, key, f"is {one!r}, not a number") for key, one in law.items() if isinstance(one, str)]
    if wrong:
        raise InputError(wrong)
    given = {name: law[key] for name, key in LAW.items() if law.get(key) is not None}
    try:
        found = explorer.cached(f"law {stated} {given}", lambda: certify_law(problem, **given, remedies=False))
    except InputError as error:
        raise InputError([replace(one, key=LAW.get(one.key, one.key)) for one in error.faults]) from error
    wall = {"stiffness_n_per_m": law["stiffness_n_per_m"] or 0.0}
    wall["damping_ns_per_m"] = (law["damping_ns_per_m"] or 0.0) + (law.get("local_damping_ns_per_m") or 0.0)
    direct = problem.changed(environment=wall, boundaries={"upper": wall, "lower": wall})
    coupling = coupling_of(explorer, settings, problem)
    method: list[Row] = []
    schedule: GainSchedule | None
    if settings.method in explorer.form.live:
        schedule = explorer.cached(f"solve {settings.key('method')}", lambda: solve(problem, settings.method))
        method.append(row("Gains", f"{settings.method}: {counts(schedule.counts())}"))
        if whole:
            method.append(verdict_row(None if coupling is None else deployable(coupling).document()))
    else:
        schedule = None if coupling is None else _schedule(coupling)
    charts = _impedances(problem, direct, schedule)
    if whole:
        runs = {}
        if "cutoff_hz" not in given and wall["stiffness_n_per_m"]:
            key = f"touch {stated} {settings.motion} {wall}"
            runs["own"] = explorer.cached(key, lambda: simulate(direct, NO_COUPLING))
        if coupling is not None:
            key = f"touch {settings.key('method', 'motion')}"
            runs["method"] = explorer.cached(key, lambda: simulate(problem, coupling.on(problem)))
        charts += touches(runs, problem, "the wall begins at 0")
        charts.append(_region(explorer, problem, stated, wall))
    return law, [one for one in own_law(found).rows if one.rank == 0], method, charts


def _schedule(coupling: Coupling) -> GainSchedule:
    """Return the gains of a coupling at the frequencies of its problem."""
    hz = coupling.problem.frequencies_hz()
    solved, law = (Status.SOLVED,) * len(hz), coupling.runtime.state_feedback
    return gain_schedule(coupling.problem, coupling.method, tuple(coupling.table(hz)), solved, state_feedback=law)


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
    ends = {"low": short(np.abs(lower)), "high": short(np.abs(upper))}
    band = {"name": "feels real", "cls": "real", "x": short(hz), **ends}
    size += [line(name, cls, hz, np.abs(one)) for name, cls, one in curves]
    real = [line(name, cls, hz, one.real) for name, cls, one in [("no coupling", "without", without), *curves]]
    title = "Real part of Z: below 0 the loop gives out energy"
    found = [
        chart("magnitude", "Impedance |Z| that the hand meets", HZ, (z, "log"), size, bands=[band]),
        chart("real", title, HZ, (z, "symlog"), real),
    ]
    if schedule is not None:
        for name, title, unit, gains in (
            ("damping", "Damper b of the coupling", z, schedule.damping_ns_per_m),
            ("stiffness", "Spring k of the coupling", k, schedule.stiffness_n_per_m),
        ):
            found.append(chart(name, title, HZ, (unit, "symlog"), [line(schedule.method, "method", hz, gains)]))
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
    found = coupling_of(explorer, settings, problem)
    if found is None:
        raise InputError.of("no coupling yet: there is nothing to save", key="method")
    verdict = deployable(found).document()
    certificate = dict(found.certificate or certify(problem, found).document()) | {"deployable": verdict}
    return found.with_certificate(certificate), verdict["sentence"]
