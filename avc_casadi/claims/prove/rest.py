"""Rest: whether a coupling settles with every hand of a box, making and breaking contact; proved, refuted or open.

The claim is for every constant target of the hand and every initial state of the loop, without friction and with the
position measured exactly. It is on the law clipped last, with one nonlinearity of a slope between 0 and 1, the force
limit included.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain, plain_table
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import quantity
from avc_casadi.claims.prove.held_device import SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.multiplier import LAGS, MOST_CELLS, Multiplier, search, verify
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_text
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Contact

Outcome = Literal["proved", "refuted", "open"]

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


def coverage(device: Device) -> str:
    """Return what a proof of rest covers, in words: mechanics, amplifier and delay as declared, and what is omitted."""
    mode, spread = device.resonance, device.range
    mechanics = "a rigid device"
    if mode is not None:
        known = _between(mode.frequency_hz, spread.resonance.frequency_hz)
        mechanics = f"a device with its resonance at {known} Hz"
    amplifier = "an ideal amplifier"
    if device.amplifier_bandwidth_hz is not None:
        amplifier = f"an amplifier of {_between(device.amplifier_bandwidth_hz, spread.amplifier_bandwidth_hz)} Hz"
    late = _between(device.delay_samples, spread.delay_samples)
    delay = f"{late} sample{'' if late == '1' else 's'} of delay"
    left_out = {
        "coulomb_friction_n": "dry friction",
        "encoder_resolution_m": "encoder",
        "position_noise_rms_m": "noise",
    }
    largest = {name: max(getattr(device, key), *(getattr(spread, key) or (0.0,))) for key, name in left_out.items()}
    declared = [f"{name} ({value:.4g})" for name, value in largest.items() if value > 0]
    omitted = f"; left out: {', '.join(declared)}" if declared else ", without friction and measured exactly"
    return f"of {mechanics}, {amplifier}, {delay}{omitted}"


def _between(value: float, ends: tuple[float, float] | None) -> str:
    """Return a number, or its range, in words."""
    return f"{value:g}" if ends is None else f"{ends[0]:g} to {ends[1]:g}"


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
        sentence: the claim, or why it is refuted or open, in words.
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
    sentence: str
    contact: Contact
    law: ContactLaw
    device: Device
    hand: Mapping[str, tuple[float, float]]
    multiplier: Multiplier | None = None
    cells: int = 0
    seconds: float = field(default=0.0, compare=False)
    unstable: Unstable | None = None

    def verify(self, progress: Progress = SILENT) -> bool:
        """Return whether the stored multiplier verifies again; law and device must share T, and the box be valid."""
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
        kept = plain_table({**vars(self), "law": self.law.document(), "device": self.device.model_dump(mode="json")})
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
            sentence=data["sentence"],
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
    """Prove rest, refute it, or give the reason why it is open."""
    start_s = time.perf_counter()

    def answer(outcome: Outcome, sentence: str, **more: Any) -> Rest:
        return Rest(outcome, sentence, contact, law, device, dict(hand), seconds=time.perf_counter() - start_s, **more)

    unstable = _unstable(law, device, hand, seed)
    if unstable is not None:
        how = f"the loop is unstable in contact, with a spectral radius of {unstable.spectral_radius:.6g}"
        return answer("refuted", f"{how} with {hand_text(unstable.hand, device.units.unit)}", unstable=unstable)
    proof = _proof(law, device, hand, most_cells, progress)
    open_for = _not_covered(law, contact, device)
    multiplier = proof.multiplier
    if multiplier is not None and not open_for:
        sentence = (
            f"settles with every hand of the range, wherever it rests and from any state, making and breaking "
            f"contact ({coverage(device)}): one multiplier of {len(multiplier.taps)} taps, verified in "
            f"{proof.cells} cells"
        )
        return answer("proved", sentence, multiplier=multiplier, cells=proof.cells)
    remark = proof.why_not if multiplier is None else "without that it is proved"
    sentence = "; ".join(filter(None, [*open_for, remark]))
    return answer("open", sentence, multiplier=multiplier, cells=proof.cells)


def _unstable(law: ContactLaw, device: Device, hand: Mapping[str, tuple[float, float]], seed: int) -> Unstable | None:
    """Return the hand with the largest spectral radius in contact, among corners and draws, where that exceeds 1."""
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


def _not_covered(law: ContactLaw, contact: Contact, device: Device) -> list[str]:
    """Return what of law, contact and device this proof does not know, in words."""
    unit = device.units.unit("m")
    play = max(device.backlash_m, *(device.range.backlash_m or (0.0,)))
    dead_zone = 0.0 if law.state_feedback is None else law.state_feedback.dead_zone_m
    second = "is a second nonlinearity, which this proof does not cover"
    reasons = []
    if play > 0:
        reasons.append(f"the play of {quantity(play, unit)} {second}")
    if contact == "gated":
        reasons.append(
            'contact = "gated" cannot be proved: only "clip-last" is a single nonlinearity with a slope from 0 to 1'
        )
    if dead_zone > 0:
        reasons.append(f"the dead zone of {quantity(dead_zone, unit)} {second}")
    return reasons


def promising(law: ContactLaw, held: SampledPlantBox) -> float:
    """Return t of the best multiplier at the corners of the box: a proof is likely where it is positive."""
    points = _Points.of(law, held)
    return search(points.omega, points.loop)[1] if law.stable else -np.inf


@dataclass(frozen=True)
class _Proof:
    """A multiplier that was verified, or the reason why there is none; and the number of evaluated cells."""

    multiplier: Multiplier | None = None
    why_not: str = ""
    cells: int = 0


def _proof(
    law: ContactLaw, device: Device, hand: Mapping[str, tuple[float, float]], most_cells: int, progress: Progress
) -> _Proof:
    """Search for a multiplier and verify it, with more hands where it fails between those it was found for."""
    if not law.stable:
        return _Proof(why_not="the law has a pole on or outside the unit circle while it gives no force")
    try:
        held = SampledPlantBox(device, hand)
        held.tail(np.array([np.pi]))
    except UnsupportedError as refusal:
        return _Proof(why_not=str(refusal))
    points = _Points.of(law, held)
    cells = 0
    for _ in range(_ATTEMPTS):
        multiplier, margin = search(points.omega, points.loop)
        if not margin > 0 or not multiplier.valid:
            return _Proof(why_not=f"no multiplier of {len(LAGS)} taps serves all hands", cells=cells)
        verification = verify(law, held, multiplier, most_cells=most_cells, progress=progress)
        cells += verification.cells
        if verification.holds:
            return _Proof(multiplier=multiplier, cells=cells)
        if verification.fails_at is None:
            return _Proof(why_not=f"verification stopped after {cells} cells", cells=cells)
        points = points.with_hand(law, held, verification.fails_at)
    return _Proof(why_not="the multiplier failed between the hands it was found for, six times over", cells=cells)


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
