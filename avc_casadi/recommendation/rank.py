"""Rank candidates: by safety, vibration threshold, distance from the wall, then by the end of the force on leaving."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from avc_casadi._util.arrays import BoolArray
from avc_casadi.claims.certify import promises_rest
from avc_casadi.claims.impedance import below_quarter_rate, handle_impedance, target_impedance
from avc_casadi.coupling import Coupling
from avc_casadi.loops.margins import transients
from avc_casadi.loops.wall import law_at_rest
from avc_casadi.recommendation.reasons import (
    Flaw,
    FlawKind,
    NearerCandidate,
    NearestToWall,
    NoneSettles,
    Reason,
)
from avc_casadi.recommendation.rendered import NOTICED_LATE_S, frequency_sweep, leaving_contact, rebound
from avc_casadi.simulation.population.trial import CouplingTrial

SWEEP_HZ = np.geomspace(1.0, 30.0, 40)
"""Frequencies of the ranking's impedance error: 40 from 1 to 30 Hz (the design uses 12)."""
NOTICED_ERROR = 0.1
"""Impedance error that counts as noticed: stricter than the 23 % for stiffness of Jones and Hunter (Exp. Brain Res. 79,
1990)."""
# Settling time after release below which no difference is noticed; twice as long counts as an error of 0.35, and
# stiffness at rest as a fifth of the same share in motion.
_AT_ONCE_S = 0.5
_PER_SETTLING = 0.5
_PER_SOFTER = 0.2
_LEAST_SHARE = 1e-9  # of the wall's stiffness: a coupling of none counts as one of this share
# Stiffnesses within this share are equal.
_AS_STIFF = 0.01
# A press that ends below this share of the static stiffness counts instead of it.
_SLOW = 0.95
UNNOTICED = 0.2
"""Largest impedance error of a convincing wall: below the 23 % of stiffness that hands notice (see `NOTICED_ERROR`)."""
MOVING_HZ = (1.0, 3.0, 10.0)
"""Motion of a hand, slow and as fast as it goes."""
# Share of the hands below the vibration threshold that suffices: a stiff wall is kept despite a few light hands.
BELOW_THRESHOLD_SHARE = 0.9


class Safety(IntEnum):
    """Whether all hands settle; the safest first."""

    ALWAYS = 0
    """Without dry friction and with it."""
    BY_FRICTION = 1
    """With the declared dry friction alone."""
    NOT_ALL = 2
    """Not all of them."""


@dataclass(frozen=True)
class Candidate:
    """A deployable coupling and its trials, those beyond the problem too; the order is that of proposal."""

    coupling: Coupling
    trial: CouplingTrial
    order: int
    others: CouplingTrial | None = None
    beyond: tuple[BoolArray, ...] = ()  # first the corner hands that strike the wall; empty where not tried

    @cached_property
    def safety(self) -> Safety:
        """Whether all hands settle, and whether they need dry friction for it."""
        everybody = all(bool(trial.stable.all()) for trial in self.trials) and self.withstands
        if everybody and all(bool(trial.stable_without_friction.all()) for trial in self.trials):
            return Safety.ALWAYS
        return Safety.BY_FRICTION if everybody else Safety.NOT_ALL

    @property
    def withstands(self) -> bool:
        """Whether all hands settle in every trial of `beyond`.

        They are strikes, then loose grips, perturbed devices or unmodelled effects.
        """
        return all(bool(rests.all()) for rests in self.beyond)

    @property
    def trials(self) -> tuple[CouplingTrial, ...]:
        """All its trials."""
        return (self.trial,) if self.others is None else (self.trial, self.others)

    @property
    def at_rest(self) -> float:
        """Share of the hands that settle."""
        rests = [*(trial.stable for trial in self.trials), *self.beyond]
        return float(np.concatenate(rests).mean())

    @property
    def quiet_hands(self) -> tuple[int, int]:
        """How many hands stay below the vibrotactile detection threshold, also within the ranges, and of how many."""
        below = sum(int(trial.quiet.sum()) for trial in self.trials)
        return below, sum(trial.hands for trial in self.trials)

    @property
    def quiet(self) -> bool:
        """Whether nearly all hands stay below that threshold."""
        below, hands = self.quiet_hands
        return below >= BELOW_THRESHOLD_SHARE * hands

    @property
    def rendered_n_per_m(self) -> float:
        """Rendered stiffness: static, or at the end of a press where a slow observer is still far from it."""
        at_rest, pressed = self.coupling.static_stiffness_n_per_m, self.trial.stiffness
        return pressed if pressed < _SLOW * at_rest else at_rest

    @cached_property
    def error(self) -> float:
        """Largest impedance error from 1 to 30 Hz."""
        return impedance_error(self.coupling)

    @cached_property
    def distance(self) -> float:
        """Distance from the wall: of impedance or rebound, with prices on settling time and softness at rest."""
        wall_n_per_m = self.coupling.wall.stiffness_n_per_m
        released, _ = transients(self.coupling)
        share = self.coupling.static_stiffness_n_per_m / wall_n_per_m if wall_n_per_m > 0 else 1.0
        slow = math.log(max(released.settling_s, _AT_ONCE_S) / _AT_ONCE_S)
        soft = max(0.0, -math.log(max(share, _LEAST_SHARE)))
        return max(self.error, self.rebound_excess, NOTICED_ERROR) + _PER_SETTLING * slow + _PER_SOFTER * soft

    @cached_property
    def rebound_excess(self) -> float:
        """By how much a light touch comes back faster than it came, over the speed of arrival.

        At 0 or less it does not rebound faster.
        """
        return max(rebound(self.coupling, at_face=True).values()) - 1

    @cached_property
    def pushes_outside_s(self) -> float:
        """How long it still pushes a hand that withdraws, after that has left the wall."""
        return leaving_contact(self.coupling).lasting_s

    @cached_property
    def promises_rest(self) -> bool:
        """Whether a proof of L7 is likely."""
        return promises_rest(self.coupling)

    def flaw(self, required: Safety) -> Flaw | None:
        """Return why it is not acceptable: less safe than required, or hands feel it vibrate; None where it is."""
        quiet, hands = self.quiet_hands
        if self.safety > required:
            by_friction = self.safety is Safety.BY_FRICTION
            return Flaw(FlawKind.BY_FRICTION_ALONE if by_friction else FlawKind.UNSETTLED, quiet, hands)
        return None if self.quiet else Flaw(FlawKind.VIBRATES, quiet, hands)


