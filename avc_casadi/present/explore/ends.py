"""Rows and charts of the page: a law of one's own beside the coupling of a method, to any other end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial, singledispatch
from typing import Any

import numpy as np

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.text import quantity
from avc_casadi.claims.certify import certify
from avc_casadi.claims.deployable import DeployedCertificate, deployable
from avc_casadi.claims.law_analysis import first_law
from avc_casadi.claims.own_law import certify_law
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.design.pair_certificate import certify_pair
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.design.tool_region import ToolRegion, tool_region
from avc_casadi.design.virtual_tool import EndSearch, search_of
from avc_casadi.files.problem_file import dump_problem, problem_document
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.declared import with_gains
from avc_casadi.model.ends import End, Simulation, ToolGains, Wall
from avc_casadi.model.gains import NO_COUPLING, GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import perceived_bounds
from avc_casadi.paper.rows import gain_schedule
from avc_casadi.present import words
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.settings import Settings, gains_of
from avc_casadi.present.explore.verdict import Judged, Verdict, of_coupling, of_law, of_pair, of_stability
from avc_casadi.present.row import Mark, Part, Row, grade, row
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.judge import own_law, passivity
from avc_casadi.present.rows.other_ends import rendered_rows, stability
from avc_casadi.recommendation.rendered import RenderedPair, rendered_band, rendered_pair
from avc_casadi.simulation.scene import Run

_HZ = ("frequency, Hz", "log")
"""Label and kind of an axis of frequencies."""

_STRETCHES = 300
"""Stretches of a trace of each of which the lowest and the highest value are drawn."""

_TARGET_EVERY = 10
"""Samples of the target of the hand of which one is drawn."""

_ABOVE_DEEPEST = 1.3
"""Room of the chart of positions into the wall, per deepest position."""

_STABLE_TIMES = 1.5
"""Factor that the first spring and damper bear; that of the springs, from the wanted one down, which are tried."""

_MOST_SPRINGS = 40
"""Springs that are tried."""


class Extent(IntEnum):
    """How much of an answer a question is about; more holds all that less does, and takes longer."""

    PICTURES = 0
    """The charts that follow a slider at once."""
    ROWS = 1
    """The rows and verdicts too."""
    WHOLE = 2
    """What takes a second or more too: simulated touches and regions."""


@dataclass(frozen=True)
class PageAnswer:
    """What a column of the page shows."""

    gains: dict[str, Any]
    """Gains of one's own, by the names of their fields."""
    charts: list[dict[str, Any]]
    """Charts of one's own gains and of the method."""
    own: Judged | None = None
    """Verdict and rows of one's own gains; None where they are not in the question."""
    method: Judged | None = None
    """Those of a method that follows at once; None of a run."""


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
    problem: Problem, title: str, owner: str, lines: Sequence[Mapping[str, Any]], pairs: Mapping[tuple[str, str], Any]
) -> dict[str, Any]:
    """Return a chart of stiffness over damping of its owner, with pairs of both by name and class."""
    damping_unit, stiffness_unit = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    least = min(x for curve in lines for x in curve["x"])
    points = [
        {"name": name, "cls": cls, "x": max(damping, least), "y": stiffness}
        for (name, cls), (stiffness, damping) in pairs.items()
        if stiffness
    ]
    x, y = (f"{owner} damping, {damping_unit}", "log"), (f"{owner} stiffness, {stiffness_unit}", "log")
    return chart("region", title, x, y, lines, points=points)


