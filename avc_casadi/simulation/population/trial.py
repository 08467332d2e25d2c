"""Trials: many hands with a coupling to a wall, a virtual tool or a follower, and which of them settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.json_values import plain_table
from avc_casadi._util.parallel import map_tasks, processors
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.coupling import Coupling
from avc_casadi.model.device import Device
from avc_casadi.model.effects import Effect
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.simulation.execute import compile_ahead, execute_to_speed
from avc_casadi.simulation.judge import QUIET, Traces
from avc_casadi.simulation.population.motions import AT_WALL, TRIAL_S, course_of
from avc_casadi.simulation.population.operators import BLOCK, draw_hands
from avc_casadi.simulation.population.setup import FRICTION, Setup, prepare, simulations

CONFIDENCE = 0.95
"""Of the interval of a share of hands."""
_NINE_IN_TEN = (0.05, 0.95)
"""Quantiles between which nine in ten hands lie."""
_HANDS_OF_TASK = 1000
"""Hands that a process tries at a time."""
# A press that ends above this share of the largest force is saturated: its stiffness is not the wall's.
NEAR_LIMIT = 0.97


def exact_interval(count: int, trials: int) -> tuple[float, float]:
    """Return Clopper and Pearson's interval of a probability, of at least the stated confidence."""
    from scipy.special import betaincinv  # noqa: PLC0415 - statistics load slowly, and most calls need none

    beyond = (1 - CONFIDENCE) / 2
    low = 0.0 if count == 0 else float(betaincinv(count, trials - count + 1, beyond))
    high = 1.0 if count == trials else float(betaincinv(count + 1, trials - count, 1 - beyond))
    return low, high


@dataclass(frozen=True, eq=False, repr=False)
class Trial(Tabular):
    """Results by simulated hand; every array has shape (hands,)."""

    seed: int
    by_motion: dict[str, BoolArray]
    stiffness_n_per_m: FloatArray
    tap_force_n: FloatArray
    beside: dict[str, BoolArray] = field(default_factory=dict)
    """Whether a hand settles in every motion too without friction, or with dropped steps."""
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def stable(self) -> BoolArray:
        """Settled in every motion."""
        return np.asarray(np.all(list(self.by_motion.values()), axis=0))

    @property
    def stable_without_friction(self) -> BoolArray:
        """Settled in every motion without dry friction too."""
        return self.beside["without_friction"]

    @property
    def hands(self) -> int:
        """Number of hands."""
        return len(self.stiffness_n_per_m)

    @property
    def hand_settles(self) -> BoolArray:
        """Settled in every motion, without friction and with missed steps too."""
        return np.asarray(np.all([self.stable, *self.beside.values()], axis=0))

    @property
    def all_settle(self) -> bool:
        """Whether all hands settle, without friction and with missed steps too."""
        return bool(self.hand_settles.all())

    @property
    def all_settle_with_friction(self) -> bool:
        """Whether all hands settle as declared, with missed steps too."""
        return bool(np.all(self.stable & self.beside.get("with_dropped_steps", self.stable)))

    @property
    def stiffness(self) -> float:
        """Median rendered stiffness; not a number where no hand is in contact."""
        in_contact = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        return float(np.median(in_contact)) if len(in_contact) else np.nan

    def to_dict(self) -> Columns:
        """Return the results by hand as columns, each of shape (hands,)."""
        return {
            "hand": np.arange(self.hands),
            "stable": self.stable,
            **{f"stable_{name}": settled for name, settled in self.beside.items()},
            "stiffness_n_per_m": self.stiffness_n_per_m,
            "tap_force_n": self.tap_force_n,
        }

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return plain_table(
            {
                "hands": self.hands,
                "seed": self.seed,
                "motions": list(self.by_motion),
                "settled": int(self.stable.sum()),
                "settled_by_motion": {name: int(runs.sum()) for name, runs in self.by_motion.items()},
                **{f"settled_{name}": int(settled.sum()) for name, settled in self.beside.items()},
                **self.facts,
                "rendered_stiffness_n_per_m": self.stiffness,
                "tap_force_n": float(self.tap_force_n.max()),
            }
        )

    def _summary(self) -> str:
        variants = "".join(f", {int(settled.sum())} {name.replace('_', ' ')}" for name, settled in self.beside.items())
        return f"{int(self.stable.sum())} of {self.hands} hands settle{variants}; {short(self.stiffness_n_per_m)}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CouplingTrial(Trial):
    """Results at a wall."""

    effects: tuple[str, ...]
    vibration: FloatArray
    at_force_limit: BoolArray
    tap_depth_m: FloatArray
    wall_n_per_m: float
    devices: int = 1
    longest_s: float = TRIAL_S

    @property
    def quiet(self) -> BoolArray:
        """Settled with a vibration below the vibrotactile detection threshold."""
        return np.asarray(self.stable & (self.vibration < QUIET))

    def to_dict(self) -> Columns:
        """Return the results by hand as columns, each of shape (hands,)."""
        more = ("vibration", "at_force_limit", "tap_depth_m")
        return super().to_dict() | {name: getattr(self, name) for name in more}

    def counts(self) -> dict[str, int]:
        """Return counts: hands, devices, settled, settled without friction, settled below the detection threshold."""
        return {
            "hands": self.hands,
            "devices": self.devices,
            "at_rest": int(self.stable.sum()),
            "at_rest_without_friction": int(self.stable_without_friction.sum()),
            "quiet": int(self.quiet.sum()),
        }

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        felt = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        return plain_table(
            {
                **self.counts(),
                "seed": self.seed,
                "effects": list(self.effects),
                "motions": list(self.by_motion),
                "longest_s": self.longest_s,
                "at_rest_interval": list(exact_interval(int(self.stable.sum()), self.hands)),
                "at_rest_by_motion": {name: int(runs.sum()) for name, runs in self.by_motion.items()},
                "felt_vibration": float(np.median(self.vibration)),
                "felt_vibration_worst": float(self.vibration.max()),
                "stiffness_n_per_m": {
                    "lowest": float(felt.min()) if len(felt) else None,
                    "median": self.stiffness,
                    "highest": float(felt.max()) if len(felt) else None,
                    "nine_in_ten": np.quantile(felt, _NINE_IN_TEN).tolist() if len(felt) else None,
                },
                "at_force_limit": int(self.at_force_limit.sum()),
                "share_of_wall": self.stiffness / self.wall_n_per_m if self.wall_n_per_m else None,
                "tap_force_n": float(self.tap_force_n.max()),
                "tap_depth_m": float(self.tap_depth_m.max()),
                "not_simulated": ["hands that change while they hold on", "several axes"],
            }
        )

    @classmethod
    def join(cls, parts: Sequence[CouplingTrial], order: IndexArray | slice = slice(None)) -> CouplingTrial:
        """Return the trial of all hands, in the order of the parts or another one."""
        whole: dict[str, Any] = {}
        for name in ("stiffness_n_per_m", "tap_force_n", "vibration", "at_force_limit", "tap_depth_m"):
            whole[name] = np.concatenate([getattr(part, name) for part in parts])[order]
        for name in ("by_motion", "beside"):
            tables = [getattr(part, name) for part in parts]
            whole[name] = {key: np.concatenate([table[key] for table in tables])[order] for key in tables[0]}
        return replace(parts[0], **whole)


