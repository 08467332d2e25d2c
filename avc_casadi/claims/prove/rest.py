"""Rest: whether a coupling settles with every hand of a box, making and breaking contact; proved, refuted or open.

The claim is for every constant target of the hand and every initial state of the loop, without friction and with the
position measured exactly. It is on the law clipped last, with one nonlinearity of a slope between 0 and 1, the force
limit included.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain, plain_table
from avc_casadi._util.page import worded
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.prove.grounds import (
    Ground,
    NoMultiplier,
    NoMultiplierBecause,
    Nonlinearity,
    NotCovered,
    Open,
    Outcome,
    Settles,
    Stated,
    UnstableInContact,
)
from avc_casadi.claims.prove.held_device import SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.multiplier import LAGS, MOST_CELLS, Multiplier, search, verify
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Contact

_UNSTABLE = 1e-9
"""Distance of a spectral radius beyond 1 from which a loop counts as unstable."""
_DRAWS = 24
"""Hands drawn within the box, beside its corners, that may refute rest."""
_ATTEMPTS = 6
"""Multipliers that are tried, each found with the hands at which those before failed."""
# Angles of the search for a multiplier: logarithmically spaced, then evenly, and those about an angle of failure.
_SMALLEST_ANGLE = 1e-4
_MEETING_ANGLE = 0.1
_SLOW_ANGLES = 120
_EVEN_ANGLES = 280
_ABOUT_FAILURE = np.array([0.97, 0.99, 1.0, 1.01, 1.03])


@dataclass(frozen=True)
class Unstable:
    """A hand with which the loop is unstable in permanent contact.

    Attributes:
        hand: its numbers.
        device: those of the device's corner.
        spectral_radius: spectral radius of the loop, above 1.
    """

    hand: dict[str, float]
    device: dict[str, float]
    spectral_radius: float


@dataclass(frozen=True)
class Rest:
    """Proof or refutation of rest.

    Attributes:
        outcome: proved, refuted or open.
        ground: what is proved, what refutes it, or why it is open; of a proof in a file its sentence.
        contact: how the law makes contact.
        law: the law, clipped last.
        device: the device as declared.
        hand: ranges of the hand's numbers.
        multiplier: the multiplier that proves it; None without one.
        cells: cells in which it was verified.
        seconds: time that it took.
        unstable: the hand that refutes it; None without one.
    """

    outcome: Outcome
    ground: Ground = field(compare=False)
    contact: Contact
    law: ContactLaw
    device: Device
    hand: Mapping[str, tuple[float, float]]
    multiplier: Multiplier | None = None
    cells: int = 0
    seconds: float = field(default=0.0, compare=False)
    unstable: Unstable | None = None

    @property
    def sentence(self) -> str:
        """The claim, or why it is refuted or open, in words."""
        return worded(self.ground, self.device.units)

    def verify(self, progress: Progress = SILENT) -> bool:
        """Return whether the stored multiplier proves again that the law comes to rest with each hand of the box."""
        multiplier = self.multiplier
        if multiplier is None or not multiplier.valid or self.device.sample_time_s != self.law.sample_time_s:
            return False
        try:
            held = SampledPlantBox(self.device, self.hand)
        except UnsupportedError:
            return False
        return self.law.stable and verify(self.law, held, multiplier, progress=progress).holds

    def document(self) -> dict[str, Any]:
        """Return JSON values; `from_document` reads them."""
        kept = plain_table(
            {
                "outcome": self.outcome,
                "sentence": self.sentence,
                "contact": self.contact,
                "law": self.law.document(),
                "device": self.device.model_dump(mode="json"),
                "hand": self.hand,
                "multiplier": None,
                "cells": self.cells,
                "seconds": self.seconds,
            }
        )
        evidence = {
            "multiplier": None if self.multiplier is None else plain(dict(self.multiplier.taps)),
            "unstable": None if self.unstable is None else plain(vars(self.unstable)),
        }
        return {"schema": "avc-proof/1", "claim": "rest"} | kept | evidence

    @classmethod
    def from_document(cls, data: Mapping[str, Any]) -> Rest:
        """Read the output of `document`; unverified before `verify`."""
        taps, unstable = data["multiplier"], data["unstable"]
        return cls(
            outcome=data["outcome"],
            ground=Stated(data["sentence"]),
            contact=data["contact"],
            law=ContactLaw.from_document(data["law"]),
            device=Device.model_validate(data["device"]),
            hand={name: (float(low), float(high)) for name, (low, high) in data["hand"].items()},
            multiplier=None if taps is None else Multiplier({int(lag): float(tap) for lag, tap in taps.items()}),
            cells=int(data["cells"]),
            seconds=float(data["seconds"]),
            unstable=None if unstable is None else Unstable(**unstable),
        )


def prove_rest(
    law: ContactLaw,
    contact: Contact,
    device: Device,
    hand: Mapping[str, tuple[float, float]],
    *,
    most_cells: int = MOST_CELLS,
    seed: int = 0,
    progress: Progress = SILENT,
) -> Rest:
    """Return whether every hand of a box comes to rest with a law that is clipped last, and why.

    It is refuted by a hand whose linear loop is unstable, and proved by a multiplier that is verified over all angles
    and hands; else it is open.
    """
    start_s = time.perf_counter()

    def answer(outcome: Outcome, ground: Ground, **more: Any) -> Rest:
        return Rest(outcome, ground, contact, law, device, dict(hand), seconds=time.perf_counter() - start_s, **more)

    unstable = _unstable(law, device, hand, seed)
    if unstable is not None:
        return answer("refuted", UnstableInContact(unstable.spectral_radius, unstable.hand), unstable=unstable)
    proof = _proof(law, device, hand, most_cells, progress)
    not_covered = _not_covered(law, contact, device)
    multiplier = proof.multiplier
    ground: Ground = Open(not_covered, proof.no_multiplier)
    if multiplier is not None and not not_covered:
        ground = Settles(device, len(multiplier.taps), proof.cells)
    outcome: Outcome = "proved" if isinstance(ground, Settles) else "open"
    return answer(outcome, ground, multiplier=multiplier, cells=proof.cells)


def _unstable(law: ContactLaw, device: Device, hand: Mapping[str, tuple[float, float]], seed: int) -> Unstable | None:
    """Return the hand and device of the largest spectral radius in contact, of corners and draws, if it is above 1."""
    ends = np.array(list(hand.values()))
    corners = np.stack([grid.ravel() for grid in np.meshgrid(*ends, indexing="ij")])
    draws = np.random.default_rng(seed).uniform(ends[:, :1], ends[:, 1:], (len(ends), _DRAWS))
    hands = Hand(*np.append(corners, draws, axis=1))
    devices = device_corners(device, LINEAR_KEYS)
    body = Body.of(sampled_plant(devices, hands)).flat()
    radius = closed(body, law.state_space).radius
    worst_device, worst_hand = divmod(int(radius.argmax()), len(hands))
    if not radius.max() > 1 + _UNSTABLE:
        return None
    return Unstable(hands.values(worst_hand), linear_values(devices[worst_device]), float(radius.max()))


def _not_covered(law: ContactLaw, contact: Contact, device: Device) -> tuple[NotCovered, ...]:
    """Return what of law, contact and device the proof does not know: play, a gated contact, a dead zone."""
    play_m = max(device.backlash_m, *(device.range.backlash_m or (0.0,)))
    dead_zone_m = 0.0 if law.state_feedback is None else law.state_feedback.dead_zone_m
    not_covered = []
    if play_m > 0:
        not_covered.append(NotCovered(Nonlinearity.PLAY, play_m))
    if contact == "gated":
        not_covered.append(NotCovered(Nonlinearity.GATED_CONTACT))
    if dead_zone_m > 0:
        not_covered.append(NotCovered(Nonlinearity.DEAD_ZONE, dead_zone_m))
    return tuple(not_covered)


def promising(law: ContactLaw, held: SampledPlantBox) -> float:
    """Return t of the best multiplier at the corners of the box: a proof is likely where it is positive."""
    points = _Points.of(law, held)
    return search(points.omega, points.loop)[1] if law.stable else -np.inf


@dataclass(frozen=True)
class _Proof:
    """A multiplier that was verified, or the reason why there is none; and the number of evaluated cells."""

    multiplier: Multiplier | None = None
    no_multiplier: NoMultiplier | None = None
    cells: int = 0


def _proof(
    law: ContactLaw, device: Device, hand: Mapping[str, tuple[float, float]], most_cells: int, progress: Progress
) -> _Proof:
    """Search for a multiplier and verify it, with more hands where it fails between those it was found for."""
    if not law.stable:
        return _Proof(no_multiplier=NoMultiplier(NoMultiplierBecause.UNSTABLE_LAW))
    try:
        held = SampledPlantBox(device, hand)
        held.tail(np.array([np.pi]))
    except UnsupportedError as refusal:
        return _Proof(no_multiplier=NoMultiplier(NoMultiplierBecause.UNSUPPORTED, message=str(refusal)))
    points = _Points.of(law, held)
    cells = 0
    for _ in range(_ATTEMPTS):
        multiplier, margin = search(points.omega, points.loop)
        if not margin > 0 or not multiplier.valid:
            none_serves = NoMultiplier(NoMultiplierBecause.NONE_SERVES, len(LAGS))
            return _Proof(no_multiplier=none_serves, cells=cells)
        verification = verify(law, held, multiplier, most_cells=most_cells, progress=progress)
        cells += verification.cells
        if verification.holds:
            return _Proof(multiplier=multiplier, cells=cells)
        if verification.fails_at is None:
            return _Proof(no_multiplier=NoMultiplier(NoMultiplierBecause.STOPPED, cells), cells=cells)
        points = points.with_hand(law, held, verification.fails_at)
    return _Proof(no_multiplier=NoMultiplier(NoMultiplierBecause.FAILED_BETWEEN), cells=cells)


@dataclass(frozen=True)
class _Points:
    """Angles and hands of the search for a multiplier, and the loop there, all of shape (p,)."""

    omega: FloatArray
    loop: ComplexArray

    @classmethod
    def of(cls, law: ContactLaw, held: SampledPlantBox) -> _Points:
        """Return the points of the corners of the box at all angles."""
        slow = np.geomspace(_SMALLEST_ANGLE, _MEETING_ANGLE, _SLOW_ANGLES, endpoint=False)
        omega = np.concatenate([slow, np.linspace(_MEETING_ANGLE, np.pi, _EVEN_ANGLES)])
        return _loops(law, held, omega, held.corners())

    def with_hand(self, law: ContactLaw, held: SampledPlantBox, fails_at: FloatArray) -> _Points:
        """Add a hand at an angle, ``fails_at`` holds both, and its neighbourhood."""
        angles = np.clip(fails_at[0] * _ABOUT_FAILURE, 0.0, np.pi)
        added = _loops(law, held, angles, fails_at[None, 1:])
        return _Points(np.append(self.omega, added.omega), np.append(self.loop, added.loop))


def _loops(law: ContactLaw, held: SampledPlantBox, omega: FloatArray, hands: FloatArray) -> _Points:
    """Return L = P C1 - C2 with hands (h, numbers) at angles (f,): h f points."""
    step = np.exp(1j * omega) - 1
    from_position, from_force, poles = (
        np.polyval([float(coefficient) for coefficient in part], step) for part in law.transfer
    )
    loop = (held.at(omega, hands) * from_position - from_force) / poles
    return _Points(np.tile(omega, len(hands)), loop.ravel())
