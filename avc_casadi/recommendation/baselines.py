"""Baseline control laws on the same device with the same hands: velocity estimators, passivity controllers.

A wall F = K x + B v is rendered directly, with the velocity of each estimator (`VELOCITY_ESTIMATORS`), with the time
domain passivity controller (Hannaford and Ryu 2002), and through the coupling of the method static, which Llewellyn's
criterion keeps passive (Adams and Hannaford 1999). All are simulated with the declared device.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import AvcError
from avc_casadi._util.parallel import SharedTasks
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.stability.stiffest_wall import damping_range
from avc_casadi.coupling import Coupling
from avc_casadi.design.methods import solve
from avc_casadi.model.gains import NO_COUPLING, Gains, GainTable, near_rigid_n_per_m
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.runtime import GUARD_METHODS, Runtime
from avc_casadi.model.velocity import VELOCITY_ESTIMATORS
from avc_casadi.model.velocity_keys import VelocityFilterEffect
from avc_casadi.recommendation.generate import static_stiffness_n_per_m
from avc_casadi.recommendation.ripple import SPEEDS_M_PER_S, ripple_n
from avc_casadi.recommendation.screening import BEYOND_HANDS, Group, required
from avc_casadi.recommendation.shaken import shaken
from avc_casadi.simulation.population.operators import people_of

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect
    from avc_casadi.model.problem import Problem

DIFFERENCE, GUARDED, PASSIVE = "backward difference", "passivity controller", "static"
"""Baseline laws other than the velocity estimators."""
# Cut-offs of the low pass over the sample rate, and hand accelerations, m/s2, for the estimators that need one.
_CUTOFFS, _ACCELERATIONS_M_PER_S2 = (0.03, 0.1, 0.3), (10.0, 100.0)
# Damping of a wall in the interval that is linearly stable with the backward difference.
_SHARES = (0.5, 0.1, 0.02)
# A wall's stiffness is halved until the law stabilises it, then bisected upwards.
_SOFTER, _BACK = 8, 2
# Number of hands (corners of [hands]) in the search.
_SEARCH = 32


@dataclass(frozen=True)
class Baseline:
    """A baseline law at the stiffest wall with which all hands settle in every motion without dry friction.

    Attributes:
        law: a velocity estimator, `DIFFERENCE`, `GUARDED` or `PASSIVE`.
        settings: keys of the estimator, the variant that stabilises the stiffest wall.
        stiffness_n_per_m: static, of that wall; 0 where none is stable.
        damping_ns_per_m: of that wall, or of the coupling.
        error: |Z_h - Z|/|Z| for the wanted wall, by frequency; without the controller of `GUARDED`, which
            does not act on a prescribed motion.
        ripple_n: rms of the force on a handle that moves at 20 mm/s.
        settled: how many of the hands settle with that wall.
        settled_at_wall: how many settle with the wanted wall, at the best of the same dampings.
        hands: how many were simulated: of [hands], of the declared grip, and of [robustness].
    """

    law: str
    settings: dict[str, Any]
    stiffness_n_per_m: float
    damping_ns_per_m: float
    error: dict[str, float]
    ripple_n: float | None
    settled: int
    settled_at_wall: int
    hands: int

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


def baselines(
    problem: Problem, hands: int = 100, seed: int = 0, *, workers: int = 1, progress: Progress = SILENT
) -> list[Baseline]:
    """Return the stiffest wall that each baseline law stabilises on one device.

    Args:
        problem: device, wall and hands; no [simulation] and no [follower].
        hands: number simulated; the search uses the corners of [hands].
        seed: of their draw.
        workers: processes, as for `recommend`.
        progress: reports the laws.
    """
    tasks: list[Callable[[], Baseline | None]] = [partial(_passive, problem, hands, seed)]
    laws = [*_estimators(problem.device), (GUARDED, None)]
    tasks += [partial(_stiffest, problem, law, table, hands, seed) for law, table in laws]
    found: dict[str, Baseline] = {}
    with SharedTasks(workers) as crew:
        for done, one in enumerate(crew.each(tasks), 1):
            if one is not None:
                before = found.get(one.law)
                if before is None or one.stiffness_n_per_m > before.stiffness_n_per_m:
                    found[one.law] = one
            progress.advance(done, len(tasks), "laws")
    order = [DIFFERENCE, *VELOCITY_ESTIMATORS, GUARDED, PASSIVE]
    return sorted(found.values(), key=lambda one: order.index(one.law))


def _stiffest(problem: Problem, law: str, table: VelocityFilterEffect | None, hands: int, seed: int) -> Baseline:
    return _Law(problem, law, table, hands, seed).stiffest()


def _estimators(device: Device) -> Iterator[tuple[str, VelocityFilterEffect | None]]:
    yield DIFFERENCE, None
    for cutoff in _CUTOFFS:
        yield "first-order", VelocityFilterEffect(cutoff_hz=cutoff / device.sample_time_s)
    # The other estimators assume an encoder resolution; it is fixed here so that an ideal encoder gets the same tuning.
    step = device.encoder_resolution_m
    own: dict[str, Any] = {"noise_rms_m": step / math.sqrt(12), "band_m": step}
    for name, estimator in VELOCITY_ESTIMATORS.items() if step > 0 else ():
        fixed: dict[str, Any] = {key: own[key] for key in own if key in estimator.keys}
        if "acceleration_m_per_s2" in estimator.keys:
            for acceleration in _ACCELERATIONS_M_PER_S2:
                rate = acceleration / device.metres_per_unit
                yield name, VelocityFilterEffect(estimator=name, acceleration_m_per_s2=rate, **fixed)
        elif not estimator.required:
            yield name, VelocityFilterEffect(estimator=name, **fixed)


class _Law:
    """A law that renders walls directly, with the hands of its trials."""

    def __init__(self, problem: Problem, law: str, table: VelocityFilterEffect | None, hands: int, seed: int) -> None:
        self._problem, self._law = problem, law
        self._effects: tuple[Effect, ...] = () if table is None else (table,)
        self._runtime = Runtime(guard=GUARD_METHODS[0]) if law == GUARDED else Runtime()
        self._settings = {} if table is None else table.model_dump(exclude_none=True, exclude={"kind", "estimator"})
        self._everybody = _everybody(problem, hands, BEYOND_HANDS, seed)
        self._first = _everybody(problem, min(_SEARCH, hands), _SEARCH, seed)
        self._extreme = with_released(hand_corners(problem.hands))

    def stiffest(self) -> Baseline:
        """Return the stiffest stable wall: halved until one is stable, then bisected."""
        wall = self._problem.environment.stiffness_n_per_m
        low, high, held = wall, math.inf, self._held(wall)
        for _ in range(_SOFTER):
            if held is not None:
                break
            low, high = low / 2, low
            held = self._held(low)
        if held is not None and high < math.inf:
            for _ in range(_BACK):
                middle = math.sqrt(low * high)
                better = self._held(middle)
                low, high, held = (low, middle, held) if better is None else (middle, high, better)
        everybody, hands = self._everybody, _count(self._everybody)
        at_wall = max(self._settled(one, everybody) for one in self._walls(wall))
        if held is None:
            return Baseline(self._law, self._settings, 0.0, 0.0, {}, None, 0, at_wall, hands)
        error = shaken(held, low, effects=self._effects, wanted=self._problem).errors()
        noise = ripple_n(held, SPEEDS_M_PER_S[0] / self._problem.device.metres_per_unit, self._effects)
        settled = self._settled(held, everybody)
        damping = held.table.at_rest.contact_damping_ns_per_m
        return Baseline(self._law, self._settings, low, damping, error, noise, settled, at_wall, hands)

    def _held(self, stiffness_n_per_m: float) -> Coupling | None:
        """Return the least damped wall of a stiffness with which the search hands settle."""
        walls = self._walls(stiffness_n_per_m)
        return next((one for one in walls if self._settled(one, self._first) == _count(self._first)), None)

    def _walls(self, stiffness_n_per_m: float) -> list[Coupling]:
        """Return a wall at several dampings, least first; at its own where none is stable with the difference."""
        device = self._problem.device
        stable = damping_range(device, self._extreme, stiffness_n_per_m)
        low, high = stable.lowest_ns_per_m, stable.highest_ns_per_m
        dampings = {self._problem.environment.damping_ns_per_m}
        dampings |= set() if math.isnan(low) else {low + share * (high - low) for share in _SHARES}
        wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": stiffness_n_per_m}
        softer, rigid = self._problem.changed(environment=wall), near_rigid_n_per_m(device)
        found: list[Coupling] = []
        for damping in sorted(dampings):
            # No coupling deflects before the wall, and the wall's damper is a parameter of the scene.
            table = GainTable.constant_gains(replace(NO_COUPLING, contact_damping_ns_per_m=damping))
            gains = Gains(0.0, rigid, damping)
            found.append(replace(Coupling.constant(softer, gains, "none", self._runtime), table=table))
        return found

    def _settled(self, wall: Coupling, groups: tuple[Group, ...]) -> int:
        return _settled([replace(one, effects=(*one.effects, *self._effects)) for one in groups], wall)


def _passive(problem: Problem, hands: int, seed: int) -> Baseline | None:
    """Return the static coupling; None where the method has none."""
    try:
        coupling = Coupling.of(problem, solve(problem, "static"))
    except AvcError:
        return None
    rendered = static_stiffness_n_per_m(coupling)
    everybody = _everybody(problem, hands, BEYOND_HANDS, seed)
    settled = _settled(everybody, coupling)
    error = shaken(coupling, rendered).errors()
    noise = ripple_n(coupling, SPEEDS_M_PER_S[0] / problem.device.metres_per_unit)
    damping = coupling.table.at_rest.damping_ns_per_m
    return Baseline(PASSIVE, {}, rendered, damping, error, noise, settled, settled, _count(everybody))


def _everybody(problem: Problem, hands: int, others: int, seed: int) -> tuple[Group, ...]:
    """Return the hands with which a recommendation must settle."""
    return (Group(people_of(problem.hands, hands, seed)), *required(problem, others, seed))


def _count(groups: Iterable[Group]) -> int:
    return sum(len(one.people) for one in groups)


def _settled(groups: Iterable[Group], coupling: Coupling) -> int:
    return sum(int((one.residual_speeds([coupling], friction=False)[0] < 1).sum()) for one in groups)
