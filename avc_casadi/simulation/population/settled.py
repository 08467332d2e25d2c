"""How many of any number of hands settle with a coupling: blocks that each draw their own hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.parallel import mapped
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.simulation.population.motions import MOTIONS, course_of
from avc_casadi.simulation.population.operators import BLOCK, draw_hands
from avc_casadi.simulation.population.trial import Conditions, Ends, on_device, resting

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect
    from avc_casadi.model.hands import Hand, StylusHand


CONFIDENCE = 0.95


def exact_interval(count: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Clopper and Pearson's interval of a probability, of at least the stated confidence."""
    if not 0 <= count <= trials or trials < 1:
        raise ValueError(f"{count} of {trials} is no count of trials")
    from scipy.special import betaincinv  # noqa: PLC0415 - statistics load slowly, and most calls need none

    beyond = (1 - confidence) / 2
    low = 0.0 if count == 0 else float(betaincinv(count, trials - count + 1, beyond))
    high = 1.0 if count == trials else float(betaincinv(count + 1, trials - count, 1 - beyond))
    return low, high


# Unsettled hands whose indices are reported.
_NAMED = 20


@dataclass(frozen=True)
class SettledHands:
    """Counts of settled hands."""

    coupling: str
    hands: int
    seed: int
    friction: bool
    at_rest: int
    by_motion: dict[str, int]
    moving: tuple[int, ...]
    effects: tuple[str, ...]

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the exact binomial interval of the settled share."""
        return exact_interval(self.at_rest, self.hands)

    def document(self) -> dict[str, Any]:
        """Return the document of `avc trial`: JSON values."""
        return {
            **vars(self),
            "moving": list(self.moving),
            "effects": list(self.effects),
            "at_rest_interval": list(self.interval),
            "confidence": CONFIDENCE,
        }


def settled_hands(
    coupling: Coupling,
    hands: int,
    seed: int = 0,
    *,
    friction: bool = True,
    block: int = BLOCK,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress = SILENT,
) -> SettledHands:
    """Count press, tap and hold by many hands, drawn uniformly from the problem's set."""
    if hands < 1 or block < 1:
        raise InputError.of(f"is {min(hands, block)}; allowed: 1 or more", key="hands" if hands < 1 else "block")
    conditions = Conditions.of(coupling)
    conditions = conditions if friction else conditions.without_friction()
    tasks = [(first, min(block, hands - first)) for first in range(0, hands, block)]
    # Certificate and trial do not run and would only slow the transfer to a worker.
    work = partial(_tried, replace(coupling, certificate=None, trial=None), conditions, seed)
    sizes = [count for _, count in tasks]
    parts = mapped(work, tasks, executor, workers=workers, sizes=sizes, things="hands", progress=progress)
    return SettledHands(
        coupling=coupling.method,
        hands=hands,
        seed=seed,
        friction=friction,
        at_rest=sum(part["at_rest"] for part in parts),
        by_motion={name: sum(part["by_motion"][name] for part in parts) for name in MOTIONS},
        moving=tuple(number for part in parts for number in part["moving"])[:_NAMED],
        effects=tuple(effect.kind for effect in conditions.effects()),
    )


def residual_speeds(
    couplings: Sequence[Coupling],
    people: Hand | StylusHand,
    *,
    friction: bool = True,
    beyond: bool = False,
    device: Device | None = None,
    effects: tuple[Effect, ...] = (),
) -> FloatArray:
    """Return the largest residual speed of each hand over all motions, with constant gains.

    Consecutive couplings that differ only in the numbers of their state feedback share a scene, run once.
    """
    found = [np.zeros((0, len(people)))]
    for _, group in groupby(couplings, _but_for_numbers):
        alike = list(group)
        ends = prepared_residual_speeds(
            alike[0], people, friction=friction, beyond=beyond, device=device, effects=effects
        )
        found.append(ends([one.runtime.state_feedback for one in alike]))
    return np.concatenate(found)


def prepared_residual_speeds(
    coupling: Coupling,
    people: Hand | StylusHand,
    *,
    friction: bool = True,
    beyond: bool = False,
    device: Device | None = None,
    effects: tuple[Effect, ...] = (),
    racing: bool = False,
) -> Ends:
    """Prepare `unrest` for couplings that differ from this one only in the numbers of their state feedback."""
    coupling, conditions = on_device(coupling, device, effects)
    gains, course = coupling.table.at_rest, course_of(coupling.problem)
    whole = conditions if friction else conditions.without_friction()
    # Hands that fail to settle mostly do so after a tap.
    told = sorted(course.motions, key=lambda name: name != "tap")
    motions = [(course.motions[name], whole) for name in told]
    if beyond:
        motions += [*((motion, whole) for motion in course.beyond), (course.lightest, conditions)]
    return Ends(coupling.problem, gains, people, motions, racing=racing)


def _but_for_numbers(coupling: Coupling) -> tuple[Any, ...]:
    """Return the key that groups couplings of a common scene."""
    law = coupling.runtime.state_feedback
    structure = None if law is None else (law.states, law.positions, law.measures)
    return id(coupling.problem), coupling.table.at_rest, replace(coupling.runtime, state_feedback=None), structure


def _by_motion(coupling: Coupling, conditions: Conditions, people: Hand) -> dict[str, BoolArray]:
    chosen = coupling.table.at_rest if coupling.table.constant else coupling.table
    course = course_of(coupling.problem)
    return {
        name: resting(coupling.problem, chosen, people, motion, conditions) for name, motion in course.motions.items()
    }


def _tried(coupling: Coupling, conditions: Conditions, seed: int, task: tuple[int, int]) -> dict[str, Any]:
    """Simulate a block of the draw, from a first index on."""
    first, count = task
    rest = _by_motion(coupling, conditions, draw_hands(coupling.problem.hands, count, seed, first=first))
    whole = np.all(list(rest.values()), axis=0)
    return {
        "at_rest": int(whole.sum()),
        "by_motion": {name: int(found.sum()) for name, found in rest.items()},
        "moving": (first + np.flatnonzero(~whole)[:_NAMED]).tolist(),
    }
