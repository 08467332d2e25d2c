"""Trial of a user's own law: hands press, strike and tap, press for long, and release the device.

The law runs as it is, its nonlinear pieces too. What no linear claim shows is looked for here: a device that swings on
(friction compensation above the true friction is a relay), and an integral that hunts about dry friction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.counts import hands_count, refuse_counts, seed_count
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi.files.problem_file import require_device
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.effects import LawEffect, WallEffect
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import DEVICE, HANDLE
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Press
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import QUIET, Traces
from avc_casadi.simulation.population.motions import at_handle, course_of
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.setup import Setup, block_count, prepare, simulations
from avc_casadi.simulation.population.trial import CONFIDENCE, exact_interval

LAW_HANDS = 200
"""Hands that try a law where no other number is given."""
LAW_MOTIONS = ("press", "strike", "tap")
"""Motions of hands that try a law."""
LONG_PRESS_S = 20.0
"""Duration of the press in which an integral may hunt."""
_LONG_PRESS_HANDS = 16
"""Hands that press for long: the corners of the ranges, and as many others."""
_HUNTING_WINDOW_S = 15.0
"""Time at the end of a long press that is judged: three turns of a cycle of 0.1 Hz."""
_HUNTING_M = 5e-6
"""Peak to peak at the handle below which a long press counts as rest; half a step of the encoder, where that is more:
true positions are judged, and an integral that hunts does so within a step or two."""
_HUNTING_STEPS = 0.5
_SWING_WINDOW_S = 1.0
"""Time at the end of a motion in which a device that swings is looked for."""
SWING_M = 1e-5
"""Peak to peak at the handle below which a sustained motion counts as rest."""
_SWING_STEPS = 2
"""Steps of the encoder below which it does, where that is more."""
_LEAST_TURNS = 3
"""Changes of direction, at least, of a cycle."""
_LEAST_KEPT = 0.6
"""Share of its size in the first half of a window that a sustained cycle keeps in the second."""
_HYSTERESIS = 0.25
"""Share of its peak to peak by which a position passes its middle before it counts as a change of direction."""
_LEAST_FRICTION = 0.5
"""Share of the declared dry friction at which a compensation of it is tried too, where no range is declared."""
_RELEASE_M_PER_S = 0.1
"""Speed at the handle of a device that is released, towards the wall or the middle."""
_MOST_MOVING = 20
"""Hands that do not settle of which the numbers are kept."""


@dataclass(frozen=True)
class LimitCycle:
    """A motion that goes on: its frequency, not a number where it has too few turns, and its size."""

    frequency_hz: float
    peak_to_peak_m: float


@dataclass(frozen=True)
class LawCase:
    """What hands find of a law at one dry friction.

    Attributes:
        friction_n: the dry friction of the device.
        at_rest: hands that settle in every motion.
        by_motion: hands that settle in each motion.
        moving: numbers of the first hands that do not settle.
        swings: the largest motion that goes on, over hands and motions; None where none does.
        hunts: the one of median frequency that goes on in a long press with an integral; None where none does.
        released: whether the device comes to rest after it was released; None where nothing stops it but a hand.
        released_swings: how it moves where it does not.
        felt_vibration: the largest vibration at the end, in multiples of the detection threshold.
        stiffness_n_per_m: median of force over position at the end of a press; not a number without contact.
    """

    friction_n: float
    at_rest: int
    by_motion: dict[str, int]
    moving: tuple[int, ...]
    swings: LimitCycle | None
    hunts: LimitCycle | None
    released: bool | None
    released_swings: LimitCycle | None
    felt_vibration: float
    stiffness_n_per_m: float

    @property
    def quiet(self) -> bool:
        """Whether no vibration is felt."""
        return self.felt_vibration < QUIET


@dataclass(frozen=True)
class LawTrial:
    """Trial of a law.

    Attributes:
        problem: with its law.
        hands: number of hands.
        seed: seed of the draw.
        effects: kinds of the simulated effects.
        declared: with the friction that the device declares.
        least_friction: with the least of it, for a law that compensates friction; None for others.
        without_friction: without any; None where none is declared, or it was asked for alone.
        rests: whether all hands settle, and the device when it is released, as declared and at the least friction.
    """

    problem: Problem
    hands: int
    seed: int
    effects: tuple[str, ...]
    declared: LawCase
    least_friction: LawCase | None
    without_friction: LawCase | None

    @property
    def judged(self) -> tuple[LawCase, ...]:
        """The cases that the verdict is about."""
        return (self.declared,) if self.least_friction is None else (self.declared, self.least_friction)

    @property
    def rests(self) -> bool:
        """Whether all hands settle, and the device when it is released."""
        return all(case.at_rest == self.hands and case.released is not False for case in self.judged)

    @property
    def at_rest_interval(self) -> tuple[float, float]:
        """Exact interval of the share that settles as declared."""
        return exact_interval(self.declared.at_rest, self.hands)

    @property
    def confidence(self) -> float:
        """Confidence of that interval."""
        return CONFIDENCE


def try_law(
    problem: Problem,
    hands: int = LAW_HANDS,
    seed: int = 0,
    *,
    friction: bool = True,
    progress: Progress = SILENT,
) -> LawTrial:
    """Try the law of a problem with simulated hands; without `friction` at none alone.

    Raises:
        InputError: a count out of its range, or a problem without [law].
        UnsupportedError: neither the device nor the lightest hand has a mass, or there is no device.
    """
    require_device(problem)
    refuse_counts(hands_count(hands), seed_count(seed))
    if problem.law is None:
        raise InputError.of("is missing; allowed: a table [law], or a coupling file", file=problem.name, key="law")
    if problem.device.mass_kg + problem.hands.mass_kg[0] == 0:
        why = "device.mass_kg and the mass of the lightest hand are 0; one of them must be above 0"
        raise UnsupportedError(why, key="device.mass_kg")
    drawn_hands = people_of(problem.hands, hands, seed)
    levels = _friction_levels_n(problem, friction=friction)
    cases: dict[str, LawCase] = {}
    stages = Stages(progress, len(levels) * _stages_at(problem, hands))
    for name, friction_n in levels.items():
        at_level = name.replace("_", " ") + " friction" * (name == "declared")
        cases[name] = _try_at(_at_friction(problem, friction_n), drawn_hands, seed, partial(_begin, stages, at_level))
    return LawTrial(
        problem=problem,
        hands=hands,
        seed=seed,
        effects=law_setup(_at_friction(problem, levels["declared"])).kinds,
        declared=cases["declared"],
        least_friction=cases.get("least_friction"),
        without_friction=cases.get("without_friction"),
    )


def _friction_levels_n(problem: Problem, *, friction: bool) -> dict[str, float]:
    """Return the dry frictions, N, that a law is tried at: declared, none, and for a compensation the least."""
    device, law = problem.device, problem.law
    declared_n = device.coulomb_friction_n
    if not friction or not declared_n:
        return {"declared": 0.0}
    levels = {"declared": declared_n}
    if law is not None and law.friction_compensation is not None:
        known = device.range.coulomb_friction_n
        levels["least_friction"] = _LEAST_FRICTION * declared_n if known is None else known[0]
    return levels | {"without_friction": 0.0}


def _at_friction(problem: Problem, friction_n: float) -> Problem:
    return problem.changed(device={"coulomb_friction_n": friction_n, "range": {"coulomb_friction_n": None}})


def law_setup(problem: Problem) -> Setup:
    """Return what hands try: the law with all that the device declares."""
    effects = tuple(LawEffect() if isinstance(effect, WallEffect) else effect for effect in declared_effects(problem))
    return Setup(problem, NO_COUPLING, effects)


@dataclass(frozen=True)
class _Motion:
    """Hands in one motion; arrays have shape (hands,)."""

    rests: BoolArray
    cycles: list[LimitCycle]
    vibration: float
    """Largest at the hand, in multiples of the detection threshold."""
    stiffness_n_per_m: FloatArray


def _stages_at(problem: Problem, hands: int) -> int:
    """Return how many stages a trial at one friction has: blocks of each motion, a release, and a long press."""
    _, duration_s = course_of(problem)
    blocks = block_count(hands, duration_s, problem.device.sample_time_s)
    hunts = problem.law is not None and bool(problem.law.integral_n_per_m_s)
    return len(LAW_MOTIONS) * blocks + 1 + hunts


def _begin(stages: Stages, at_level: str, motion: str) -> None:
    """Begin the stage of a motion at a level of friction."""
    stages.begin(f"{motion}, {at_level}")


def _simulated(simulations_of: Iterator[Callable[[], Traces]], begin: Callable[[], None]) -> Iterator[Traces]:
    """Yield the traces of each block, whose simulation is a stage."""
    for simulation in simulations_of:
        begin()
        yield simulation()


def _try_at(problem: Problem, hands: Hand, seed: int, begin: Callable[[str], None]) -> LawCase:
    """Return what hands find at the friction that a problem declares; each motion of a block begins a stage."""
    setup = law_setup(problem)
    motions, duration_s = course_of(problem)
    tried = {}
    for name in LAW_MOTIONS:
        blocks = simulations(setup, hands, motions[name], duration_s)
        tried[name] = _moved(_simulated(blocks, partial(begin, name)), problem.device)
    rests = np.all([motion.rests for motion in tried.values()], axis=0)
    begin("release")
    released, released_swings = _released(setup, duration_s)
    stiffness = tried["press"].stiffness_n_per_m
    in_contact = stiffness[np.isfinite(stiffness)]
    return LawCase(
        friction_n=problem.device.coulomb_friction_n,
        at_rest=int(rests.sum()),
        by_motion={name: int(motion.rests.sum()) for name, motion in tried.items()},
        moving=tuple(np.flatnonzero(~rests)[:_MOST_MOVING].tolist()),
        swings=_largest([cycle for motion in tried.values() for cycle in motion.cycles]),
        hunts=_hunting(setup, people_of(problem.hands, _LONG_PRESS_HANDS, seed), begin),
        released=released,
        released_swings=released_swings,
        felt_vibration=max(motion.vibration for motion in tried.values()),
        stiffness_n_per_m=float(np.median(in_contact)) if len(in_contact) else np.nan,
    )


def _moved(blocks: Iterator[Traces], device: Device) -> _Motion:
    """Return how the hands of all blocks end a motion: whether they rest, else how they swing; vibration, stiffness."""
    rests = []
    swings = []
    vibration = []
    stiffness = []
    for block in blocks:
        verdict = block.judge()
        cycles = _Cycles.of(block, _SWING_WINDOW_S, _swing_m(device))
        at_rest = verdict.stable & ~cycles.sustained
        swings += [cycles.cycle(int(row)) for row in np.flatnonzero(~at_rest)]
        rests.append(at_rest)
        vibration.append(block.vibration.max())
        stiffness.append(verdict.apparent_stiffness_n_per_m)
    return _Motion(
        rests=np.concatenate(rests),
        cycles=swings,
        vibration=float(np.max(vibration)),
        stiffness_n_per_m=np.concatenate(stiffness),
    )


def _hunting(setup: Setup, hands: Hand, begin: Callable[[str], None]) -> LimitCycle | None:
    """Return a cycle of a long press with an integral, that of median frequency over hands; None where none goes on.

    How slow one is depends on where the steps of the encoder stand; how large it is hardly does.
    """
    device, law = setup.problem.device, setup.problem.law
    if law is None or not law.integral_n_per_m_s:
        return None
    press = at_handle(Press(), device)
    rest_m = max(_HUNTING_M / device.metres_per_unit, _HUNTING_STEPS * device.encoder_resolution_m)
    cycles = []
    blocks = simulations(setup, hands, press, LONG_PRESS_S)
    for block in _simulated(blocks, partial(begin, "long press")):
        turns = _Cycles.of(block, _HUNTING_WINDOW_S, rest_m)
        cycles += [turns.cycle(int(row)) for row in np.flatnonzero(turns.sustained)]
    return sorted(cycles, key=lambda cycle: cycle.frequency_hz)[len(cycles) // 2] if cycles else None


def _released(setup: Setup, duration_s: float) -> tuple[bool | None, LimitCycle | None]:
    """Return whether a device that is released comes to rest, and how it swings where it does not.

    It begins before the wall, or beside the middle, under way towards it. In front of a wall nothing but friction and
    damper of the device stop it; a law that does nothing there is not to blame where they are 0.
    """
    problem = setup.problem
    device, law = problem.device, problem.law
    stops = device.damping_ns_per_m > 0 or device.coulomb_friction_n > 0
    blameless = law is None or (problem.law_in_wall and not law.acts_outside and not stops)
    if blameless or device.mass_kg == 0:
        return None, None
    nobody = Hand(*np.zeros((3, 1)))
    scene, parameters, inputs = prepare(setup, nobody, at_handle(Press(), device), duration_s)
    initial = scene.initial.copy()
    for body in (DEVICE, HANDLE):
        name = f"{body}_velocity_m_per_s"
        if name in scene.states:
            initial[scene.states.index(name)] = _RELEASE_M_PER_S / device.metres_per_unit
    run = Traces.of(execute(replace(scene, initial=initial), parameters, inputs), device)
    turns = _Cycles.of(run, _SWING_WINDOW_S, _swing_m(device))
    rests = bool(run.judge().stable[0] and not turns.sustained[0])
    return rests, None if rests else turns.cycle(0)


def _swing_m(device: Device) -> float:
    """Return the size of a motion up to which it counts as rest."""
    return max(SWING_M / device.metres_per_unit, _SWING_STEPS * device.encoder_resolution_m)


def _largest(cycles: Sequence[LimitCycle]) -> LimitCycle | None:
    return max(cycles, key=lambda cycle: cycle.peak_to_peak_m, default=None)


@dataclass(frozen=True)
class _Cycles:
    """Turns of positions about their middle in a window at the end; arrays have shape (runs,)."""

    peak_to_peak_m: FloatArray
    turns: IndexArray
    span_s: FloatArray
    """Time from the first turn to the last."""
    sustained: BoolArray
    """Whether the motion is larger than rest, turns, and does not decay."""

    @classmethod
    def of(cls, block: Traces, window_s: float, rest_m: float) -> _Cycles:
        """Return the turns of positions in the last `window_s` of traces; what is smaller than `rest_m` rests.

        A turn is a crossing of the middle with a hysteresis. A swing is sustained where its size is kept and it turns
        often.
        """
        position = block.position_m if block.handle_m is None else block.handle_m
        last = position[..., -round(window_s / block.sample_time_s) :]
        low, high = last.min(axis=-1), last.max(axis=-1)
        size = high - low
        middle, beyond = (0.5 * (low + high))[:, None], (_HYSTERESIS * size)[:, None]
        with np.errstate(invalid="ignore"):
            side = np.where(last > middle + beyond, 1, np.where(last < middle - beyond, -1, 0))
        # Between the two thresholds the side is the one before.
        known = np.maximum.accumulate(np.where(side != 0, np.arange(side.shape[-1]), 0), axis=-1)
        side = np.take_along_axis(side, known, axis=-1)
        changes = (side[:, 1:] * side[:, :-1]) < 0
        turns = changes.sum(axis=-1)
        places = np.arange(changes.shape[-1])
        first = np.where(turns > 0, changes.argmax(axis=-1), 0)
        final = np.where(changes, places, 0).max(axis=-1)
        early, late = np.array_split(last, 2, axis=-1)
        kept = np.ptp(late, axis=-1) >= _LEAST_KEPT * np.ptp(early, axis=-1)
        sustained = (size > rest_m) & (turns >= _LEAST_TURNS) & kept
        return cls(size, turns, (final - first) * block.sample_time_s, sustained)

    def cycle(self, row: int) -> LimitCycle:
        """Return the cycle of a run."""
        turns, span_s = int(self.turns[row]), float(self.span_s[row])
        frequency = 0.5 * (turns - 1) / span_s if turns >= _LEAST_TURNS and span_s > 0 else np.nan
        return LimitCycle(frequency, float(self.peak_to_peak_m[row]))