def touches(runs: Mapping[str, Run], problem: Problem, begins: str, names: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return position and force of simulated touches over time, with all their peaks."""
    time = ("time, s", "linear")
    position: list[dict[str, Any]] = []
    force: list[dict[str, Any]] = []
    for cls, run in runs.items():
        inside = slice(0, run.samples_in_reach)
        rows = _peaks(run.force_n[inside], run.position_m[inside])
        name = f"{names[cls]}: {words.ENDINGS[run.claim]}{', buzzes' if run.buzzing else ''}"
        position.append(line(name, cls, run.time_s[inside][rows], 1e3 * run.position_m[inside][rows]))
        force.append(line(name, cls, run.time_s[inside][rows], run.force_n[inside][rows]))
    deepest = max((value for trace in position for value in trace["y"] if value is not None), default=0.0)
    if runs:
        first = next(iter(runs.values()))
        position.insert(
            0,
            line("target of the hand", "desired", first.time_s[::_TARGET_EVERY], 1e3 * first.target_m[::_TARGET_EVERY]),
        )
    units = problem.units
    positions = chart("position", f"Simulated touch: position ({begins})", time, (units.unit("mm"), "linear"), position)
    positions["y"]["span"] = [-deepest, _ABOVE_DEEPEST * deepest] if deepest > 0 else None
    forces = chart("force", f"Simulated touch: {units.key('force')}", time, (units.unit("N"), "linear"), force)
    return [positions, forces]


def _peaks(*traces: Any) -> Any:
    """Return the rows of each trace's lowest and highest value in some stretches."""
    rows = np.arange(len(traces[0]))
    stretches = np.array_split(rows, min(_STRETCHES, len(rows)))
    peaks = [
        stretch[extreme(trace[stretch])]
        for stretch in stretches
        for trace in traces
        for extreme in (np.argmin, np.argmax)
    ]
    return np.unique([*rows[[0, -1]], *peaks])


LAW = {"k": "stiffness_n_per_m", "b": "damping_ns_per_m", "b_p": "local_damping_ns_per_m", "cutoff_hz": "cutoff_hz"}
"""Names of a law in `certify` by those of its fields."""


def found_by_method(
    explorer: Explorer, settings: Settings, problem: Problem
) -> tuple[GainSchedule | None, Coupling | None]:
    """Return gains and coupling of the method; None where it has found none, or is not done."""
    if settings.method in explorer.form.live:
        gains = explorer.cached(f"solve {settings.key('method')}", lambda: solve(problem, settings.method))
        if not gains.usable.any():
            return gains, None
        key = f"coupling {settings.key('method', 'motion')}"
        return gains, explorer.cached(key, lambda: Coupling.from_schedule(problem, gains))
    coupling = explorer.coupling(settings)
    if coupling is None:
        return None, None
    hz, law = problem.frequencies_hz(), coupling.runtime.state_feedback
    solved = (Status.SOLVED,) * len(hz)
    gains = gain_schedule(problem, coupling.method, tuple(coupling.table(hz)), solved, state_feedback=law)
    return gains, replace(coupling, problem=problem, versions=explorer.versions)


@singledispatch
def headline_of(end: End, problem: Any) -> tuple[Part, ...]:  # noqa: ARG001
    """Return the problem in a line."""
    return subject.headline(problem, "")


@singledispatch
def file_of(end: End, problem: Any) -> str:  # noqa: ARG001
    """Return the text of the file of a problem."""
    return dump_problem(problem)


_NAMES = {"own": "your K and B", "method": "recommended"}


@singledispatch
def page_answer(end: End, explorer: Explorer, settings: Settings, problem: Any, extent: Extent) -> PageAnswer:
    """Return K and B of one's own to an end, next to the recommendation."""
    stated = settings.key()
    search = explorer.cached(f"search {stated}", lambda: search_of(end, problem))
    first = explorer.cached("first", lambda: _first(explorer.base, search))
    own_gains = ToolGains(**(vars(first) | _typed(explorer, settings)))
    coupling = explorer.coupling(settings)
    pairs = {"own": own_gains} | ({} if coupling is None else {"method": coupling.gains})
    felt = _rendered_charts(problem, pairs)
    if extent is Extent.PICTURES:
        return PageAnswer(vars(own_gains), felt)
    judged = explorer.cached(f"rows {stated} {own_gains}", lambda: _judged(end, problem, search, own_gains))
    before, after = _touched(end, explorer, settings, problem, pairs, extent)
    return PageAnswer(vars(own_gains), [*before, *felt, *after], judged)


@page_answer.register
def _wall_answer(
    end: Wall,  # noqa: ARG001
    explorer: Explorer,
    settings: Settings,
    problem: Problem,
    extent: Extent,
) -> PageAnswer:
    """Return the law of one's own before a wall, next to the coupling of the method."""
    if problem.law is not None:
        return _law_answer(problem.law, explorer, settings, problem, extent)
    stated, name = settings.key(), _method_name(settings)
    schedule, coupling = found_by_method(explorer, settings, problem)
    # The search of a first law takes seconds on some devices: the first pictures do not wait for it.
    waits = extent is not Extent.PICTURES
    first = explorer.cached("first", lambda: first_law(explorer.base)) if waits else explorer.known("first")
    if first is None:
        return PageAnswer({}, _impedances(problem, None, schedule, name))
    law = vars(first) | gains_of(settings, explorer.form)
    given = {gain: law[key] for gain, key in LAW.items() if law.get(key) is not None}
    wall = {
        "stiffness_n_per_m": law["stiffness_n_per_m"] or 0.0,
        "damping_ns_per_m": (law["damping_ns_per_m"] or 0.0) + (law.get("local_damping_ns_per_m") or 0.0),
    }
    direct = problem.changed(environment=wall, boundaries={"upper": wall, "lower": wall})
    charts = _impedances(problem, direct, schedule, name)
    if extent is Extent.PICTURES:
        return PageAnswer(law, charts)
    # The verdict follows a slider; which k and b are stable takes several times as long.
    limits = extent is Extent.WHOLE
    certificate = explorer.cached(
        f"law {limits} {stated} {given}", lambda: certify_law(problem, **given, remedies=False, limits=limits)
    )
    judged = Judged(of_law(certificate), [shown for shown in own_law(certificate).rows if shown.rank == 0])
    method = None
    if schedule is not None and settings.method in explorer.form.live:
        method = _method_judged(schedule, coupling, extent)
    if extent is Extent.WHOLE:
        runs = {}
        if "cutoff_hz" not in given and wall["stiffness_n_per_m"]:
            key = f"touch {stated} {settings.motion} {wall}"
            runs["own"] = explorer.cached(key, lambda: simulate(direct, NO_COUPLING))
        if coupling is not None:
            key = f"touch {settings.key('method', 'motion')}"
            runs["method"] = explorer.cached(key, lambda: simulate(problem, coupling.for_problem(problem)))
        names = {"own": "your k and b", "method": name}
        charts += touches(runs, problem, "wall at 0", names)
        charts.append(_region(explorer, problem, stated, wall))
    return PageAnswer(law, charts, judged, method)


def _method_judged(schedule: GainSchedule, coupling: Coupling | None, extent: Extent) -> Judged:
    """Return how many gains a method finds; in a whole answer the verdict on its coupling too."""
    gains = row("Gains", subject.counts(schedule.counts()))
    if extent is not Extent.WHOLE:
        return Judged(None, [gains])
    verdict = None if coupling is None else deployable(coupling)
    return Judged(of_coupling(verdict), [subject.deployable(verdict), gains])


def _law_answer(
    law: ControlLaw, explorer: Explorer, settings: Settings, problem: Problem, extent: Extent
) -> PageAnswer:
    """Return a table [law]: its force over position; by extent its verdict and rows too, and a simulated touch."""
    tables = problem_document(problem)
    gains = {field.key: field.value(tables) for field in explorer.form.gains}
    charts = [_force_over_position(law, problem)]
    if extent is Extent.PICTURES:
        return PageAnswer(gains, charts)
    stated = settings.key("gains")
    with_limits = extent is Extent.WHOLE
    judged = explorer.cached(f"law {with_limits} {stated}", lambda: _law_judged(problem, limits=with_limits))
    if extent is Extent.WHOLE:
        run = explorer.cached(f"touch {stated} {settings.motion}", lambda: simulate(problem))
        charts += touches({"own": run}, problem, "wall at 0" if problem.law_in_wall else "about 0", {"own": "your law"})
    return PageAnswer(gains, charts, judged)


def _law_judged(problem: Problem, *, limits: bool) -> Judged:
    """Return the verdict on a table [law] with its rows, on request with limits; of what is not judged, why."""
    try:
        certificate = certify_law(problem, remedies=False, limits=limits)
    except UnsupportedError as error:
        return Judged(Verdict(Mark.CAUTION, "not judged"), [row("Not judged", str(error), mark=Mark.CAUTION)])
    return Judged(of_law(certificate), [shown for shown in own_law(certificate).rows if shown.rank == 0])


_LEAST_HZ = 0.1
_MOST_SHARE = 0.499
"""Frequencies of the chart of a law: the least, and the most as a share of its rate."""


def _force_over_position(law: ControlLaw, problem: Problem) -> dict[str, Any]:
    """Return the chart of the force over the position of a law, nonlinear pieces at their steepest."""
    sample_time_s = problem.device.sample_time_s
    period_s = law.period_s(sample_time_s)
    hz = np.geomspace(min(_LEAST_HZ, 0.1 * _MOST_SHARE / period_s), _MOST_SHARE / period_s, _STRETCHES)
    z = np.exp(2j * np.pi * hz * period_s)
    acting = {"in the wall" if problem.law_in_wall else "everywhere": law.law(sample_time_s)}
    if problem.law_in_wall and law.acts_outside:
        acting["outside the wall"] = law.outside(sample_time_s)
    classes = ("own", "without")
    lines = [
        line(name, cls, hz, np.abs(stated.transfer(z)))
        for (name, stated), cls in zip(acting.items(), classes, strict=False)
    ]
    stiffness = (problem.units.unit("N/m"), "log")
    return chart("law", f"{problem.units.key('force').capitalize()} over position of your law", _HZ, stiffness, lines)


def _method_name(settings: Settings) -> str:
    """Return what the coupling of the method is called on the page."""
    return "recommended" if settings.method == "recommend" else settings.method


def _impedances(
    problem: Problem, direct: Problem | None, schedule: GainSchedule | None, name: str
) -> list[dict[str, Any]]:
    """Return charts of magnitude and real part of the impedance, and of gains that follow the frequency."""
    hz = problem.frequencies_hz()
    loop = loop_at(problem, hz)
    upper, lower = perceived_bounds(problem, loop)
    without = np.asarray(loop.without_coupling)
    curves = [("no coupling", "without", without)]
    if direct is not None:
        curves.append(("your k and b", "own", np.asarray(loop_at(direct, hz).without_coupling)))
    if schedule is not None:
        curves.append((name, "method", np.where(schedule.usable, schedule.impedance, np.nan)))
    impedance_unit = problem.units.unit("N.s/m")
    sizes = [line("desired", "desired", hz, np.abs(loop.target))]
    sizes += [line(label, cls, hz, np.abs(impedance)) for label, cls, impedance in curves]
    ends = {"low": six_digits(np.abs(lower)), "high": six_digits(np.abs(upper))}
    band = {"name": "feels real", "cls": "real", "x": six_digits(hz), **ends}
    real_parts = [line(label, cls, hz, impedance.real) for label, cls, impedance in curves]
    magnitude_title = "Impedance |Z| that the hand meets"
    real_title = "Real part of Z: below 0 the loop gives out energy"
    charts = [
        chart("magnitude", magnitude_title, _HZ, (impedance_unit, "log"), sizes, bands=[band]),
        chart("real", real_title, _HZ, (impedance_unit, "symlog"), real_parts),
    ]
    if schedule is not None and len(np.unique(schedule.stiffness_n_per_m)) > 1:
        damper = line(name, "method", hz, schedule.damping_ns_per_m)
        spring = line(name, "method", hz, schedule.stiffness_n_per_m)
        stiffness_unit = problem.units.unit("N/m")
        charts += [
            chart("damping", "Damper b of the coupling", _HZ, (impedance_unit, "symlog"), [damper]),
            chart("stiffness", "Spring k of the coupling", _HZ, (stiffness_unit, "symlog"), [spring]),
        ]
    return charts


def _region(explorer: Explorer, problem: Problem, stated: str, law: Mapping[str, float]) -> dict[str, Any]:
    """Return the chart of the walls that the device renders without coupling, with the wanted wall and your k and b."""
    walls, wall = explorer.cached(f"region {stated}", lambda: zwidth(problem)), problem.environment
    damping = walls.damping_ns_per_m[1:]
    lines = [line(str(curve.claim), curve.key, damping, curve.stiffness_n_per_m[1:]) for curve in walls.curves]
    pairs = {
        ("wanted wall", "desired"): (wall.stiffness_n_per_m, wall.damping_ns_per_m),
        ("your k and b", "own"): (law["stiffness_n_per_m"], law["damping_ns_per_m"]),
    }
    title = "Walls that the device renders without coupling: below each curve"
    return region(problem, title, "wall", lines, pairs)


@singledispatch
def saved_coupling(end: End, explorer: Explorer, settings: Settings, problem: Any) -> tuple[Coupling, str]:
    """Return the coupling to an end to save, and what is said of it: one's own K and B where they were typed."""
    recommended = None if settings.gains else explorer.coupling(settings)
    if recommended is not None:
        return replace(recommended, versions=explorer.versions), "the recommended coupling"
    return _own_coupling(end, explorer, settings, problem)


@saved_coupling.register
def _saved_wall_coupling(
    end: Wall,  # noqa: ARG001
    explorer: Explorer,
    settings: Settings,
    problem: Problem,
) -> tuple[Coupling, str]:
    """Return the coupling of the chosen method with its certificate, to be saved, and its verdict in words."""
    _, coupling = found_by_method(explorer, settings, problem)
    if coupling is None:
        raise InputError.of("no coupling yet: there is nothing to save", key="method")
    verdict = deployable(coupling)
    levels = coupling.certificate
    certificate = levels.certificate if isinstance(levels, DeployedCertificate) else certify(problem, coupling)
    return coupling.with_certificate(DeployedCertificate(certificate, verdict)), verdict.sentence


Charts = list[dict[str, Any]]


@singledispatch
def _touched(
    end: End,  # noqa: ARG001
    explorer: Explorer,  # noqa: ARG001
    settings: Settings,  # noqa: ARG001
    problem: Problem,  # noqa: ARG001
    pairs: dict[str, ToolGains],  # noqa: ARG001
    extent: Extent,  # noqa: ARG001
) -> tuple[Charts, Charts]:
    """Return charts before and after those of what is felt: of a kind of end that no scene has there are none."""
    return [], []


@_touched.register
def _touched_with_tool(
    end: Simulation,  # noqa: ARG001
    explorer: Explorer,
    settings: Settings,
    problem: Problem,
    pairs: dict[str, ToolGains],
    extent: Extent,
) -> tuple[Charts, Charts]:
    """Return the charts of a coupling to a tool: its region of stable K and B before, what it renders behind."""
    whole = extent is Extent.WHOLE
    stated, rates = settings.key(), dict[str, Any]() if whole else {"rates": ()}
    stable = explorer.cached(f"region {whole} {stated}", lambda: tool_region(problem, summits=False, **rates))
    before = [_pairs_region(problem, stable, pairs)]
    if not whole:
        return before, []
    runs = {}
    for cls, gains in pairs.items():
        key = f"touch {stated} {settings.motion} {gains}"
        runs[cls] = explorer.cached(key, partial(simulate, with_gains(problem, gains)))
    return before, touches(runs, problem, "contact at 0", _NAMES)


def _typed(explorer: Explorer, settings: Settings) -> dict[str, float]:
    return {key: value or 0.0 for key, value in gains_of(settings, explorer.form).items()}


def _first(problem: Problem, search: EndSearch) -> ToolGains:
    """Return the stiffest of some springs and dampers that all loops bear 1.5 times; the softest where none is."""
    device, local = problem.device, search.damped_locally
    mass = device.mass_kg
    stiffest = search.wanted_n_per_m or mass / device.sample_time_s**2
    for stiffness in stiffest / _STABLE_TIMES ** np.arange(_MOST_SPRINGS):
        critical = 2 * math.sqrt(stiffness * mass)
        for ratio in (1.0, 0.5, 0.25):
            pair = ToolGains(
                stiffness_n_per_m=_two_digits(stiffness),
                damping_ns_per_m=_two_digits(ratio * critical),
                local_damping_ns_per_m=_two_digits(critical if local else 0.0),
            )
            if search.loops.stable(pair.times(_STABLE_TIMES)):
                return pair
    return pair


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


@singledispatch
def _judged(end: End, problem: Problem, search: EndSearch, gains: ToolGains) -> Judged:  # noqa: ARG001
    """Return verdict and rows of K and B of one's own to an end."""
    stable = search.loops.stable_over_ranges(gains)
    which = "extreme hands, released, clamped:" if stable else "not all of"
    stability_row = row("Stability", f"{which} {search.loop_count} loops", mark=grade(stable))
    coupling = row("Coupling", subject.pair_of(gains))
    return Judged(of_stability(stable), [coupling, stability_row, *_rendered_rows(problem, gains)])


@_judged.register
def _judged_with_tool(end: Simulation, problem: Problem, search: EndSearch, gains: ToolGains) -> Judged:
    coupling, felt = row("Coupling", subject.pair_of(gains)), _rendered_rows(problem, gains)
    certificate = certify_pair(problem, gains, search)
    rows = [coupling, *stability(end, certificate), *felt, *passivity(end, certificate.passivity)]
    return Judged(of_pair(certificate), rows)


def _rendered_rows(problem: Problem, gains: ToolGains) -> list[Row]:
    return rendered_rows(RenderedPair(None, None, rendered_pair(problem, gains)))


def _rendered_charts(problem: Problem, pairs: dict[str, ToolGains]) -> list[dict[str, Any]]:
    """Return charts of stiffness at the handle in contact, and of mass and drag in free motion, over frequency."""
    impedance_unit, stiffness_unit = problem.units.unit("N.s/m"), problem.units.unit("N/m")
    free: list[dict[str, Any]] = []
    rigid: list[dict[str, Any]] = []
    for cls, gains in pairs.items():
        band, body_kg, body_ns_per_m = rendered_band(problem, gains)
        hz = np.array([point.frequency_hz for point in band])
        rigid.append(line(_NAMES[cls], cls, hz, np.array([point.stiffness_n_per_m for point in band])))
        if band[0].mass_kg is not None:
            drag = np.array([point.drag_ns_per_m for point in band])
            mass = np.array([point.mass_kg for point in band])
            omega = 2 * np.pi * hz
            if not free:
                name = "device and other end as one body"
                free.append(line(name, "desired", hz, np.hypot(body_ns_per_m, omega * body_kg)))
            free.append(line(_NAMES[cls], cls, hz, np.hypot(drag, omega * mass)))
    charts = [chart("free", "Impedance |Z| in free motion", _HZ, (impedance_unit, "log"), free)] if free else []
    return [*charts, chart("rigid", "Stiffness on a rigid object", _HZ, (stiffness_unit, "log"), rigid)]


def _pairs_region(problem: Problem, stable: ToolRegion, pairs: dict[str, ToolGains]) -> dict[str, Any]:
    """Return the chart of stable K against B, a curve for each rate of the engine, with the couplings as marks."""
    damping, lines = stable.damping_ns_per_m[1:], []
    for curve in stable.curves:
        name = f"{quantity(1 / curve.step_s, 'Hz')}{', as declared' if curve.declared else ''}"
        stiffness = np.where(curve.stiffness_n_per_m[1:] > 0, curve.stiffness_n_per_m[1:], np.nan)
        lines.append(line(name, "stable-hands" if curve.declared else "without", damping, stiffness))
    marks = {(_NAMES[cls], cls): (gains.stiffness_n_per_m, gains.damping_ns_per_m) for cls, gains in pairs.items()}
    title = "Springs and dampers stable with every hand: below each curve"
    return region(problem, title, "coupling's", lines, marks)


@singledispatch
def _own_coupling(
    end: End,  # noqa: ARG001
    explorer: Explorer,  # noqa: ARG001
    settings: Settings,  # noqa: ARG001
    problem: Problem,  # noqa: ARG001
) -> tuple[Coupling, str]:
    """Return the coupling of one's own K and B, and what is said of it; of most ends there is none without a trial."""
    raise InputError.of("no coupling yet: there is nothing to save", key="method")


@_own_coupling.register
def _own_tool_coupling(
    end: Simulation, explorer: Explorer, settings: Settings, problem: Problem
) -> tuple[Coupling, str]:
    """Return the coupling of your own K and B with its certificate, to be saved, and its verdict in words."""
    if not settings.gains:
        raise InputError.of("no coupling yet: there is nothing to save", key="method")
    search = explorer.cached(f"search {settings.key()}", lambda: search_of(end, problem))
    gains = ToolGains(**({"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0} | _typed(explorer, settings)))
    certificate = certify_pair(problem, gains, search)
    verdict = f"your K and B, {'stable' if certificate.stable else 'not stable'}, not tried with hands"
    return Coupling.to_end(problem, gains, certificate, None, explorer.versions), verdict
