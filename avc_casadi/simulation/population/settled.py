"""Any number of hands with a coupling, at rest or not: a study in chunks, people drawn where they are tried."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.checkpoint import Chunked
from avc_casadi._util.json_values import json_text
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.simulation.population.motions import MOTIONS, course_of
from avc_casadi.simulation.population.operators import BLOCK, draw_hands
from avc_casadi.simulation.population.trial import Conditions, Ends, on_device, resting

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect
    from avc_casadi.model.hands import Hand, StylusHand


CONFIDENCE = 0.95


def exact_interval(count: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Clopper and Pearson's interval of a probability, which holds with at least the stated confidence.

    Args:
        count: successes.
        trials: trials, 1 or more.
        confidence: two-sided confidence, between 0 and 1.

    Returns:
        Its ends: each leaves half of the rest beyond it; 0 and 1 where there is no success or no failure.
    """
    if not 0 <= count <= trials or trials < 1:
        raise ValueError(f"{count} of {trials} is no count of trials")
    from scipy.special import betaincinv  # noqa: PLC0415 - statistics load slowly, and most calls need none

    beyond = (1 - confidence) / 2
    low = 0.0 if count == 0 else float(betaincinv(count, trials - count + 1, beyond))
    high = 1.0 if count == trials else float(betaincinv(count + 1, trials - count, 1 - beyond))
    return low, high


SCHEMA = "avc-trial/1"
# Of those who do not come to rest, so many are named.
_NAMED = 20
_DEPENDS_ON = ("problem_file", "contact", "table", "runtime", "wall", "max_force_n")


@dataclass(frozen=True)
class HandsAtRest:
    """How many of many hands come to rest.

    Attributes:
        coupling: its name.
        hands: how many there are.
        seed: of their draw.
        friction: whether the declared dry friction acts.
        at_rest: how many come to rest in every motion, by the published criterion of 5 mm/s.
        by_motion: how many in each.
        moving: numbers of the first of the others in the draw, from 0.
        effects: what was simulated.
    """

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
        """Ends of the exact binomial interval of the share at rest."""
        return exact_interval(self.at_rest, self.hands)

    def document(self) -> dict[str, Any]:
        """Return the document of `avc trial`: JSON values."""
        return {
            "schema": SCHEMA,
            **vars(self),
            "moving": list(self.moving),
            "effects": list(self.effects),
            "at_rest_interval": list(self.interval),
            "confidence": CONFIDENCE,
        }


def hands_at_rest(
    coupling: Coupling, hands: int, seed: int = 0, *, friction: bool = True, chunk: int = BLOCK
) -> Chunked[tuple[int, int], HandsAtRest]:
    """Plan to let many people press, tap and hold, drawn uniformly from the problem's set of hands.

    Args:
        coupling: what runs.
        hands: how many.
        seed: of their draw; the first of many are the same people as a few.
        friction: False leaves the declared dry friction out.
        chunk: hands tried at a time; the result does not depend on it.

    Returns:
        The study; its ``run()`` tries everybody.

    Example:
        >>> coupling = avc.recommend("soft", 20).coupling
        >>> from avc_casadi.simulation.population.settled import hands_at_rest
        >>> hands_at_rest(coupling, 50, seed=1).run().at_rest
        50
    """
    if hands < 1 or chunk < 1:
        raise InputError.of(f"is {min(hands, chunk)}; allowed: 1 or more", key="hands" if hands < 1 else "chunk")
    conditions = Conditions.of(coupling)
    conditions = conditions if friction else conditions.without_friction()
    tasks = [(first, min(chunk, hands - first)) for first in range(0, hands, chunk)]
    whole = coupling_document(coupling)
    told = {
        "coupling": coupling.method,
        "hands": hands,
        "seed": seed,
        "friction": friction,
        "effects": [effect.kind for effect in conditions.effects()],
    }
    # What a coupling carries with it and does not run would only cost time on the way to a worker.
    bare = replace(coupling, certificate=None, trial=None)
    return Chunked(
        about={
            "study": SCHEMA,
            **told,
            "chunk": chunk,
            "sha256": hashlib.sha256(json_text([whole[name] for name in _DEPENDS_ON]).encode()).hexdigest(),
        },
        work=partial(_tried, bare, conditions, seed),
        tasks=tasks,
        finish=partial(_counted, told),
        sizes=[count for _, count in tasks],
        things="hands",
    )


def unrest(
    couplings: Sequence[Coupling],
    people: Hand | StylusHand,
    *,
    friction: bool = True,
    beyond: bool = False,
    device: Device | None = None,
    effects: tuple[Effect, ...] = (),
) -> FloatArray:
    """Return how fast each of many ends the motion that ends fastest, with constant gains.

    Couplings in a row that differ in the numbers of their state feedback alone are one scene, run once.

    Args:
        couplings: what runs.
        people: who press, tap and hold.
        friction: False leaves the declared dry friction out.
        beyond: whether they also strike the wall, and touch it lightly; the lightest with the declared friction.
        device: on which; None is that of each coupling.
        effects: what is simulated beside what the device declares.

    Returns:
        Largest speed over that at which a hand is no longer at rest, shape (couplings, people).
    """
    found = [np.zeros((0, len(people)))]
    for _, group in groupby(couplings, _but_for_numbers):
        alike = list(group)
        ends = ends_of(alike[0], people, friction=friction, beyond=beyond, device=device, effects=effects)
        found.append(ends([one.runtime.state_feedback for one in alike]))
    return np.concatenate(found)


def ends_of(
    coupling: Coupling,
    people: Hand | StylusHand,
    *,
    friction: bool = True,
    beyond: bool = False,
    device: Device | None = None,
    effects: tuple[Effect, ...] = (),
    racing: bool = False,
) -> Ends:
    """Prepare to ask that of couplings that differ from one in nothing but the numbers of their state feedback.

    Args:
        coupling: as for `unrest`.
        people: as for `unrest`.
        friction: as for `unrest`.
        beyond: as for `unrest`.
        device: as for `unrest`.
        effects: as for `unrest`.
        racing: as for `Ends`.
    """
    coupling, conditions = on_device(coupling, device, effects)
    gains, course = coupling.table.at_rest, course_of(coupling.problem)
    whole = conditions if friction else conditions.without_friction()
    # Who moves at all mostly does so after a tap.
    told = sorted(course.motions, key=lambda name: name != "tap")
    motions = [(course.motions[name], whole) for name in told]
    if beyond:
        motions += [*((motion, whole) for motion in course.beyond), (course.lightest, conditions)]
    return Ends(coupling.problem, gains, people, motions, racing=racing)


def _but_for_numbers(coupling: Coupling) -> tuple[Any, ...]:
    """Return what tells couplings apart whose scenes are others."""
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
    """Try some of the draw, from a first one on."""
    first, count = task
    rest = _by_motion(coupling, conditions, draw_hands(coupling.problem.hands, count, seed, first=first))
    whole = np.all(list(rest.values()), axis=0)
    return {
        "at_rest": int(whole.sum()),
        "by_motion": {name: int(found.sum()) for name, found in rest.items()},
        "moving": (first + np.flatnonzero(~whole)[:_NAMED]).tolist(),
    }


def _counted(told: dict[str, Any], parts: list[dict[str, Any]]) -> HandsAtRest:
    return HandsAtRest(
        **{**told, "effects": tuple(told["effects"])},
        at_rest=sum(part["at_rest"] for part in parts),
        by_motion={name: sum(part["by_motion"][name] for part in parts) for name in MOTIONS},
        moving=tuple(number for part in parts for number in part["moving"])[:_NAMED],
    )
