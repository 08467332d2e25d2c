"""Trial of an admittance law: simulated hands guide the handle, hold it, release it and push it against contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from typing import cast

import numpy as np

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.counts import hands_count, refuse_counts, seed_count, workers_count
from avc_casadi._util.parallel import map_tasks
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.files.admittance_file import AnyAdmittance, as_admittance
from avc_casadi.loops.handle import HandleFamily
from avc_casadi.model.admittance import AdmittanceDevice, AdmittanceProblem
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.population.admittance_run import HandleRecord, HandTask, TriedHands, simulated
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import CONFIDENCE, exact_interval

ADMITTANCE_HANDS = 200
"""Hands that try an admittance law where no other number is given."""
_HANDS_OF_TASK = 200
"""Hands that a process tries at a time."""
_MOST_MOVING = 20
"""Hands that do not settle of which the numbers are kept."""
_CONTACTS = 3
"""Stream of random numbers of a seed from which contacts are drawn."""


@dataclass(frozen=True)
class GuidingEffort:
    """What a hand feels that guides the handle to and fro at 1 Hz.

    Attributes:
        way_m: how far it guides to each side.
        peak_n: the largest force of a hand, over all hands.
        rms_n: the largest rms of it.
        effort_ns_per_m: rms of the force over that of the handle's speed, the median of hands.
    """

    way_m: float
    peak_n: float
    rms_n: float
    effort_ns_per_m: float


@dataclass(frozen=True)
class ReleasedHandle:
    """The handle after a hand has let go of it at full speed; largest of all hands.

    Attributes:
        at_release_m_per_s: speed of the handle when the hand lets go.
        largest_m_per_s: largest speed of handle and drive from then on.
        way_m: how far the handle moves on.
    """

    at_release_m_per_s: float
    largest_m_per_s: float
    way_m: float


@dataclass(frozen=True)
class ContactRebound:
    """How a handle leaves a contact; largest of all hands and contacts.

    Attributes:
        pressed_m: how far it leaves the surface again after the first touch while a hand presses; 0: it stays.
        released_m: how far it is from the surface after a hand that pressed has let go.
        released_m_per_s: largest speed of handle and drive then.
    """

    pressed_m: float
    released_m: float
    released_m_per_s: float


@dataclass(frozen=True)
class AdmittanceTrial:
    """What simulated hands find of an admittance law.

    Attributes:
        problem: with its law.
        hands: number of hands.
        seed: seed of the draws.
        devices: devices at the corners of the declared ranges, on which hands try in turn.
        contacts: contacts that each hand pushes against: the ends of their ranges, and one that is drawn for it.
        longest_s: duration of a motion.
        at_rest: hands that settle in every motion.
        by_motion: hands that settle in each motion.
        moving: numbers of the first hands that do not settle.
        effort: of a hand that guides.
        released: the handle after release.
        rebound: how it leaves a contact; None where there is none.
        at_speed_limit: hands with which the largest velocity is commanded.
        at_force_limit: hands with which the sensor reads the end of its range.
        rests: whether all hands settle.
        at_rest_interval: exact interval of the share that settles.
        confidence: confidence of that interval.
    """

    problem: AdmittanceProblem
    hands: int
    seed: int
    devices: int
    contacts: int
    longest_s: float
    at_rest: int
    by_motion: dict[str, int]
    moving: tuple[int, ...]
    effort: GuidingEffort
    released: ReleasedHandle
    rebound: ContactRebound | None
    at_speed_limit: int
    at_force_limit: int
    rests: bool
    at_rest_interval: tuple[float, float]
    confidence: float


def try_admittance(
    problem: AnyAdmittance,
    hands: int = ADMITTANCE_HANDS,
    seed: int = 0,
    *,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress = SILENT,
) -> AdmittanceTrial:
    """Try the law of an admittance device with simulated hands; contacts are one-sided.

    Args:
        problem: an `AdmittanceProblem`, its file or name.
        hands: number of hands.
        seed: seed of the draws of hands, contacts and noise.
        workers: processes at most, this one included.
        executor: in place of processes of this machine.
        progress: told how many hands are done.

    Raises:
        InputError: a count out of its range, a value that is refused, or no law.
        UnsupportedError: a drive that follows a position.
    """
    refuse_counts(hands_count(hands), seed_count(seed), workers_count(workers))
    stated = _ready_for_trial(as_admittance(problem))
    tasks = _tasks(stated, hands, seed)
    sizes = [len(task.numbers) for task in tasks]
    tried = map_tasks(simulated, tasks, executor, workers=workers, sizes=sizes, things="hands", progress=progress)
    rests = _rests_by_motion(tasks, tried)
    whole = np.all(list(rests.values()), axis=0)
    at_rest = int(whole.sum())
    return AdmittanceTrial(
        problem=stated,
        hands=hands,
        seed=seed,
        devices=len({task.place for task in tasks}),
        contacts=len(tasks[0].contacts),
        longest_s=max(part.duration_s for part in tried),
        at_rest=at_rest,
        by_motion={name: int(settled.sum()) for name, settled in rests.items()},
        moving=tuple(np.flatnonzero(~whole)[:_MOST_MOVING].tolist()),
        effort=_effort(tried),
        released=_released(tried),
        rebound=_rebound(tried) if tasks[0].contacts else None,
        at_speed_limit=sum(part.hands_at(part.computer.at_speed_limit) for part in tried),
        at_force_limit=sum(part.hands_at(part.computer.at_force_limit) for part in tried),
        rests=at_rest == hands,
        at_rest_interval=exact_interval(at_rest, hands),
        confidence=CONFIDENCE,
    )


def _rests_by_motion(tasks: Sequence[HandTask], tried: Sequence[TriedHands]) -> dict[str, BoolArray]:
    """Return whether each hand comes to rest in each motion, shape (hands,), in the order in which hands are drawn."""
    order = np.argsort(np.concatenate([task.numbers for task in tasks]))
    return {motion: np.concatenate([part.rests(motion) for part in tried])[order] for motion in tried[0].motions}


def _ready_for_trial(problem: AdmittanceProblem) -> AdmittanceProblem:
    """Return a problem that has a law and a drive whose motion is simulated; refuse any other."""
    if problem.device.drive == "position":
        fact = f'{problem.typed_name}: device.drive is "position"'
        raise UnsupportedError(f"{fact}: hands are simulated with velocity drives only; use avc certify", key="")
    if problem.law is None:
        allowed = "allowed: [law] with admittance = { mass_kg, damping_ns_per_m }"
        raise InputError.of(f"is missing; {allowed}", file=problem.typed_name, key="law")
    return problem


def _tasks(problem: AdmittanceProblem, count: int, seed: int) -> list[HandTask]:
    """Return the hands in blocks, on the devices at the corners of the declared ranges in turn."""
    assert problem.law is not None  # noqa: S101 - it is tried
    people, contacts = people_of(problem.hands, count, seed), _contacts(problem, count, seed)
    devices = cast("list[AdmittanceDevice]", HandleFamily.of(problem).sides[0].devices)
    tasks = []
    for place, device in enumerate(devices):
        rows = np.arange(place, count, len(devices))
        for block in np.split(rows, range(_HANDS_OF_TASK, len(rows), _HANDS_OF_TASK)) if len(rows) else ():
            touched = [contact.pick(block) for contact in contacts]
            tasks.append(HandTask(place, device, problem.law.admittance, block, people.pick(block), touched, seed))
    return tasks


def _contacts(problem: AdmittanceProblem, count: int, seed: int) -> list[Hand]:
    """Return the contacts of hands: those at the ends of their ranges, and one drawn from these for each hand."""
    contact = problem.contact
    if not contact.touches:
        return []
    ranges = np.array([contact.damping_ns_per_m, contact.stiffness_n_per_m])
    corners = [corner for corner in sorted(set(product(*ranges.tolist()))) if corner[1] > 0]
    low, high = ranges.T
    drawn = low + (high - low) * (1 - np.random.default_rng([seed, _CONTACTS]).random((count, 2)))
    whole = [np.tile(corner, (count, 1)) for corner in corners] + ([drawn] if (high > low).any() else [])
    return [Hand(np.zeros(count), *values.T) for values in whole]


def _largest(tried: Sequence[TriedHands], motion: str, seen: Callable[[HandleRecord], FloatArray]) -> float:
    """Return the largest of what was seen in a motion."""
    return max(float(part.of(motion, seen(part.record)).max()) for part in tried)


def _effort(tried: Sequence[TriedHands]) -> GuidingEffort:
    """Return way, peak and rms force of guiding, and the median effort, rms force over rms speed, N.s/m."""
    squares = np.concatenate([part.of("guide", part.record.squares) / part.guided_samples for part in tried], axis=-1)
    force_n, speed_m_per_s = np.sqrt(squares)
    with np.errstate(divide="ignore", invalid="ignore"):  # a hand without spring and damper moves nothing
        effort = force_n / speed_m_per_s
    return GuidingEffort(
        way_m=max(part.way_m for part in tried),
        peak_n=_largest(tried, "guide", lambda record: record.peak_n),
        rms_n=float(force_n.max()),
        effort_ns_per_m=float(np.median(effort)),
    )


def _released(tried: Sequence[TriedHands]) -> ReleasedHandle:
    return ReleasedHandle(
        at_release_m_per_s=_largest(tried, "release", lambda record: record.at_release_m_per_s),
        largest_m_per_s=_largest(tried, "release", lambda record: record.released_m_per_s),
        way_m=_largest(tried, "release", lambda record: record.released_m),
    )


def _rebound(tried: Sequence[TriedHands]) -> ContactRebound:
    return ContactRebound(
        pressed_m=_largest(tried, "press", lambda record: record.gap_m),
        released_m=_largest(tried, "leave", lambda record: record.gap_m),
        released_m_per_s=_largest(tried, "leave", lambda record: record.released_m_per_s),
    )
