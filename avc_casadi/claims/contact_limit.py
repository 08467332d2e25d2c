"""The stiffest contact that a law of a device with a force sensor is stable with, with every hand and without."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi.loops.handle import HandleFamily, HandleSide, Pair, leading_poles, plants_of
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.model.admittance import STIFFEST_CONTACT_N_PER_M, Contact
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law
from avc_casadi.model.sensed import SensorProblem

# A limit is confirmed by at most so many searches of the ranges, so far inside the boundary.
_SEARCHES = 4
_JUST_INSIDE = 1e-6
# Contacts of a scan: from the softest on, so many to a decade, and bisections between two of them.
_SOFTEST_CONTACT_N_PER_M = 1.0
_CONTACTS_PER_DECADE = 12
_BISECTIONS = 40


@dataclass(frozen=True)
class ContactLimit:
    """The stiffest contact that a law is stable with: a scan of contacts at the corners of the rest, then searches."""

    problem: SensorProblem
    law: Law

    def find(self) -> float:
        """Return the limit; infinite where the stiffest that a file may state is stable, 0 where no contact is."""
        rest = [pair for side in self._touching((0.0, 0.0)) for pair in side.corner_pairs]
        stiffnesses = self._scan()
        limit = 0.0
        for _ in range(_SEARCHES):
            limit = self._first_unstable(rest, stiffnesses)
            if not limit:
                break
            worst = [
                side.worst_case(leading_poles(self.law)) for side in self._touching((0.0, limit * (1 - _JUST_INSIDE)))
            ]
            sides = self._touching((0.0, limit))
            unstable = [(side, case) for side, case in zip(sides, worst, strict=True) if case.radius >= 1]
            if not unstable:
                break
            for side, case in unstable:
                hand, contact = side.parts(case.hand)
                sums = {key: np.array([hand[key] + contact[key]]) for key in hand}
                sums["stiffness_n_per_m"] = np.array([hand["stiffness_n_per_m"]])
                rest.append((case.device, Hand(**sums)))
                stiffnesses = np.union1d(stiffnesses, [contact["stiffness_n_per_m"]])
        return math.inf if limit >= STIFFEST_CONTACT_N_PER_M else limit

    def _scan(self) -> FloatArray:
        softest = _SOFTEST_CONTACT_N_PER_M * self.problem.device.metres_per_unit**2
        decades = math.log10(STIFFEST_CONTACT_N_PER_M / softest)
        scan = np.geomspace(softest, STIFFEST_CONTACT_N_PER_M, 1 + math.ceil(decades * _CONTACTS_PER_DECADE))
        return np.append(0.0, scan)

    def _touching(self, stiffness_n_per_m: Interval) -> list[HandleSide]:
        """Return the sides with a contact of a range of springs and of the declared dampers."""
        problem = self.problem
        contact = Contact(stiffness_n_per_m=(0.0, 1.0), damping_ns_per_m=problem.contact.damping_ns_per_m)
        contact = contact.model_copy(update={"stiffness_n_per_m": stiffness_n_per_m})
        return HandleFamily.touching(problem.device, problem.hands, contact)

    def _radii(self, rest: Sequence[Pair], stiffness_n_per_m: FloatArray) -> FloatArray:
        """Return the largest spectral radius with each contact."""
        pairs = [(device, _stiffer(hand, spring)) for spring in stiffness_n_per_m.tolist() for device, hand in rest]
        radii = OpenLoop.around(plants_of(pairs), self.law).closed.radius
        return np.asarray(radii.reshape(len(stiffness_n_per_m), -1).max(axis=1))

    def _first_unstable(self, rest: Sequence[Pair], stiffnesses: FloatArray) -> float:
        """Return the last stable contact before the first of a scan that is not, by bisection."""
        unstable = np.flatnonzero(self._radii(rest, stiffnesses) >= 1)
        if not unstable.size:
            return float(stiffnesses[-1])
        if not unstable[0]:
            return 0.0
        low, high = stiffnesses[unstable[0] - 1], stiffnesses[unstable[0]]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            stable = self._radii(rest, np.array([middle]))[0] < 1
            low, high = (middle, high) if stable else (low, middle)
        return float(low)


def _stiffer(hand: Hand, stiffness_n_per_m: float) -> Hand:
    """Return what the handle carries with a stiffer spring."""
    return replace(hand, stiffness_n_per_m=hand.stiffness_n_per_m + stiffness_n_per_m)
