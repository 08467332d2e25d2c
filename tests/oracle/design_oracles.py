"""Random problems for the designs over many gains at once, and what brute force finds in them."""

from __future__ import annotations

from typing import Any

import numpy as np

from avc_casadi.claims.passivity.llewellyn import llewellyn_margin
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.claims.scope import scope_slack
from avc_casadi.design.schedule.states import States
from avc_casadi.files.problem_file import load_problem
from avc_casadi.loops.sampled_loop import SampledLoop
from avc_casadi.model.corners import device_corners, least_damped
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import relative_errors


def drawn_device_problem(
    rng: np.random.Generator, *, structure: str, scope: str, rows: int, require: str = "none"
) -> Problem:
    """Draw a device that somebody might have, before a soft or a stiff wall, with hands about it."""

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def interval(low: float, high: float) -> tuple[float, float]:
        ends = sorted((between(low, high), between(low, high)))
        return ends[0], ends[1]

    sample_time = float(rng.choice([2.5e-4, 5e-4, 1e-3, 1e-3, 2e-3]))
    wall = {"damping_ns_per_m": float(rng.choice([0.0, between(0.3, 30)])), "stiffness_n_per_m": between(1e3, 3e5)}
    upper = {key: float(value * rng.uniform(1.0, 1.3)) for key, value in wall.items()}
    lower = {key: float(value * rng.uniform(0.5, 0.95)) for key, value in wall.items()}
    tables: dict[str, dict[str, Any]] = {
        "device": {
            "mass_kg": between(0.02, 1.0),
            "damping_ns_per_m": between(0.3, 20.0),
            "sample_time_s": sample_time,
            "delay_samples": float(rng.choice([0, 0, 0, 1, 2, 4])),
        },
        "environment": wall,
        "boundaries": {"upper": upper, "lower": lower},
        "coupling": {
            "structure": structure,
            "damping_ns_per_m": (0.0, 1e4) if rng.random() < 0.7 else interval(0.1, 1e4),
            "stiffness_n_per_m": (0.0, 1e7) if rng.random() < 0.7 else interval(10.0, 1e7),
            "contact_damping_ns_per_m": (0.0, between(5, 300)) if structure == "damped" else (0.0, 0.0),
        },
        "stability": {
            "model": str(rng.choice(["paper", "sampled-data"])),
            "scope": scope,
            "margin_ns_per_m": 0.0 if rng.random() < 0.8 else between(0.05, 1.0),
        },
        "realism": {"require": require},
        "hands": {
            "mass_kg": interval(0.02, 0.5),
            "damping_ns_per_m": interval(1.0, 30.0),
            "stiffness_n_per_m": interval(50.0, 2e3),
        },
        "frequency": {"start_hz": between(0.3, 5.0), "stop_hz": between(0.1, 0.49) / sample_time, "points": rows},
    }
    if rng.random() < 0.2:
        damping = tables["device"]["damping_ns_per_m"]
        tables["device"]["range"] = {"damping_ns_per_m": (float(damping * rng.uniform(0.5, 1.0)), damping)}
    return load_problem("figure5").changed(**tables)


def drawn_gains(
    rng: np.random.Generator, problem: Problem, count: int, near: np.ndarray | None = None
) -> tuple[np.ndarray, ...]:
    """Draw b, k and b_p from the gain box: by decades, some on an end of it, and half of them about given gains."""
    box, drawn = problem.coupling, []
    for place, (low, high) in enumerate((box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m)):
        floor = max(low, 1e-7 * high, 1e-12)
        values = np.exp(rng.uniform(np.log(floor), np.log(max(high, floor)), count))
        if near is not None:
            about = near[place] * np.exp(rng.standard_normal(count) * 10 ** rng.uniform(-4, 0, count))
            values = np.where(np.arange(count) % 2 == 0, about, values)
        chance = rng.random(count)
        drawn.append(np.clip(np.where(chance < 0.1, low, np.where(chance > 0.95, high, values)), low, high))
    return tuple(drawn)


