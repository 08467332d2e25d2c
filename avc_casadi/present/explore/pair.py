"""Answers of the page where a simulation or a follower is at the other end: K and B, stability, impedance, region."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.text import quantity
from avc_casadi.coupling import Coupling
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.design.tool_certificate import tool_certificate
from avc_casadi.design.tool_region import tool_region
from avc_casadi.design.virtual_tool import ToolSearch
from avc_casadi.loops.follower import FollowerLoops
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.scene import with_gains
from avc_casadi.present.explore.series import HZ, chart, line, region, touches
from avc_casadi.present.row import Row, count, marked, row
from avc_casadi.present.rows.judge import passivity
from avc_casadi.present.rows.recommend import felt_rows, stability
from avc_casadi.present.rows.subject import pair
from avc_casadi.recommendation.tool_impedance import rendered_band, rendered_follower, rendered_tool

if TYPE_CHECKING:
    from avc_casadi.design.tool_region import ToolRegion
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.explore.explorer import Explorer
    from avc_casadi.present.explore.settings import Settings

_NAMES = {"own": "your K and B", "method": "recommended"}


def pair_answer(
    explorer: Explorer, settings: Settings, problem: Problem, *, whole: bool
) -> tuple[dict[str, Any], list[Row], list[Row], list[dict[str, Any]]]:
    """Return K and B of one's own, rows of them and of the recommendation, and charts of both."""
    stated, tool = settings.key(), problem.simulation
    search = explorer.cached(f"search {stated}", lambda: ToolSearch(problem) if tool is not None else None)
    loops: Any = search.loops if search else explorer.cached(f"loops {stated}", lambda: FollowerLoops(problem))
    first = explorer.cached("first", lambda: _first(explorer.base, loops))
    own = ToolGains(**(vars(first) | _typed(settings)))
    found = explorer.coupling(settings)
    pairs = {"own": own} | ({} if found is None else {"method": found.gains})
    rows = explorer.cached(f"rows {stated} {own}", lambda: _rows(problem, search, loops, own))
    charts = _felt(problem, pairs)
    if tool is not None:
        rates: dict[str, Any] = {} if whole else {"rates": ()}
        stable = explorer.cached(f"region {whole} {stated}", lambda: tool_region(problem, summits=False, **rates))
        charts.insert(0, _region(problem, stable, pairs))
        if whole:
            runs = {}
            for cls, one in pairs.items():
                key = f"touch {stated} {settings.motion} {one}"
                runs[cls] = explorer.cached(key, partial(simulate, with_gains(problem, one)))
            charts += touches(runs, problem, "the contact begins at 0")
    return vars(own), rows, [], charts


def _typed(settings: Settings) -> dict[str, float]:
    typed = {key: 0.0 if value is None else value for key, value in settings.gains.items()}
    wrong = [
        Fault("", None, key, f"is {value!r}; allowed: a number from 0 to 1e12")
        for key, value in typed.items()
        if isinstance(value, str | bool) or not 0 <= value <= 1e12
    ]
    if wrong:
        raise InputError(wrong)
    return typed


def _first(problem: Problem, loops: Any) -> ToolGains:
    """Return the stiffest of some springs and dampers that all loops bear 1.5 times; the softest where none is."""
    device, end = problem.device, problem.simulation or problem.follower
    mass, wanted = device.mass_kg, None if end is None else end.stiffness_n_per_m
    local = problem.simulation is not None and problem.simulation.damped_locally
    stiffness = wanted or mass / device.sample_time_s**2
    for _ in range(40):
        for ratio in (1.0, 0.5, 0.25):
            critical = 2 * math.sqrt(stiffness * mass)
            pair = ToolGains(stiffness, ratio * critical, critical if local else 0.0)
            rounded = ToolGains(**{key: float(f"{value:.2g}") for key, value in vars(pair).items()})
            if loops.stable(rounded.times(1.5)):
                return rounded
        stiffness /= 1.5
    return rounded


def _rows(problem: Problem, search: ToolSearch | None, loops: Any, gains: ToolGains) -> list[Row]:
    rows = [row("Coupling", pair(vars(gains)))]
    rendered = rendered_follower if search is None else rendered_tool
    at = [asdict(one) for one in rendered(problem, gains)]
    felt = felt_rows({"stiffness_n_per_m": None, "on_stiffest_contact_n_per_m": None, "at": at})
    if search is None:
        stable = loops.stable_over_ranges(gains)
        text = "corner hands and released," if stable else "not all of"
        return [*rows, row("Stability", text, count(len(loops)), "loops", mark=marked(stable)), *felt]
    certificate = tool_certificate(problem, gains, search)
    return [*rows, *stability(certificate), *felt, *passivity(certificate["passivity"], problem)]


def _felt(problem: Problem, pairs: dict[str, ToolGains]) -> list[dict[str, Any]]:
    z, k = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    free: list[dict[str, Any]] = []
    rigid: list[dict[str, Any]] = []
    for cls, gains in pairs.items():
        band = rendered_band(problem, gains)
        hz, drag, mass, stiffness = (
            np.array([getattr(one, key) for one in band.felt])
            for key in ("frequency_hz", "drag_ns_per_m", "mass_kg", "stiffness_n_per_m")
        )
        rigid.append(line(_NAMES[cls], cls, hz, stiffness))
        if band.felt[0].mass_kg is not None:
            omega = 2 * np.pi * hz
            if not free:
                wanted = np.hypot(band.damping_ns_per_m, omega * band.mass_kg)
                free.append(line("device and other end as one body", "desired", hz, wanted))
            free.append(line(_NAMES[cls], cls, hz, np.hypot(drag, omega * mass)))
    charts = [chart("free", "Impedance |Z| in free motion", HZ, (z, "log"), free)] if free else []
    return [*charts, chart("rigid", "Stiffness on a rigid object", HZ, (k, "log"), rigid)]


def _region(problem: Problem, found: ToolRegion, pairs: dict[str, ToolGains]) -> dict[str, Any]:
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
    own = ToolGains(**({"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0} | _typed(settings)))
    certificate = tool_certificate(problem, own, search)
    verdict = f"your K and B, {'stable' if certificate['stable'] else 'not stable'}, without a trial"
    return Coupling.between(problem, own, certificate, None, explorer.versions), verdict
