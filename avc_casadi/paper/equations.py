"""The equations of the adaptive virtual coupling, each once, for every number system.

Numbers in parentheses are those of the paper, "Realistic and Stability Performances of Haptic System with Adaptive
Virtual Coupling". phi = omega T / 2 is half the angle that a sample turns; the half-angle forms do not cancel at low
frequency. Impedances are in N.s/m, time in s, frequency in Hz.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from avc_casadi.model.problem import Model, Problem
from avc_casadi.paper.numbers import NUMPY, Complex, NumberSystem, Real, abs2


@dataclass(frozen=True)
class SampleAngle:
    """Trigonometry of one frequency (or an array of them) at one sample time.

    Attributes:
        numbers: the number system.
        turns: f T, in turns a sample; phi = pi f T is half the angle that a sample turns.
        sample_time_s: T, s.
        sin: sin(phi).
        cos: cos(phi).
    """

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
    first2 = abs2(first)
    second2 = abs2(second)
    scale = numbers.one_for_zero(abs2(first + second))
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


@dataclass(frozen=True)
class ImpedanceLoop:
    """Impedances of device, environment and goal at one or many frequencies, in one number system, N.s/m.

    Attributes:
        angle: trigonometry of the frequencies.
        device: Z_d.
        hold: H, no unit.
        environment: Z_e.
        desired: Z_ds, mean of the realistic bounds.
        desired_gap: Z_e - Z_ds from the differences of the parameters, which do not cancel.
    """

    angle: SampleAngle
    device: Complex
    hold: Complex
    environment: Complex
    desired: Complex
    desired_gap: Complex

    @property
    def target(self) -> Complex:
        """Z_h_ds = Z_d + H Z_ds   (10)."""
        return perceived_impedance(self.device, self.hold, self.desired)

    @property
    def without_coupling(self) -> Complex:
        """Z_h = Z_d + H Z_e: perceived impedance of device and wall joined directly."""
        return perceived_impedance(self.device, self.hold, self.environment)

    def rows(self, index: NDArray[np.intp]) -> ImpedanceLoop:
        """Return the loop at some of its frequencies, by their positions (numpy only)."""
        take = {field.name: getattr(self, field.name)[index] for field in fields(self) if field.name != "angle"}
        angle = replace(self.angle, **{name: getattr(self.angle, name)[index] for name in ("turns", "sin", "cos")})
        return ImpedanceLoop(angle=angle, **take)

    def rendered(self, damping_ns_per_m: Real, stiffness_n_per_m: Real) -> Complex:
        """Return Z_eavc, coupling and environment in series; 0 where both are 0   (9)."""
        coupling = coupling_impedance(self.angle, damping_ns_per_m, stiffness_n_per_m)
        return series(coupling, self.environment, numbers=self.angle.numbers)

    def sensitivity(self, damping_ns_per_m: Real, stiffness_n_per_m: Real) -> Complex:
        """Return dZ_h_avc/dZ_avc = H (Z_e/(Z_e + Z_avc))^2; 0 in free space."""
        coupling = coupling_impedance(self.angle, damping_ns_per_m, stiffness_n_per_m)
        total = self.environment + coupling
        share = self.environment / np.where(total == 0, 1, total)
        return self.hold * share * share

    def perceived(
        self, damping_ns_per_m: Real, stiffness_n_per_m: Real, contact_damping_ns_per_m: Real = 0.0
    ) -> Complex:
        """Return Z_h_avc   (8)."""
        rendered = self.rendered(damping_ns_per_m, stiffness_n_per_m)
        return perceived_impedance(self.device, self.hold, rendered, contact_damping_ns_per_m)


def loop_at(problem: Problem, frequency_hz: Real, numbers: NumberSystem = NUMPY) -> ImpedanceLoop:
    """Return the gain-free part of a problem's loop at some frequencies, in a number system.

    The desired impedance is the mean of the upper and lower boundary, and the gap is the environment's minus that.
    """
    device = problem.device
    environment = problem.environment
    model = problem.stability.model
    upper = problem.boundaries.upper
    lower = problem.boundaries.lower
    n = numbers.number
    desired_b = (n(upper.damping_ns_per_m) + n(lower.damping_ns_per_m)) / 2
    desired_k = (n(upper.stiffness_n_per_m) + n(lower.stiffness_n_per_m)) / 2
    environment_b = n(environment.damping_ns_per_m)
    environment_k = n(environment.stiffness_n_per_m)
    # From the bounds themselves: a gap of 1e-12 would vanish in the rounding of their mean.
    gap_b = ((environment_b - n(upper.damping_ns_per_m)) + (environment_b - n(lower.damping_ns_per_m))) / 2
    gap_k = ((environment_k - n(upper.stiffness_n_per_m)) + (environment_k - n(lower.stiffness_n_per_m))) / 2
    angle = SampleAngle.at(numbers, frequency_hz, n(device.sample_time_s))
    return ImpedanceLoop(
        angle=angle,
        # Tustin, because a backward difference would add a false damping 2 m/T.
        device=n(device.mass_kg) * tustin(angle) + n(device.damping_ns_per_m),
        hold=hold(angle, model, device.delay_samples),
        environment=environment_impedance(angle, model, environment_b, environment_k),
        desired=environment_impedance(angle, model, desired_b, desired_k),
        desired_gap=environment_impedance(angle, model, gap_b, gap_k),
    )
