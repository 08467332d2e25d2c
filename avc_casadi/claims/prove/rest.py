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
from avc_casadi.claims.prove.multiplier import LAGS, MOST_CELLS, Multiplier, Verification, search, verify
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_text
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Contact

Outcome = Literal["proved", "refuted", "open"]


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
    declared = [
        f"{name} ({value:.4g})"
        for key, name in left_out.items()
        if (value := max(getattr(device, key), *(getattr(spread, key) or (0.0,)))) > 0
    ]
    beside = f"; left out: {', '.join(declared)}" if declared else ", without friction and measured exactly"
    return f"of {mechanics}, {amplifier}, {delay}{beside}"


def _between(value: float, ends: tuple[float, float] | None) -> str:
    return f"{value:g}" if ends is None else f"{ends[0]:g} to {ends[1]:g}"


@dataclass(frozen=True)
class Unstable:
    """A hand with which the loop is unstable in permanent contact."""

    hand: dict[str, float]
    device: dict[str, float]
    spectral_radius: float


@dataclass(frozen=True)
class Rest:
    """Proof or refutation of rest."""

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
        found = self.multiplier
        if found is None or not found.valid or self.device.sample_time_s != self.law.sample_time_s:
            return False
        try:
            held = SampledPlantBox(self.device, self.hand)
        except UnsupportedError:
            return False
        return self.law.stable and verify(self.law, held, found, progress=progress).holds

    def document(self) -> dict[str, Any]:
        """Return JSON values; `from_document` reads them."""
        kept = plain_table({**vars(self), "law": self.law.document(), "device": self.device.model_dump(mode="json")})
        beside = {
            "multiplier": None if self.multiplier is None else plain(dict(self.multiplier.taps)),
            "unstable": None if self.unstable is None else plain(vars(self.unstable)),
        }
        return {"schema": "avc-proof/1", "claim": "rest"} | kept | beside

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

    # Corners of the box and draws within it.
    ends = np.array(list(hand.values()))
    corners = np.stack([grid.ravel() for grid in np.meshgrid(*ends, indexing="ij")])
    draws = np.random.default_rng(seed).uniform(ends[:, :1], ends[:, 1:], (len(ends), 24))
    hands = Hand(*np.append(corners, draws, axis=1))
    devices = device_corners(device, LINEAR_KEYS)
    body = Body.of(sampled_plant(devices, hands)).flat()
    radius = closed(body, law.rendering, law.state_feedback).radius
    worst, who = divmod(int(radius.argmax()), len(hands))
    if radius.max() > 1 + 1e-9:
        unstable = Unstable(hands.values(who), linear_values(devices[worst]), float(radius.max()))
        how = f"the loop is unstable in contact, with a spectral radius of {unstable.spectral_radius:.6g}"
        return answer("refuted", f"{how} with {hand_text(unstable.hand, device.units.unit)}", unstable=unstable)
    why, found, cells = _proof(law, device, hand, most_cells, progress)
    dead_zone = 0.0 if law.state_feedback is None else law.state_feedback.dead_zone_m
    play = max(device.backlash_m, *(device.range.backlash_m or (0.0,)))
    length = device.units.unit("m")
    lacking = {
        f"the play of {quantity(play, length)} is a second nonlinearity, which this proof does not know": play > 0,
        'contact = "gated" is no single nonlinearity with a slope between 0 and 1: this proof is of "clip-last"': (
            contact == "gated"
        ),
        f"the dead zone of {quantity(dead_zone, length)} is a second nonlinearity, which this proof does not know": (
            dead_zone > 0
        ),
    }
    open_for = [reason for reason, there in lacking.items() if there]
    if found is not None and not open_for:
        sentence = (
            f"settles with every hand of the box, wherever it rests and from any state, making and breaking "
            f"contact ({coverage(device)}): one multiplier of {len(found.taps)} taps, verified in {cells} cells"
        )
        return answer("proved", sentence, multiplier=found, cells=cells)
    beside = "; without that it is proved" if found is not None else f"; {why}" if why else ""
    return answer("open", ("; ".join(open_for) + beside).removeprefix("; "), multiplier=found, cells=cells)


def promising(law: ContactLaw, held: SampledPlantBox) -> float:
    """Return t of the best multiplier at the corners of the box: a proof is likely where it is positive."""
    points = _Points.of(law, held)
    return search(points.omega, points.loop)[1] if law.stable else -np.inf


def _proof(
    law: ContactLaw, device: Device, hand: Mapping[str, tuple[float, float]], most_cells: int, progress: Progress
) -> tuple[str, Multiplier | None, int]:
    """Return the reason why there is no proof, or the multiplier; and the number of evaluated cells."""
    if not law.stable:
        return "the law has a pole on or outside the unit circle while it gives no force", None, 0
    try:
        held = SampledPlantBox(device, hand)
        held.tail(np.array([np.pi]))
    except UnsupportedError as refusal:
        return str(refusal), None, 0
    points = _Points.of(law, held)
    cells = 0
    for _ in range(6):
        found, margin = search(points.omega, points.loop)
        if not margin > 0 or not found.valid:
            return f"no multiplier of {len(LAGS)} taps serves all hands", None, cells
        result: Verification = verify(law, held, found, most_cells=most_cells, progress=progress)
        cells += result.cells
        if result.holds:
            return "", found, cells
        if result.fails_at is None:
            return f"verification gave up after {cells} cells", None, cells
        points = points.with_hand(law, held, result.fails_at)
    return "the multiplier failed between the hands it was found for, six times over", None, cells


@dataclass(frozen=True)
class _Points:
    """Angles and hands of the search for a multiplier, and the loop there, all of shape (p,)."""

    omega: FloatArray
    loop: ComplexArray

    @classmethod
    def of(cls, law: ContactLaw, held: SampledPlantBox) -> _Points:
        omega = np.concatenate([np.geomspace(1e-4, 0.1, 120, endpoint=False), np.linspace(0.1, np.pi, 280)])
        return cls(*_loop(law, held, omega, held.corners()))

    def with_hand(self, law: ContactLaw, held: SampledPlantBox, where: FloatArray) -> _Points:
        """Add a hand at an angle and its neighbourhood."""
        omega, loop = _loop(
            law, held, np.clip(where[0] * np.array([0.97, 0.99, 1.0, 1.01, 1.03]), 0.0, np.pi), where[None, 1:]
        )
        return _Points(np.append(self.omega, omega), np.append(self.loop, loop))


def _loop(
    law: ContactLaw, held: SampledPlantBox, omega: FloatArray, hands: FloatArray
) -> tuple[FloatArray, ComplexArray]:
    step = np.exp(1j * omega) - 1
    from_position, from_force, poles = (np.polyval([float(part) for part in one], step) for one in law.transfer)
    loop = (held.at(omega, hands) * from_position - from_force) / poles
    return np.tile(omega, len(hands)), loop.ravel()