def try_coupling(
    coupling: Coupling,
    people: Hand | StylusHand,
    seed: int = 0,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> CouplingTrial:
    """Simulate press, tap and hold by all hands, with all that the problem declares of the device."""
    setup = Setup.of(coupling)
    blocks = (slice(first, first + _HANDS_OF_TASK) for first in range(0, len(people), _HANDS_OF_TASK))
    tasks = [(setup, people.pick(block)) for block in blocks]
    sizes = [len(hands) for _, hands in tasks]
    work = partial(_try_motions, seed)
    return CouplingTrial.join(map_tasks(work, tasks, executor, sizes=sizes, things="hands", progress=progress))


def try_on_devices(
    coupling: Coupling,
    people: Hand | StylusHand,
    devices: Sequence[Device],
    seed: int = 0,
    executor: Executor | None = None,
) -> CouplingTrial:
    """Simulate hands with a coupling, each on one of several devices, assigned in turn."""
    split = [np.arange(place, len(people), len(devices)) for place in range(len(devices))]
    jobs = [
        (Setup.of(coupling, device), people.pick(rows))
        for rows, device in zip(split, devices, strict=True)
        if len(rows)
    ]
    trials = map_tasks(partial(_try_motions, seed), jobs, executor)
    return replace(
        CouplingTrial.join(trials, np.argsort(np.concatenate(split), kind="stable")),
        effects=tuple(dict.fromkeys(effect for trial in trials for effect in trial.effects)),
        devices=len(trials),
        longest_s=max(trial.longest_s for trial in trials),
    )


def _try_motions(seed: int, task: tuple[Setup, Hand | StylusHand]) -> CouplingTrial:
    """Simulate every motion as declared, then without dry friction where some is declared."""
    setup, people = task
    motions, duration_s = course_of(setup.problem)
    settings = [setup, setup.without(FRICTION)] if setup.rough else [setup]
    limit = setup.problem.device.max_force_n
    parts: dict[tuple[str, bool], list[dict[str, Any]]] = {}
    with ThreadPoolExecutor(1) as pool:  # a scene is built while another is simulated
        work = [
            ((name, variant is setup), pool.submit(_figures, name if variant is setup else "", limit, simulation))
            for variant in settings
            for name in AT_WALL
            for simulation in simulations(variant, people, motions[name], duration_s)
        ]
        for key, future in work:
            parts.setdefault(key, []).append(future.result())

    def whole(name: str, figure: str, *, friction: bool = True) -> Any:
        return np.concatenate([part[figure] for part in parts[name, friction]])

    free = [whole(name, "stable", friction=not setup.rough) for name in AT_WALL]
    return CouplingTrial(
        seed=seed,
        by_motion={name: whole(name, "stable") for name in AT_WALL},
        beside={"without_friction": np.asarray(np.all(free, axis=0))},
        effects=setup.kinds,
        **{figure: whole("press", figure) for figure in ("vibration", "stiffness_n_per_m", "at_force_limit")},
        **{figure: whole("tap", figure) for figure in ("tap_force_n", "tap_depth_m")},
        wall_n_per_m=setup.problem.environment.stiffness_n_per_m,
        longest_s=duration_s,
    )


def _figures(name: str, limit_n: float | None, simulation: Callable[[], Traces]) -> dict[str, Any]:
    """Return the results of a motion."""
    part = simulation()
    verdict = part.judge()
    figures: dict[str, Any] = {"stable": verdict.stable}
    if name == "press":
        at_limit = np.abs(verdict.mean_force_n) > NEAR_LIMIT * (np.inf if limit_n is None else limit_n)
        figures["at_force_limit"] = at_limit
        figures["stiffness_n_per_m"] = np.where(at_limit, np.nan, verdict.apparent_stiffness_n_per_m)
        figures["vibration"] = part.vibration
    if name == "tap":
        figures["tap_force_n"] = np.abs(part.force_n).max(axis=-1)
        figures["tap_depth_m"] = part.depth_m.max(axis=-1)
    return figures


_MOST_MOVING = 20
"""Hands that do not settle of which the numbers are kept."""


@dataclass(frozen=True)
class RestCount:
    """How many simulated hands settle in press, tap and hold.

    Attributes:
        coupling: method of the coupling.
        hands: number of hands.
        seed: seed of the draw.
        friction: whether the declared dry friction acts.
        at_rest: hands that settle in every motion.
        by_motion: hands that settle in each motion.
        moving: numbers in the draw of the first hands that do not settle.
        effects: kinds of the simulated effects.
        at_rest_interval: exact interval of the share that settles.
        confidence: confidence of that interval.
    """

    coupling: str
    hands: int
    seed: int
    friction: bool
    at_rest: int
    by_motion: Mapping[str, int]
    moving: tuple[int, ...]
    effects: tuple[str, ...]
    at_rest_interval: tuple[float, float]
    confidence: float


def count_at_rest(  # noqa: PLR0913 - options by name, of a public call
    coupling: Coupling,
    hands: int,
    seed: int = 0,
    *,
    friction: bool = True,
    block: int = BLOCK,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress = SILENT,
) -> RestCount:
    """Count press, tap and hold by any number of hands, drawn in blocks."""
    if hands < 1:
        raise InputError.of(f"is {hands}; allowed: 1 or more", key="hands")
    setup = Setup.of(coupling)
    setup = setup if friction else setup.without(FRICTION)
    tasks = [(first, min(block, hands - first)) for first in range(0, hands, block)]
    sizes = [count for _, count in tasks]
    work = partial(_at_rest, setup, seed)
    parts = map_tasks(work, tasks, executor, workers=workers, sizes=sizes, things="hands", progress=progress)
    rest = {name: np.concatenate([part[name] for part in parts]) for name in AT_WALL}
    whole = np.all(list(rest.values()), axis=0)
    at_rest = int(whole.sum())
    return RestCount(
        coupling=coupling.method,
        hands=hands,
        seed=seed,
        friction=friction,
        at_rest=at_rest,
        by_motion={name: int(settled.sum()) for name, settled in rest.items()},
        moving=tuple(np.flatnonzero(~whole)[:_MOST_MOVING].tolist()),
        effects=setup.kinds,
        at_rest_interval=exact_interval(at_rest, hands),
        confidence=CONFIDENCE,
    )


def _at_rest(setup: Setup, seed: int, task: tuple[int, int]) -> dict[str, BoolArray]:
    """Simulate a block of the draw, from a first index on."""
    first, count = task
    people = draw_hands(setup.problem.hands, count, seed, first=first)
    motions, duration_s = course_of(setup.problem)
    scenes = (prepare(setup, people, motions[name], duration_s) for name in AT_WALL)
    return {name: execute_to_speed(*scene) < 1 for name, scene in zip(AT_WALL, scenes, strict=True)}


def residual_speeds(
    coupling: Coupling,
    people: Hand | StylusHand,
    names: Sequence[str] = AT_WALL,
    *,
    friction: bool = True,
    device: Device | None = None,
    effects: tuple[Effect, ...] = (),
) -> FloatArray:
    """Return the largest residual speed of each hand over some motions, over that of rest; who grazes has friction."""
    setup = Setup.of(coupling, device, effects)
    whole = setup if friction else setup.without(FRICTION)
    motions, duration_s = course_of(setup.problem)
    scenes = [prepare(setup if name == "graze" else whole, people, motions[name], duration_s) for name in names]
    for scene, *_ in scenes:
        compile_ahead(scene, len(people))
    speeds = [execute_to_speed(*scene, workers=processors()) for scene in scenes]
    return np.asarray(np.max(speeds, axis=0))