def least_error_of_constants(
    problem: Problem, condition: str, gains: tuple[np.ndarray, ...], below: float, most: int = 3000
) -> float:
    """Return the least root mean squared error of drawn constant gains that meet a condition of `static`, or ``below``.

    The gains of least error are judged first, up to ``most``: those that follow could not be the best.
    """
    loop = loop_at(problem, problem.frequencies_hz())
    goal, chosen = problem.realism, (gain[:, None] for gain in gains)
    errors = relative_errors(loop.perceived(*chosen), loop.target[None], goal.objective, goal.jnd)
    error = np.sqrt(np.mean(errors**2, axis=1))
    order = np.argsort(error)
    order = order[error[order] < below][:most]
    sampled = SampledLoop.of(least_damped(problem))
    for some in np.array_split(order, max(1, len(order) // 200)):
        tried = tuple(gain[some] for gain in gains)
        if condition == "llewellyn":
            margin = llewellyn_margin(sampled, *tried)[0]
        else:
            margin = worst_margin(sampled, *tried).margin_ns_per_m
        met = margin >= problem.stability.margin_ns_per_m
        if met.any():
            return float(error[some[met]][0])
    return below


def lattice_schedule_cost(problem: Problem, points: tuple[int, ...]) -> float:
    """Return the cost of the best schedule among all paths of a lattice, by an exact dynamic programme.

    Infinite where no path meets the scope at every row.
    """
    frequency = problem.frequencies_hz()
    loop, goal = loop_at(problem, frequency), problem.realism
    states = States.of(problem, loop)
    axes = [np.linspace(low, high, n) for low, high, n in zip(states.low, states.high, points, strict=True)]
    nodes = np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
    gains = states.gains(nodes)
    x = np.log(frequency)
    step, span = np.diff(x), x[-1] - x[0]
    weight = np.convolve(step, [0.5, 0.5])
    weight /= weight.sum()
    everywhere = None
    if problem.stability.scope in {"hands", "all"}:
        everywhere = _met_at_corners(problem, float(frequency[0]), gains)
    value = np.zeros(points)
    for row in range(len(frequency)):
        here = loop_at(problem, frequency[row : row + 1])
        target = here.target[0]
        error = relative_errors(here.perceived(*gains), target, goal.objective, goal.jnd)
        cost = error**2 + problem.schedule.contact_damping_penalty * (gains[2] / abs(target)) ** 2
        met = _met_at_corners(problem, float(frequency[row]), gains) if everywhere is None else everywhere
        if row:
            for dimension, axis in enumerate(axes):
                value = _moved(value, axis, dimension, problem.schedule.slope_penalty / span / step[row - 1])
        value = value + np.where(met, weight[row] * cost, np.inf).reshape(points)
    return float(value.min())


def _met_at_corners(problem: Problem, frequency_hz: float, gains: tuple[np.ndarray, ...]) -> np.ndarray:
    corner = least_damped(problem, problem.schedule.hand_damping_ns_per_m)
    if problem.stability.scope in {"pointwise", "band"}:
        # Of a band the ends decide in the sampled-data model without delay, in which bands are drawn.
        factor, nyquist = problem.stability.band_factor, 0.5 / problem.device.sample_time_s
        ends = {"pointwise": [frequency_hz], "band": [frequency_hz / factor, min(frequency_hz * factor, nyquist)]}
        at = np.minimum(ends[problem.stability.scope], (1 - 1e-9) * nyquist)
        real = [loop_at(corner, np.array([end])).perceived(*gains).real for end in at]
        return np.asarray(np.min(real, axis=0) >= problem.stability.margin_ns_per_m)
    corners = [corner]
    if problem.stability.scope == "hands":
        devices = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
        corners = [problem.changed(device=device) for device in devices]
    return np.logical_and.reduce([scope_slack(each, frequency_hz, *gains).met for each in corners])


def _moved(value: np.ndarray, axis: np.ndarray, dimension: int, penalty: float) -> np.ndarray:
    """Least value over where one state came from."""
    lines = np.moveaxis(value, dimension, 0)
    best = np.full(lines.shape, np.inf)
    trailing = (1,) * (lines.ndim - 1)
    for at, line in zip(axis, lines, strict=True):
        np.minimum(best, line[None] + (penalty * (axis - at) ** 2).reshape(-1, *trailing), out=best)
    return np.moveaxis(best, 0, dimension)


def drawn_schedule_problem(rng: np.random.Generator, structure: str, number: int) -> Problem:
    """Draw a problem of twenty rows for `schedule`, its scope by its number, its goal and smoothness at random."""
    scope = ("pointwise", "band", "hands")[number % 3]
    problem = drawn_device_problem(rng, structure=structure, scope=scope, rows=20)
    if scope == "band":
        problem = problem.changed(stability={"model": "sampled-data"}, device={"delay_samples": 0})
    return problem.changed(
        schedule={"slope_penalty": float(rng.choice([1e-4, 1e-3, 1e-2]))},
        realism={"objective": str(rng.choice(["magnitude", "complex"]))},
    )


def schedule_cost(problem: Problem, gains: GainSchedule) -> float:
    """Return what a schedule costs, written out anew; infinite where a row has no gains."""
    if not gains.usable.all():
        return np.inf
    loop, goal = loop_at(problem, gains.frequency_hz), problem.realism
    sigma = States.of(problem, loop).states(tuple(gain_rows(gains)))
    step = np.diff(np.log(gains.frequency_hz))
    weight = np.convolve(step, [0.5, 0.5])
    error = relative_errors(gains.impedance, loop.target, goal.objective, goal.jnd)
    contact = problem.schedule.contact_damping_penalty * (gains.contact_damping_ns_per_m / np.abs(loop.target)) ** 2
    rough = problem.schedule.slope_penalty * (np.diff(sigma, axis=1) ** 2 / step).sum()
    return float((weight / weight.sum()) @ (error**2 + contact) + rough / step.sum())


def gain_rows(gains: GainSchedule) -> np.ndarray:
    """B, k and b_p, (3, n)."""
    return np.array([gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m])
