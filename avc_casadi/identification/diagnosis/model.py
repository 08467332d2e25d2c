"""Result of the diagnosis of a log, as plain numbers and arrays."""

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
class Remedy:
    """A remedy, checked on the loop model or in the scene.

    Attributes:
        change: in words, with its value.
        key: what is changed: stiffness_n_per_m, damping_ns_per_m, delay_samples, ...
        value: its new value; NaN where it is removed.
        growth_per_s: of the loop with it, below 0 where stable; NaN where a scene was simulated instead.
        rests: whether the loop is stable.
    """

    change: str
    key: str
    value: float
    growth_per_s: float
    rests: bool


@dataclass(frozen=True)
class Measured:
    """Identified device and hand.

    Attributes:
        delay_samples, delay_error_samples: from the measured position to the motion that its force makes, in samples
            of the log, and the standard error.
        declared_delay_samples: as declared, or assumed, in the same samples: of a range the upper end.
        least_declared_delay_samples: the lower end.
        lag_samples: its part between position and logged force.
        device: mass_kg and damping_ns_per_m of the device: as declared where a hand is on a declared one, else
            identified.
        hand: mass, damping and stiffness of the hand by name, None where released.
        resonance: frequency_hz, damping_ratio and mass_ratio, None with rigid mechanics.
        misfit: residual of the position where the model fits best, relative to encoder and noise.
        growth_per_s, frequency_hz: of the loop with these values, by its eigenvalues.
    """

    delay_samples: float
    delay_error_samples: float
    declared_delay_samples: float
    least_declared_delay_samples: float
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
        frequency_hz, spectrum_m: amplitudes of the position during the oscillation, shape (m,).
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
    """The diagnosis of one log.

    Attributes:
        source: the log.
        seconds: duration.
        ticks: timing by its time stamps.
        encoder_m: encoder resolution, 0 where the positions lie on no lattice.
        oscillation: of the position.
        law: from position to force; None without contact.
        measured: identified device and hand; None where no loop model could be made.
        verdict: named, cannot tell, nothing wrong, or not the loop.
        cause: key of the named cause, else None.
        candidates: keys of the causes that remain, likeliest first.
        shares: of the hypotheses compatible with the log, by the cause whose removal stabilises the loop.
        conclusion: one sentence.
        evidence: sentences with numbers.
        cures: remedies that were checked.
        decides: the log that would decide between the candidates; empty where the cause is named.
        notes: assumptions and notes for the user.
        trace: for plotting.
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
    cures: tuple[Remedy, ...]
    decides: str
    notes: tuple[str, ...]
    trace: Trace
