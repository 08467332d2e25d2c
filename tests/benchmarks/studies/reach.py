"""How stiff a wall everybody can touch: many people, every motion, and how real the wall feels to them."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import asdict, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.parallel import mapped
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.effects import ObserverEffect
from avc_casadi.model.gains import Gains, gains_at
from avc_casadi.simulation.judge import Judgement
from avc_casadi.simulation.population.motions import motions_at
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.population.trial import Conditions, judged
from studies.error_curve import TOLERANCE, error_curve

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Impedance, Problem
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.simulation.population.operators import Population

# DC stiffness that counts as the wall's.
STIFFNESS_TOLERANCE = 0.08
# People whom a worker is given at a time.
_AT_ONCE = 1000


def reach(
    problem: Problem,
    gains: Gains | GainSchedule,
    subjects: Hand | StylusHand,
    conditions: Conditions,
    wall: Impedance | None = None,
    *,
    population: Population = "A",
    executor: Executor | None = None,
    workers: int = 1,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Try everybody in every motion.

    Args:
        problem: device and the wall that is rendered.
        gains: the coupling.
        subjects: the people.
        conditions: what of the device is simulated.
        wall: the wall that should be felt; None is the one that is rendered.
        population: the one from which the people come.
        executor: who lets some at a time try it, as for `mapped`.
        workers: processes, where there is no executor.
        progress: told of the people.

    Returns:
        Counts with exact intervals, the stiffness that was felt, and the frequencies up to which the complex error
        stays within 10 % (JSON values).
    """
    some = [subjects.pick(slice(first, first + _AT_ONCE)) for first in range(0, len(subjects), _AT_ONCE)]
    sizes = [len(people) for people in some]
    work = partial(_judged, problem, gains, conditions)
    runs = _joined(mapped(work, some, executor, workers=workers, sizes=sizes, things="people", progress=progress))
    whole = np.all([run.stable for run in runs.values()], axis=0)
    interval = exact_interval(int(whole.sum()), len(whole))
    ratio = runs["press"].apparent_stiffness_n_per_m / (wall or problem.environment).stiffness_n_per_m
    felt = ratio[np.isfinite(ratio)]
    curve = error_curve(problem, gains, wall=wall)
    stiff = np.abs(ratio - 1) <= STIFFNESS_TOLERANCE
    first = gains if isinstance(gains, Gains) else gains_at(gains)
    return {
        "people": len(whole),
        "population": population,
        "conditions": {
            name: value
            for name, value in asdict(conditions).items()
            if name not in {"runtime", "others", "state_feedback"}
        },
        "stable": int(whole.sum()),
        "stable_low": interval[0],
        "stable_high": interval[1],
        "stable_by_motion": {name: int(run.stable.sum()) for name, run in runs.items()},
        "buzzing": int(np.any([run.buzzing for run in runs.values()], axis=0).sum()),
        "peak_velocity_m_per_s": float(np.max([run.peak_velocity_m_per_s for run in runs.values()])),
        "stiffness_share": {
            "lowest": float(felt.min()) if len(felt) else None,
            "median": float(np.median(felt)) if len(felt) else None,
            "highest": float(felt.max()) if len(felt) else None,
            "within_8_percent": int(stiff.sum()),
        },
        "gains_at_rest": {key: value if math.isfinite(value) else None for key, value in vars(first).items()},
        "error_within_hz": {
            "tolerance": TOLERANCE,
            "sampled": curve.within_hz(curve.sampled),
            "physical": curve.within_hz(curve.physical),
        },
        "error_at_hz": {
            name: {f"{hz:g}": curve.at(errors, hz) for hz in (1.0, 10.0, 20.0, 50.0)}
            for name, errors in (("sampled", curve.sampled), ("physical", curve.physical))
        },
    }


def _judged(
    problem: Problem, gains: Gains | GainSchedule, conditions: Conditions, people: Hand | StylusHand
) -> dict[str, Judgement]:
    motions = motions_at(problem.device)
    return {name: judged(problem, gains, people, motion, conditions) for name, motion in motions.items()}


def _joined(parts: list[dict[str, Judgement]]) -> dict[str, Judgement]:
    """Return the judgement of all people, in the order of the parts."""

    def whole(motion: str, figure: str) -> Any:
        return np.concatenate([getattr(part[motion], figure) for part in parts])

    figures = [item.name for item in fields(Judgement)]
    return {motion: Judgement(**{figure: whole(motion, figure) for figure in figures}) for motion in parts[0]}


def with_observer(problem: Problem, conditions: Conditions) -> Conditions:
    """Put the observer behind the encoder; it reckons with the lightest hand, so that it never lags."""
    return replace(conditions, observer=ObserverEffect(mass_kg=problem.device.mass_kg + problem.hands.mass_kg[0]))
