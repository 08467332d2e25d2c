"""The spectral radius of a loop with state feedback over hands, devices and sector gains of the dead zone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.claims.certificate import LevelResult
from avc_casadi.claims.levels import Rows, level_result
from avc_casadi.loops.loop import Body
from avc_casadi.loops.ranges import hand_boxes, worst_held
from avc_casadi.loops.spectrum import largest_eigenvalue, largest_radius, leading_radii
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES, RADIUS_TOLERANCE, Laws, frozen_rendering, observed_wall
from avc_casadi.model.corners import LINEAR_KEYS, device_ranges, device_set
from avc_casadi.model.hands import Hand, hand_ranges, hand_set, hand_text, no_hand
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.coupling import Coupling
    from avc_casadi.loops.ranges import Ranges
    from avc_casadi.loops.wall import Rendering
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.model.sampled_plant import SampledPlant


DRAWS = 24
# Sector gains from 1 to nearly 0, where the hand alone decides.
_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.16, 0.12, 0.09, 0.06, 0.04, 0.025, 0.01)
# Number of initial guesses (hands and sector gains); initial step of the pattern search as a share of each range, its
# reduction, and the number of reductions.
_STARTS, _REACH, _SHRINK, _ROUNDS = 3, 0.25, 0.6, 12


@dataclass(frozen=True)
class Worst:
    """The least damped loop found by a search."""

    radius: float
    share: float
    device: Device
    hand: dict[str, float]


@dataclass(frozen=True)
class FeedbackRadius:
    """Spectral radii of the loop of a coupling with state feedback."""

    devices: list[Device]
    hands: int
    held: Worst
    any_share: Worst
    free: Worst


def feedback_radius(coupling: Coupling, draws: int = DRAWS, seed: int = 0) -> FeedbackRadius:
    """Return the worst spectral radii of a coupling with state feedback, over the ranges of hands and device.

    A pattern search starts at the worst of the initial hands and sector gains, as maxima lie between them. A search,
    not a proof.
    """
    law, problem = coupling.runtime.state_feedback, coupling.problem
    if law is None:
        raise ValueError("the coupling has no state feedback")
    if not coupling.table.constant:
        raise UnsupportedError("state feedback is judged before constant gains only; make the gains constant")
    looked_at = _looked_at(problem.device, problem.hands, draws, seed)
    devices, hands = looked_at.devices, looked_at.hands
    rendering = frozen_rendering(problem, *vars(coupling.table.at_rest).values())
    loop = _Loop(law, rendering, hand_ranges(problem.hands))
    held = np.stack([loop.leading(looked_at.held, share) for share in _SHARES])
    held = held.reshape(len(_SHARES), len(devices), len(hands))
    free = largest_radius(observed_wall(looked_at.free, Laws.of(law), rendering)[0])[0]
    alone = int(free.argmax())
    whole = loop.worst(devices, hands, held[:1], (1.0,))
    # A sector gain of 1 is among these too, and their search may end in another maximum.
    any_share = max(whole, loop.worst(devices, hands, held, _SHARES), key=_radius_of)
    released = Worst(float(free[alone]), 1.0, devices[alone], no_hand().values(0))
    known = max(whole, any_share, released, key=_radius_of)
    if device_ranges(problem.device, LINEAR_KEYS) and known.radius < 1 - RADIUS_TOLERANCE:
        boxes = hand_boxes(problem)
        whole = max(whole, loop.worst_inside(problem.device, boxes[0], (1.0, 1.0)), key=_radius_of)
        inside = loop.worst_inside(problem.device, boxes[0], (min(_SHARES), 1.0))
        any_share = max(any_share, whole, inside, key=_radius_of)
        released = max(released, loop.worst_inside(problem.device, boxes[-1], (1.0, 1.0)), key=_radius_of)
    return FeedbackRadius(devices, len(hands), whole, any_share, released)


def _radius_of(worst: Worst) -> float:
    return worst.radius


@dataclass(frozen=True)
class _LookedAt:
    """Devices, hands, and the plants of each device: with every hand, devices first, and released."""

    devices: list[Device]
    hands: Hand
    held: Body
    free: Body


@lru_cache(maxsize=4)
def _looked_at(device: Device, hands: Hands, draws: int, seed: int) -> _LookedAt:
    """Collect devices, hands and plants; cached, as many laws are judged with the same."""
    devices = device_set(device, LINEAR_KEYS, seed=seed)
    if max(one.delay_samples for one in devices) > MAX_DELAY_SAMPLES:
        raise UnsupportedError(f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay")
    some = hand_set(hands, draws=draws, seed=seed)
    held, free = (Body.of(sampled_plant(devices, who)).flat() for who in (some, no_hand()))
    return _LookedAt(devices, some, held, free)


@dataclass(frozen=True)
class _Loop:
    law: StateFeedback
    rendering: Rendering
    ranges: FloatArray

    def leading(self, plants: Body, share: float) -> FloatArray:
        """Return the radius with each plant at a sector gain, minus infinity where it is not among the largest."""
        loops = observed_wall(plants, Laws.of(self.law), self.rendering, (share,))[0]
        return np.asarray(leading_radii(loops, _STARTS)[0])

    def radius(self, device: Device, hands: Hand, shares: tuple[float, ...] | FloatArray) -> FloatArray:
        """Return the radius at each sector gain with each hand, shape (shares, hands)."""
        plants = Body.of(sampled_plant(device, hands)).flat()
        return largest_radius(observed_wall(plants, Laws.of(self.law), self.rendering, shares)[0])

    def worst(self, devices: list[Device], hands: Hand, known: FloatArray, shares: tuple[float, ...]) -> Worst:
        """Search from the worst of known radii, shape (shares, devices, hands); the result is no smaller than these."""
        starts = np.argsort(-known, axis=None, kind="stable")[:_STARTS]
        found = []
        for share, device, hand in zip(*np.unravel_index(starts, known.shape), strict=True):
            values = tuple(hands.values(int(hand)).values())
            found.append(self._climb(devices[int(device)], np.array(values), shares[int(share)], min(shares)))
        return max(found, key=lambda one: one.radius)

    def worst_inside(self, device: Device, hand: Ranges, share: tuple[float, float]) -> Worst:
        """Search the ranges of a hand, the device and the sector gain."""

        def leading(plant: SampledPlant, values: Mapping[str, FloatArray]) -> ComplexArray:
            # The loop is affine in the sector gain.
            none, all_ = observed_wall(Body.of(plant).flat(), Laws.of(self.law), self.rendering, (0.0, 1.0))[0]
            return largest_eigenvalue(none + values["share"][:, None, None] * (all_ - none))

        value, held, found, values = worst_held(device, hand, leading, share=share)
        return Worst(abs(value), float(values["share"][0]), found, held)

    def _climb(self, device: Device, values: FloatArray, share: float, least: float) -> Worst:
        """Run the pattern search from a hand and a sector gain."""
        low, high = self.ranges.T
        best, reach = -np.inf, _REACH
        for _ in range(_ROUNDS):
            steps = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
            near = np.unique(np.clip(values + reach * steps * (high - low), low, high), axis=0)
            passed = np.unique(np.clip(share * (1 + reach * np.array([-1.0, 0.0, 1.0])), least, 1.0))
            radius = self.radius(device, Hand(*near.T), passed)
            row, column = np.unravel_index(int(radius.argmax()), radius.shape)
            if radius[row, column] > best:
                best, share, values = float(radius[row, column]), float(passed[row]), near[column]
            reach *= _SHRINK
        return Worst(best, share, device, Hand(*values).values(0))


def feedback_level(found: FeedbackRadius, rows: Rows) -> LevelResult:
    """Judge L5 on the loop of a coupling with state feedback."""
    worst, one = found.any_share, np.ones(len(rows.b))
    claim = (
        f"the loop with observer and state feedback is linearly stable, with no friction, with the worst hand that a "
        f"search from {found.hands} of [hands] found, whatever share of the innovation passes the dead zone"
    )
    if worst.radius >= 1 - RADIUS_TOLERANCE:
        who = hand_text(worst.hand)
        claim = f"Not met: spectral radius {worst.radius:.6g} with {who} and {worst.share:.3g} of the innovation"
    passed = np.full(len(rows.b), worst.radius < 1 - RADIUS_TOLERANCE)
    result = level_result(
        rows, "L5", "sampled-data", claim, passed, (1 - worst.radius) * one, 0 * one, RADIUS_TOLERANCE * one
    )
    detail = {
        "spectral_radius": worst.radius,
        "released_spectral_radius": found.free.radius,
        "released_pass": found.free.radius < 1 - RADIUS_TOLERANCE,
        "hands": found.hands,
        "worst_hand": worst.hand,
        "worst_share": worst.share,
    }
    return LevelResult(**{**vars(result), "claim": claim, "margin_ns_per_m": float("nan"), "detail": detail})
