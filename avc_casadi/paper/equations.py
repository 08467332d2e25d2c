"""The equations of the adaptive virtual coupling, each once, for every number system.

Numbers in parentheses are those of the paper, "Realistic and Stability Performances of Haptic System with Adaptive
Virtual Coupling". phi = omega T / 2 is half the angle that a sample turns; the half-angle forms do not cancel at low
frequency. Impedances are in N.s/m, time in s, frequency in Hz.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi.paper.numbers import Complex, NumberSystem, Real, abs2

if TYPE_CHECKING:
    from avc_casadi.model.problem import Model


@dataclass(frozen=True)
class SampleAngle:
    """Trigonometry of one frequency (or an array of them) at one sample time."""

    numbers: NumberSystem
    turns: Real
    sample_time_s: Real
    sin: Real
    cos: Real

    @classmethod
    def at(cls, numbers: NumberSystem, frequency_hz: Real, sample_time_s: Real) -> SampleAngle:
        """Evaluate at a frequency, 0 < frequency_hz < 1/(2 sample_time_s)."""
        turns = frequency_hz * sample_time_s
        return cls(numbers, turns, sample_time_s, numbers.sin_pi(turns), numbers.cos_pi(turns))


def tustin(angle: SampleAngle) -> Complex:
    """s_t = 2(z-1)/(T(z+1)) = j (2/T) tan(phi), in 1/s."""
    return angle.numbers.complex(0.0, 2 / angle.sample_time_s * angle.sin / angle.cos)


def backward_difference(angle: SampleAngle) -> Complex:
    """s_b = (z-1)/(T z) = (2/T) (sin^2(phi) + j sin(phi) cos(phi)), in 1/s."""
    scale = 2 / angle.sample_time_s * angle.sin
    return angle.numbers.complex(scale * angle.sin, scale * angle.cos)


def delay_operator(angle: SampleAngle, samples: float) -> Complex:
    """z^-samples = exp(-j omega T samples)."""
    if samples == 0:
        return angle.numbers.complex(1.0 + 0 * angle.turns, 0 * angle.turns)
    turned = 2 * samples * angle.turns
    return angle.numbers.complex(angle.numbers.cos_pi(turned), -angle.numbers.sin_pi(turned))


def hold(angle: SampleAngle, model: Model, delay_samples: float) -> Complex:
    """H: the mean of a sample and the one before, (z+1)/(2z), or one sample of delay, 1/z; both times z^-delay.

    The paper's hold is (z+1)/(2z) = cos(phi) exp(-j phi). With 1/z, Re Z_h >= 0 is the exact condition of Colgate and
    Schenkel for a loop that holds each force for T.
    """
    if model == "sampled-data":
        return delay_operator(angle, 1 + delay_samples)
    mean = angle.numbers.complex(angle.cos * angle.cos, -angle.sin * angle.cos)
    return mean if delay_samples == 0 else mean * delay_operator(angle, delay_samples)


def device_impedance(angle: SampleAngle, mass_kg: Real, damping_ns_per_m: Real) -> Complex:
    """Z_d = m s_t + b_d. Tustin, because a backward difference would add a false damping 2 m/T."""
    return mass_kg * tustin(angle) + damping_ns_per_m


def spring_damper(angle: SampleAngle, damping_ns_per_m: Real, stiffness_n_per_m: Real, *, tustin: bool) -> Complex:
    """B + k/s with s = s_t (``tustin``) or s_b: b [+ k T/2] - j (k T/2) cot(phi)   (2), (7)."""
    half = stiffness_n_per_m * angle.sample_time_s / 2
    real = damping_ns_per_m + 0 * half + 0 * angle.sin if tustin else damping_ns_per_m + half + 0 * angle.sin
    return angle.numbers.complex(real, -half * angle.cos / angle.sin)


def environment_impedance(angle: SampleAngle, model: Model, damping_ns_per_m: Real, stiffness_n_per_m: Real) -> Complex:
    """Z_e and Z_ds: Tustin in the paper's model, backward difference in the sampled-data model."""
    return spring_damper(angle, damping_ns_per_m, stiffness_n_per_m, tustin=model == "paper")


def coupling_impedance(angle: SampleAngle, damping_ns_per_m: Real, stiffness_n_per_m: Real) -> Complex:
    """Z_avc = b + k/s_b   (2), (7)."""
    return spring_damper(angle, damping_ns_per_m, stiffness_n_per_m, tustin=False)


def series(first: Complex, second: Complex, *, numbers: NumberSystem) -> Complex:
    """Z_1 Z_2/(Z_1 + Z_2), written (Z_1|Z_2|^2 + Z_2|Z_1|^2)/|Z_1 + Z_2|^2   (9).

    For passive springs and dampers every term of this form has one sign, so that the real part keeps full relative
    accuracy where the plain quotient loses the digits of |Im/Re|. 0 where both are 0.
    """
    first2, second2, scale = abs2(first), abs2(second), numbers.one_for_zero(abs2(first + second))
    return numbers.complex(
        (first.real * second2 + second.real * first2) / scale,
        (first.imag * second2 + second.imag * first2) / scale,
    )


def perceived_impedance(
    device: Complex, hold_value: Complex, rendered: Complex, contact_damping: Real = 0.0
) -> Complex:
    """Z_h = Z_d + H (b_p + Z_eavc)   (8); b_p is 0 in the paper's structure."""
    return device + hold_value * (rendered + contact_damping)


def coupling_gains(angle: SampleAngle, coupling: Complex) -> tuple[Real, Real]:
    """Return (b, k) of b + k/s_b = coupling: k = -Im (2/T) tan(phi), b = Re - k T/2   (17)."""
    stiffness = -coupling.imag * 2 / angle.sample_time_s * angle.sin / angle.cos
    return coupling.real - stiffness * angle.sample_time_s / 2, stiffness