def impedance_error(coupling: Coupling) -> float:
    """Return the largest error of the impedance at the handle from 1 to 30 Hz, of small motions in contact."""
    problem = coupling.problem
    hz = below_quarter_rate(problem.device, SWEEP_HZ)
    z = np.exp(2j * np.pi * hz * problem.device.sample_time_s)
    force = law_at_rest(coupling).transfer(z)
    wanted, size = target_impedance(problem, hz)
    return float((np.abs(handle_impedance(problem.device, force, hz)[0] - wanted) / size).max())


def error_in_motion(coupling: Coupling) -> float:
    """Return the largest impedance error to a handle moved at 1 to 10 Hz, encoder and dead zone counted.

    Not a number where the coupling diverges behind a motion that is imposed, which no hand of [hands] does.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return float(frequency_sweep(coupling, coupling.static_stiffness_n_per_m, MOVING_HZ).error.max())


def best_of(candidates: list[Candidate], *, lean_on_friction: bool = False) -> Candidate:
    """Return the best: by safety, vibration threshold and distance; of those as near the plainest without a late push.

    Safety says with how many hands, and whether only by friction, it settles; `lean_on_friction` counts the latter as
    safe. Quieter and stiffer ones, and those likely to have a proof of rest, come first.
    """

    def safety(candidate: Candidate) -> Safety:
        return max(candidate.safety, Safety.BY_FRICTION) if lean_on_friction else candidate.safety

    safest = min(safety(candidate) for candidate in candidates)
    left = [candidate for candidate in candidates if safety(candidate) == safest]
    if safest is Safety.NOT_ALL:
        most = max(candidate.at_rest for candidate in left)
        left = [candidate for candidate in left if candidate.at_rest == most]
    left = [candidate for candidate in left if candidate.quiet] or left
    nearest = min(left, key=lambda candidate: candidate.distance)
    as_near = [candidate for candidate in left if _is_as_near(candidate, nearest)]
    leaving = _without_late_push(as_near)
    quiet = max(int(candidate.trial.quiet.sum()) for candidate in leaving)
    quietest = [candidate for candidate in leaving if int(candidate.trial.quiet.sum()) == quiet]
    left = quietest
    if len(quietest) > 1:
        # Those for which a proof of L7 is likely, or all if there are none.
        left = [candidate for candidate in quietest if candidate.promises_rest] or quietest
    least_n_per_m = (1 - _AS_STIFF) * max(candidate.rendered_n_per_m for candidate in left)
    return min((candidate for candidate in left if candidate.rendered_n_per_m >= least_n_per_m), key=_plainness)


def _is_as_near(candidate: Candidate, nearest: Candidate) -> bool:
    """Return whether no difference to the nearest is noticed: of the distance, nor of the impedance error alone.

    A price on settling time may make distances alike whose impedance errors are not.
    """
    return candidate.distance <= nearest.distance + NOTICED_ERROR and candidate.error <= nearest.error + NOTICED_ERROR


def _without_late_push(candidates: list[Candidate]) -> list[Candidate]:
    """Return those that push a withdrawing hand outside the wall for no time that is noticed, or for the least time.

    All of them are as near to the wall: what they do inside differs by less than a hand notices.
    """
    if len(candidates) == 1:
        return candidates
    least_s = min(candidate.pushes_outside_s for candidate in candidates)
    longest_s = max(NOTICED_LATE_S, (1 + NOTICED_ERROR) * least_s)
    return [candidate for candidate in candidates if candidate.pushes_outside_s <= longest_s]


def _plainness(candidate: Candidate) -> tuple[float, ...]:
    """Return what orders candidates that are equally near: a law after all others, of laws the nearest first."""
    if candidate.coupling.runtime.state_feedback is not None:
        return 1.0, candidate.distance + candidate.error
    return 0.0, candidate.order


def why_best(best: Candidate, candidates: list[Candidate]) -> Reason:
    """Return why this coupling is recommended, and which nearer one is not as safe or as quiet."""
    if best.safety is Safety.NOT_ALL:
        return NoneSettles(len(candidates))
    rank = best.safety, not best.quiet
    worse = [candidate for candidate in candidates if (candidate.safety, not candidate.quiet) > rank]
    nearer = min(worse, key=lambda candidate: (candidate.safety, candidate.error), default=best)
    rejected = None
    if nearer.error <= best.error - NOTICED_ERROR:
        rejected = NearerCandidate(nearer.coupling.method, nearer.error, best.error, nearer.flaw(best.safety))
    return NearestToWall(len(candidates), by_friction=best.safety is Safety.BY_FRICTION, nearer=rejected)
