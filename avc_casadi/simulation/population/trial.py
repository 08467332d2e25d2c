"""Trials: many hands with a coupling to a wall, a virtual tool or a follower, and which of them settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.counts import IN_BLOCKS, hands_count, refuse_counts, seed_count, workers_count
from avc_casadi._util.json_values import plain, plain_table
from avc_casadi._util.parallel import map_tasks, processors
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.coupling import Coupling, TrialRecord
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
_MANY = 0.1
"""Share of the hands from which many feel a vibration."""
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


Variant = Literal["without_friction", "with_dropped_steps"]
"""Trials that repeat one: without dry friction, and where the engine misses steps."""


@dataclass(frozen=True, eq=False, repr=False)
class Trial(Tabular, TrialRecord):
    """Results by simulated hand; every array has shape (hands,)."""

    seed: int
    by_motion: dict[str, BoolArray]
    stiffness_n_per_m: FloatArray
    tap_force_n: FloatArray

    @property
    def variants(self) -> dict[Variant, BoolArray]:
        """Whether a hand settles in every motion of each trial that repeats this one."""
        return {}

    def circumstances(self) -> dict[str, float]:
        """Return the shares of what is missed, by the key of the document."""
        return {}

    @property
    def stable(self) -> BoolArray:
        """Settled in every motion."""
        return np.asarray(np.all(list(self.by_motion.values()), axis=0))

    @property
    def settled(self) -> int:
        """Number of hands that settle in every motion."""
        return int(self.stable.sum())

    @property
    def hardest_motion(self) -> str:
        """Motion with which the fewest hands settle."""
        return min(self.by_motion, key=lambda motion: int(self.by_motion[motion].sum()))

    @property
    def largest_tap_force_n(self) -> float:
        """Largest force of a tap."""
        return float(self.tap_force_n.max())

    @property
    def hands(self) -> int:
        """Number of hands."""
        return len(self.stiffness_n_per_m)

    @property
    def hand_settles(self) -> BoolArray:
        """Settled in every motion, without friction and with missed steps too."""
        return np.asarray(np.all([self.stable, *self.variants.values()], axis=0))

    @property
    def all_settle(self) -> bool:
        """Whether all hands settle, without friction and with missed steps too."""
        return bool(self.hand_settles.all())

    @property
    def all_settle_with_friction(self) -> bool:
        """Whether all hands settle as declared, with missed steps too."""
        return bool(self.stable.all())

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
            **{f"stable_{name}": settled for name, settled in self.variants.items()},
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
                "settled": self.settled,
                "settled_by_motion": {name: int(runs.sum()) for name, runs in self.by_motion.items()},
                **{f"settled_{name}": int(settled.sum()) for name, settled in self.variants.items()},
                **self.circumstances(),
                "rendered_stiffness_n_per_m": self.stiffness,
                "tap_force_n": self.largest_tap_force_n,
            }
        )

    def _summary(self) -> str:
        variants = "".join(f", {int(runs.sum())} {name.replace('_', ' ')}" for name, runs in self.variants.items())
        return f"{self.settled} of {self.hands} hands settle{variants}; {short(self.stiffness_n_per_m)}"


@dataclass(frozen=True)
class HandCounts:
    """Numbers of simulated hands: of all, of those that settle, of them without dry friction, and without a buzz.

    Attributes:
        hands: number of hands.
        at_rest: hands that settle in every motion.
        at_rest_without_friction: hands that settle without dry friction too.
        quiet: hands that settle with a vibration below the vibrotactile detection threshold.
    """

    hands: int
    at_rest: int
    at_rest_without_friction: int
    quiet: int

    def __add__(self, more: HandCounts) -> HandCounts:
        return HandCounts(
            hands=self.hands + more.hands,
            at_rest=self.at_rest + more.at_rest,
            at_rest_without_friction=self.at_rest_without_friction + more.at_rest_without_friction,
            quiet=self.quiet + more.quiet,
        )

    @property
    def many_vibrate(self) -> bool:
        """Whether more than a tenth of the hands may notice a vibration at rest."""
        return self.hands - self.quiet > _MANY * self.hands


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CouplingTrial(Trial):
    """Results at a wall."""

    stable_without_friction: BoolArray
    effects: tuple[str, ...]
    vibration: FloatArray
    at_force_limit: BoolArray
    tap_depth_m: FloatArray
    wall_n_per_m: float
    devices: int = 1
    longest_s: float = TRIAL_S

    @property
    def variants(self) -> dict[Variant, BoolArray]:
        """Whether a hand settles in every motion of each trial that repeats this one."""
        return {"without_friction": self.stable_without_friction}

    @property
    def quiet(self) -> BoolArray:
        """Settled with a vibration below the vibrotactile detection threshold."""
        return np.asarray(self.stable & (self.vibration < QUIET))

    def to_dict(self) -> Columns:
        """Return the results by hand as columns, each of shape (hands,)."""
        more = ("vibration", "at_force_limit", "tap_depth_m")
        return super().to_dict() | {name: getattr(self, name) for name in more}

    def counts(self) -> HandCounts:
        """Return how many hands settle, without friction too, and below the detection threshold."""
        return HandCounts(
            hands=self.hands,
            at_rest=self.settled,
            at_rest_without_friction=int(self.stable_without_friction.sum()),
            quiet=int(self.quiet.sum()),
        )

    @property
    def share_of_wall(self) -> float | None:
        """Median rendered stiffness over that of the wall; None where the wall has none."""
        return self.stiffness / self.wall_n_per_m if self.wall_n_per_m else None

    @property
    def nine_in_ten_n_per_m(self) -> tuple[float, float]:
        """Rendered stiffnesses between which nine in ten hands lie; not numbers where no hand is in contact."""
        in_contact = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        if not len(in_contact):
            return np.nan, np.nan
        low, high = np.quantile(in_contact, _NINE_IN_TEN).tolist()
        return low, high

    @property
    def median_vibration(self) -> float:
        """Median vibration at rest, in multiples of the detection threshold."""
        return float(np.median(self.vibration))

    @property
    def saturated_presses(self) -> int:
        """Number of hands whose press ends at the force limit."""
        return int(self.at_force_limit.sum())

    @property
    def deepest_tap_m(self) -> float:
        """Largest depth of a tap."""
        return float(self.tap_depth_m.max())

    def counts_document(self) -> dict[str, int]:
        """Return the JSON values of its counts: of hands and devices."""
        return {"hands": self.hands, "devices": self.devices, **plain(self.counts())}

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        in_contact = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        return plain_table(
            {
                **self.counts_document(),
                "seed": self.seed,
                "effects": list(self.effects),
                "motions": list(self.by_motion),
                "longest_s": self.longest_s,
                "at_rest_interval": list(exact_interval(self.settled, self.hands)),
                "at_rest_by_motion": {name: int(runs.sum()) for name, runs in self.by_motion.items()},
                "felt_vibration": self.median_vibration,
                "felt_vibration_worst": float(self.vibration.max()),
                "stiffness_n_per_m": {
                    "lowest": float(in_contact.min()) if len(in_contact) else None,
                    "median": self.stiffness,
                    "highest": float(in_contact.max()) if len(in_contact) else None,
                    "nine_in_ten": self.nine_in_ten_n_per_m if len(in_contact) else None,
                },
                "at_force_limit": self.saturated_presses,
                "share_of_wall": self.share_of_wall,
                "tap_force_n": self.largest_tap_force_n,
                "tap_depth_m": self.deepest_tap_m,
                "not_simulated": ["hands that change while they hold the device", "several axes"],
            }
        )

    @classmethod
    def join(cls, parts: Sequence[CouplingTrial], order: IndexArray | slice = slice(None)) -> CouplingTrial:
        """Return the trial of all hands, in the order of the parts or another one."""
        whole: dict[str, Any] = {}
        for name in _ARRAYS:
            whole[name] = np.concatenate([getattr(part, name) for part in parts])[order]
        by_motion = {
            name: np.concatenate([part.by_motion[name] for part in parts])[order] for name in parts[0].by_motion
        }
        return replace(parts[0], by_motion=by_motion, **whole)


_ARRAYS = (
    "stiffness_n_per_m",
    "tap_force_n",
    "stable_without_friction",
    "vibration",
    "at_force_limit",
    "tap_depth_m",
)
"""Attributes of a trial at a wall that are arrays with a value for each hand."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ToolTrial(Trial):
    """Results of hands that move a virtual tool."""

    stable_without_friction: BoolArray
    stable_with_dropped_steps: BoolArray
    dropped_share: float

    @property
    def variants(self) -> dict[Variant, BoolArray]:
        """Whether a hand settles in every motion of each trial that repeats this one."""
        return {"without_friction": self.stable_without_friction, "with_dropped_steps": self.stable_with_dropped_steps}

    def circumstances(self) -> dict[str, float]:
        """Return the share of the steps that the engine misses, by the key of the document."""
        return {"dropped_share": self.dropped_share}

    @property
    def all_settle_with_friction(self) -> bool:
        """Whether all hands settle as declared, with missed steps too."""
        return bool(np.all(self.stable & self.stable_with_dropped_steps))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FollowerTrial(Trial):
    """Results of hands that move a follower over a link."""

    jitter: float
    lost_share: float

    def circumstances(self) -> dict[str, float]:
        """Return the jitter and the share of lost messages, by the key of the document."""
        return {"jitter": self.jitter, "lost_share": self.lost_share}


