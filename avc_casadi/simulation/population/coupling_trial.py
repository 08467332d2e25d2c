"""Trial of a coupling in the scene of all declared device effects: many hands, three motions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.parallel import mapped
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.simulation.population.motions import MOTIONS, QUIET, TRIAL_S, course_of
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.population.trial import Conditions, Traces, on_device, simulations

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand, StylusHand

# Results of one motion, each of shape (hands,).
_Figures: TypeAlias = dict[str, Any]
# A press that ends above this share of the largest force is saturated: its stiffness is not the wall's.
_NEAR_LIMIT = 0.97
# Hands of one task of an executor.
_AT_ONCE = 1000
# Covered neither by [device] nor by a scene.
NOT_SIMULATED = ("hands that change while they hold on", "several axes")


@dataclass(frozen=True, eq=False, repr=False)
class CouplingTrial(Tabular):
    """Results by simulated hand; every array has shape (hands,)."""

    seed: int
    effects: tuple[str, ...]
    stable: BoolArray
    stable_without_friction: BoolArray
    by_motion: dict[str, BoolArray]
    vibration: FloatArray
    stiffness_n_per_m: FloatArray
    at_force_limit: BoolArray
    tap_force_n: FloatArray
    tap_depth_m: FloatArray
    wall_n_per_m: float
    devices: int = 1
    longest_s: float = TRIAL_S

    @property
    def hands(self) -> int:
        """Number of hands."""
        return len(self.stable)

    @property
    def quiet(self) -> BoolArray:
        """Settled with a vibration below the vibrotactile detection threshold."""
        quiet: BoolArray = self.stable & (self.vibration < QUIET)
        return quiet

    @property
    def stiffness(self) -> float:
        """Median rendered stiffness; not a number where no hand is in contact."""
        felt = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        return float(np.median(felt)) if len(felt) else np.nan

    def to_dict(self) -> Columns:
        """Return the results by hand as columns, each of shape (hands,)."""
        return {
            "hand": np.arange(self.hands),
            "stable": self.stable,
            "stable_without_friction": self.stable_without_friction,
            "vibration": self.vibration,
            "stiffness_n_per_m": self.stiffness_n_per_m,
            "at_force_limit": self.at_force_limit,
            "tap_force_n": self.tap_force_n,
            "tap_depth_m": self.tap_depth_m,
        }

    def _summary(self) -> str:
        return (
            f"{int(self.stable.sum())} of {self.hands} hands settle, {int(self.stable_without_friction.sum())} without "
            f"friction; {short(self.stiffness_n_per_m)} felt"
        )

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
        low, high = exact_interval(int(self.stable.sum()), self.hands)
        felt = self.stiffness_n_per_m[np.isfinite(self.stiffness_n_per_m)]
        document: dict[str, Any] = plain(
            {
                **self.counts(),
                "seed": self.seed,
                "effects": list(self.effects),
                "motions": list(self.by_motion),
                "longest_s": self.longest_s,
                "at_rest_interval": [low, high],
                "at_rest_by_motion": {name: int(runs.sum()) for name, runs in self.by_motion.items()},
                "felt_vibration": float(np.median(self.vibration)),
                "felt_vibration_worst": float(self.vibration.max()),
                "stiffness_n_per_m": {
                    "lowest": float(felt.min()) if len(felt) else None,
                    "median": self.stiffness,
                    "highest": float(felt.max()) if len(felt) else None,
                    "nine_in_ten": np.quantile(felt, (0.05, 0.95)).tolist() if len(felt) else None,
                },
                "at_force_limit": int(self.at_force_limit.sum()),
                "share_of_wall": self.stiffness / self.wall_n_per_m if self.wall_n_per_m else None,
                "tap_force_n": float(self.tap_force_n.max()),
                "tap_depth_m": float(self.tap_depth_m.max()),
                "not_simulated": list(NOT_SIMULATED),
            }
        )
        return document


_ARRAYS = tuple(item.name for item in fields(CouplingTrial) if item.type in {"BoolArray", "FloatArray"})


def try_coupling(
    coupling: Coupling,
    subjects: Hand | StylusHand,
    seed: int = 0,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> CouplingTrial:
    """Simulate press, tap and hold by all hands, with all that the problem declares of the device."""
    conditions = Conditions.of(coupling)
    if executor is None:
        return _tried(coupling, conditions, subjects, seed, progress)
    some = [subjects.pick(slice(first, first + _AT_ONCE)) for first in range(0, len(subjects), _AT_ONCE)]
    work = partial(_tried, replace(coupling, certificate=None, trial=None), conditions, seed=seed)
    sizes = [len(people) for people in some]
    return _joined(mapped(work, some, executor, sizes=sizes, things="people", progress=progress))


def _joined(parts: list[CouplingTrial]) -> CouplingTrial:
    """Return the trial of all hands, in the order of the parts."""
    whole: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    by_motion = {name: np.concatenate([part.by_motion[name] for part in parts]) for name in MOTIONS}
    return replace(parts[0], **whole, by_motion=by_motion)


def _tried(
    coupling: Coupling,
    conditions: Conditions,
    subjects: Hand | StylusHand,
    seed: int = 0,
    progress: Progress = SILENT,
) -> CouplingTrial:
    found: dict[tuple[str, bool], list[_Figures]] = {}
    simulated = _simulations(coupling, subjects, conditions)
    with ThreadPoolExecutor(1) as pool:  # a scene is built while another is simulated
        for key, part in [(key, pool.submit(one)) for key, one in simulated]:
            found.setdefault(key, []).append(part.result())
            if key[1]:
                progress.advance(len(found), len(MOTIONS), f"motions, {key[0]} the last")

    def whole(name: str, figure: str, *, as_declared: bool = True) -> Any:
        return np.concatenate([part[figure] for part in found[name, as_declared]])

    by_motion = {name: whole(name, "stable") for name in MOTIONS}
    free = [whole(name, "stable", as_declared=(name, False) not in found) for name in MOTIONS]
    return CouplingTrial(
        seed=seed,
        effects=tuple(effect.kind for effect in conditions.effects()),
        stable=np.asarray(np.all(list(by_motion.values()), axis=0)),
        stable_without_friction=np.asarray(np.all(free, axis=0)),
        by_motion=by_motion,
        **{figure: whole("press", figure) for figure in ("vibration", "stiffness_n_per_m", "at_force_limit")},
        **{figure: whole("tap", figure) for figure in ("tap_force_n", "tap_depth_m")},
        wall_n_per_m=coupling.wall.stiffness_n_per_m,
        longest_s=course_of(coupling.problem).longest_s,
    )


def _simulations(
    coupling: Coupling, subjects: Hand | StylusHand, conditions: Conditions
) -> Iterator[tuple[tuple[str, bool], Callable[[], _Figures]]]:
    """Prepare every motion as declared, then without dry friction where some is declared."""
    chosen = coupling.table.at_rest if coupling.table.constant else coupling.table
    limit = np.inf if coupling.max_force_n is None else coupling.max_force_n
    settings = {True: conditions} | ({False: conditions.without_friction()} if conditions.friction_n else {})
    for as_declared, setting in settings.items():
        for name, (motion, duration_s) in course_of(coupling.problem).motions.items():
            judged = partial(_figures, name if as_declared else None, limit)
            for one in simulations(coupling.problem, chosen, subjects, motion, setting, duration_s):
                yield (name, as_declared), partial(_fared, judged, one)


def _fared(judged: Callable[[Traces], _Figures], one: Callable[[], Traces]) -> _Figures:
    return judged(one())


def _figures(name: str | None, limit_n: float, part: Traces) -> _Figures:
    """Return the results of a motion; None is one of which only settling counts."""
    found = part.judged()
    figures: _Figures = {"stable": found.stable}
    if name == "press":
        limited = np.abs(found.mean_force_n) > _NEAR_LIMIT * limit_n
        figures["at_force_limit"] = limited
        figures["stiffness_n_per_m"] = np.where(limited, np.nan, found.apparent_stiffness_n_per_m)
        figures["vibration"] = part.vibration
    if name == "tap":
        figures["tap_force_n"] = np.abs(part.force_n).max(axis=-1)
        figures["tap_depth_m"] = part.depth_m.max(axis=-1)
    return figures


def try_on_devices(
    coupling: Coupling,
    subjects: Hand | StylusHand,
    devices: Sequence[Device],
    seed: int = 0,
    executor: Executor | None = None,
) -> CouplingTrial:
    """Simulate hands with a coupling, each on one of several devices, assigned in turn."""
    dealt = [np.arange(place, len(subjects), len(devices)) for place in range(len(devices))]
    met = [
        (subjects.pick(rows), *on_device(coupling, device))
        for rows, device in zip(dealt, devices, strict=True)
        if len(rows)
    ]
    trials = mapped(partial(_tried_on, seed), met, executor)
    order = np.argsort(np.concatenate(dealt), kind="stable")
    whole = _joined(trials)
    return replace(
        whole,
        **{name: getattr(whole, name)[order] for name in _ARRAYS},
        effects=tuple(dict.fromkeys(effect for one in trials for effect in one.effects)),
        by_motion={name: rest[order] for name, rest in whole.by_motion.items()},
        devices=len(trials),
        longest_s=max(one.longest_s for one in trials),
    )


def _tried_on(seed: int, met: tuple[Hand | StylusHand, Coupling, Conditions]) -> CouplingTrial:
    subjects, coupling, conditions = met
    return _tried(coupling, conditions, subjects, seed)
