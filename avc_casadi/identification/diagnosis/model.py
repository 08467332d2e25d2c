"""Diagnosis: what a log of a loop that buzzes says, as plain numbers and arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Ticks
from avc_casadi.identification.diagnosis.oscillation import Oscillation

Verdict = Literal["named", "cannot tell", "nothing wrong", "not the loop"]


@dataclass(frozen=True)
class Cure:
    """A change, checked on the loop model or in the scene.

    Attributes:
        change: in words, with its number.
        key: what is changed: stiffness_n_per_m, damping_ns_per_m, delay_samples, ...
        value: to what; not a number where it is taken away.
        growth_per_s: of the loop with it, below 0 where it rests; not a number where a scene was played instead.
        rests: whether the loop comes to rest.
    """

    change: str
    key: str
    value: float
    growth_per_s: float
    rests: bool


@dataclass(frozen=True)
class Measured:
    """What the log says of device and hand.

    Attributes:
        delay_samples, delay_error_samples: from the measured position to the motion that its force makes, in samples
            of the log, and the standard error.
        declared_delay_samples: as declared, or assumed, in the same samples.
        lag_samples: the part of it that lies between position and logged force.
        device: mass_kg and damping_ns_per_m of the device: as declared where somebody holds one that was, else found.
        hand: mass, damping and stiffness of the hand by name, None let go.
        resonance: frequency_hz, damping_ratio and mass_ratio, None with rigid mechanics.
        misfit: what the model leaves of the position where it explains it best, over what encoder and noise leave.
        growth_per_s, frequency_hz: of the loop with these numbers, by its eigenvalues.
    """

    delay_samples: float
    delay_error_samples: float
    declared_delay_samples: float
    lag_samples: int
    device: Mapping[str, float]
    hand: Mapping[str, float] | None
    resonance: Mapping[str, float] | None
    misfit: float
    growth_per_s: float
    frequency_hz: float


@dataclass(frozen=True, eq=False)
class Trace:
    """The log around its oscillation.

    Attributes:
        time_s: shape (n,).
        position_m: measured, shape (n,).
        fast_m: the position without the hand's slow motion, shape (n,).
        envelope_m: amplitude of the oscillation, shape (n,).
        force_n: commanded, along +position as in the log, shape (n,).
        frequency_hz, spectrum_m: amplitudes of the position while it swings, shape (m,).
    """

    time_s: FloatArray
    position_m: FloatArray
    fast_m: FloatArray
    envelope_m: FloatArray
    force_n: FloatArray
    frequency_hz: FloatArray
    spectrum_m: FloatArray


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is wrong with one log.

    Attributes:
        source: the log.
        seconds: how long it lasts.
        ticks: what its time stamps say.
        encoder_m: step of the encoder, 0 where the positions lie on no lattice.
        oscillation: what swings.
        law: what the computer makes of the position; None without contact.
        measured: device and hand; None where no loop model could be made.
        verdict: named, cannot tell, nothing wrong, or not the loop.
        cause: key of the cause that is named, else None.
        candidates: keys of those between which it cannot tell, likeliest first.
        shares: of the answers that the log bears out, by the cause but for which the loop would rest.
        conclusion: one sentence.
        evidence: sentences with numbers.
        cures: changes that were checked.
        decides: the log that would tell between the candidates; empty where the cause is named.
        notes: what is assumed, and what the user should know.
        trace: for pictures.
    """

    source: str
    seconds: float
    ticks: Ticks
    encoder_m: float
    oscillation: Oscillation
    law: Law | None
    measured: Measured | None
    verdict: Verdict
    cause: str | None
    candidates: tuple[str, ...]
    shares: Mapping[str, float]
    conclusion: str
    evidence: tuple[str, ...]
    cures: tuple[Cure, ...]
    decides: str
    notes: tuple[str, ...]
    trace: Trace