def try_coupling(
    coupling: Coupling,
    hands: Hand | StylusHand,
    seed: int = 0,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> CouplingTrial:
    """Simulate press, tap and hold by all hands, with all that the problem declares of the device."""
    setup = Setup.of(coupling)
    blocks = (slice(first, first + _HANDS_OF_TASK) for first in range(0, len(hands), _HANDS_OF_TASK))
    tasks = [(setup, hands.pick(block)) for block in blocks]
    sizes = [len(of_block) for _, of_block in tasks]
    work = partial(_try_motions, seed)
    return CouplingTrial.join(map_tasks(work, tasks, executor, sizes=sizes, things="hands", progress=progress))


def try_on_devices(
    coupling: Coupling,
    hands: Hand | StylusHand,
    devices: Sequence[Device],
    seed: int = 0,
    executor: Executor | None = None,
) -> CouplingTrial:
    """Simulate hands with a coupling, each on one of several devices, assigned in turn."""
    split = [np.arange(place, len(hands), len(devices)) for place in range(len(devices))]
    jobs = [
        (Setup.of(coupling, device), hands.pick(rows)) for rows, device in zip(split, devices, strict=True) if len(rows)
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
    setup, hands = task
    motions, duration_s = course_of(setup.problem)
    settings = [setup, setup.without(FRICTION)] if setup.rough else [setup]
    limit = setup.problem.device.max_force_n
    parts: dict[tuple[str, bool], list[dict[str, Any]]] = {}
    with ThreadPoolExecutor(1) as pool:  # a scene is built while another is simulated
        work = [
            ((name, variant is setup), pool.submit(_figures, name if variant is setup else "", limit, simulation))
            for variant in settings
            for name in AT_WALL
            for simulation in simulations(variant, hands, motions[name], duration_s)
        ]
        for key, future in work:
            parts.setdefault(key, []).append(future.result())

    def whole(name: str, figure: str, *, friction: bool = True) -> Any:
        return np.concatenate([part[figure] for part in parts[name, friction]])

    free = [whole(name, "stable", friction=not setup.rough) for name in AT_WALL]
    return CouplingTrial(
        seed=seed,
        by_motion={name: whole(name, "stable") for name in AT_WALL},
        stable_without_friction=np.asarray(np.all(free, axis=0)),
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
    refuse_counts(hands_count(hands, IN_BLOCKS), seed_count(seed), workers_count(workers))
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
    hands = draw_hands(setup.problem.hands, count, seed, first=first)
    motions, duration_s = course_of(setup.problem)
    scenes = (prepare(setup, hands, motions[name], duration_s) for name in AT_WALL)
    return {name: execute_to_speed(*scene) < 1 for name, scene in zip(AT_WALL, scenes, strict=True)}


def residual_speeds(
    coupling: Coupling,
    hands: Hand | StylusHand,
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
    scenes = [prepare(setup if name == "graze" else whole, hands, motions[name], duration_s) for name in names]
    for scene, *_ in scenes:
        compile_ahead(scene, len(hands))
    speeds = [execute_to_speed(*scene, workers=processors()) for scene in scenes]
    return np.asarray(np.max(speeds, axis=0))
