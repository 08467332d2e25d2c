"""The law of a coupling before it is clipped, as exact transfer functions: linear, on both sides of the wall.

y = C1(z) x + C2(z) F of position and previous force, F = min(max(0, y), largest force), C2 behind an observer alone; in
rational arithmetic, as every number is a binary fraction, and in powers of z - 1, which keeps low frequencies.

    coupling and wall in series:   S (1 - d w)(1 - a w)/(1 + q w) + b_p (1 - w)/T,   w = 1/z,
    kappa = k + b/T,  kappa_e = k_e + b_e/T,  S = kappa kappa_e/(kappa + kappa_e),
    a = b/(kappa T),  d = b_e/(kappa_e T),  q = S (a - d)/kappa - a
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from avc_casadi._util.json_values import plain
from avc_casadi.loops.wall import SampledLoop, fractions
from avc_casadi.model.law import Law
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import StateFeedback

# Coefficients from the highest power of z - 1 down.
Polynomial = list[Fraction]
_ZERO = Fraction(0)
_ONE = Fraction(1)


class ObserverTransfer(NamedTuple):
    """C1 = from_position/poles and C2 = from_force/poles, polynomials in z - 1."""

    from_position: Polynomial
    from_force: Polynomial
    poles: Polynomial


@dataclass(frozen=True)
class ContactLaw:
    """Gains, wall and observer at one sample time, clipped last.

    Attributes:
        sample_time_s: T, s.
        damping_ns_per_m: b of the coupling, infinite where it is rigid.
        stiffness_n_per_m: k of the coupling, infinite where it is rigid.
        contact_damping_ns_per_m: b_p.
        wall_damping_ns_per_m: b_e.
        wall_stiffness_n_per_m: k_e.
        state_feedback: the observer with state feedback that the coupling stands behind; None without one.
    """

    sample_time_s: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    wall_damping_ns_per_m: float
    wall_stiffness_n_per_m: float
    state_feedback: StateFeedback | None = None

    @classmethod
    def of(cls, problem: Problem, b: float, k: float, contact: float, law: StateFeedback | None = None) -> Self:
        """Return the law of gains with wall and sample time of a problem."""
        wall = problem.environment
        return cls(
            sample_time_s=problem.device.sample_time_s,
            damping_ns_per_m=b,
            stiffness_n_per_m=k,
            contact_damping_ns_per_m=contact,
            wall_damping_ns_per_m=wall.damping_ns_per_m,
            wall_stiffness_n_per_m=wall.stiffness_n_per_m,
            state_feedback=law,
        )

    @property
    def rigid(self) -> bool:
        """Whether device and wall are joined without a coupling."""
        return math.isinf(self.damping_ns_per_m) or math.isinf(self.stiffness_n_per_m)

    @cached_property
    def _series(self) -> tuple[Polynomial, Polynomial]:
        """Return numerator and denominator of force over the coupling's input position, polynomials in z - 1, exactly.

        Coupling b, k and wall b_e, k_e are in series, with the contact damper b_p beside: with kappa = k + b/T and
        kappa_e alike, the series has kappa kappa_e/(kappa + kappa_e). Numbers are fractions, without rounding.
        """
        t = Fraction(self.sample_time_s)
        b_e = Fraction(self.wall_damping_ns_per_m)
        k_e = Fraction(self.wall_stiffness_n_per_m)
        kappa_e = k_e + b_e / t
        d = b_e / (kappa_e * t) if kappa_e else _ZERO
        if self.rigid:
            series = kappa_e
            a = _ZERO
            q = _ZERO
        else:
            b = Fraction(self.damping_ns_per_m)
            k = Fraction(self.stiffness_n_per_m)
            kappa = k + b / t
            a = b / (kappa * t) if kappa else _ZERO
            series = kappa * kappa_e / (kappa + kappa_e) if kappa + kappa_e else _ZERO
            q = series * (a - d) / kappa - a if kappa else _ZERO
        contact = Fraction(self.contact_damping_ns_per_m) / t
        spring = [coefficient * series for coefficient in product([_ONE, 1 - d], [_ONE, 1 - a])]
        damper = [contact, contact * (1 + q), _ZERO]
        return total(spring, damper), product([_ONE, _ONE], [_ONE, 1 + q])

    @cached_property
    def transfer(self) -> ObserverTransfer:
        """Return the numerators of C1 and C2 and their common denominator, in z - 1; C2 is [0] without an observer."""
        force, poles = self._series
        law = self.state_feedback
        if law is None:
            return ObserverTransfer(force, [_ZERO], poles)
        observer = _observer(law)
        return ObserverTransfer(
            from_position=product(force, observer.from_position),
            from_force=product(force, observer.from_force),
            poles=product(poles, observer.poles),
        )

    @cached_property
    def stable(self) -> bool:
        """Whether every pole of the law lies inside the unit circle, decided in exact arithmetic."""
        # z = 1 + (z - 1): Horner in the polynomial z - 1 with itself.
        in_z: Polynomial = [_ZERO]
        for coefficient in self.transfer.poles:
            in_z = total(product(in_z, [_ONE, -_ONE]), [coefficient])
        return _inside(in_z)

    @property
    def state_space(self) -> Law:
        """The law as the loops see it: matrices of the rendering behind its observer, from position to force."""
        wall = SampledLoop(
            device_damping_ns_per_m=0.0,
            environment_damping_ns_per_m=self.wall_damping_ns_per_m,
            environment_stiffness_n_per_m=self.wall_stiffness_n_per_m,
            sample_time_s=self.sample_time_s,
            delay_samples=0.0,
            model="sampled-data",
        )
        parts = fractions(wall, np.array([self.damping_ns_per_m]), np.array([self.stiffness_n_per_m]))
        frozen = parts.law(self.contact_damping_ns_per_m, self.sample_time_s).pick(0)
        return frozen.behind(self.state_feedback)

    def document(self) -> dict[str, Any]:
        """Return JSON values; an infinite gain is null."""
        numbers = {name: plain(getattr(self, name)) for name in self._numbers()}
        law = self.state_feedback
        return numbers | {"state_feedback": None if law is None else plain(law.model_dump(exclude={"kind"}))}

    @classmethod
    def from_document(cls, document: dict[str, Any]) -> Self:
        """Read the output of `document`."""
        numbers = {name: math.inf if document[name] is None else float(document[name]) for name in cls._numbers()}
        law = document["state_feedback"] and StateFeedback.model_validate(document["state_feedback"])
        return cls(**numbers, state_feedback=law)

    @classmethod
    def _numbers(cls) -> list[str]:
        return [item.name for item in fields(cls) if item.name != "state_feedback"]


def product(first: Polynomial, second: Polynomial) -> Polynomial:
    """Multiply two polynomials."""
    return list(np.convolve(np.array(first, dtype=object), np.array(second, dtype=object)))


def total(first: Polynomial, second: Polynomial) -> Polynomial:
    """Add two polynomials."""
    return list(np.polyadd(np.array(first, dtype=object), np.array(second, dtype=object)))


def _observer(law: StateFeedback) -> ObserverTransfer:
    """Return the estimated position over position and over force, and the observer's poles, without dead zone.

    With K = I - L m', s = K A s/z + K B F/z + L x and y = R s: y/x = z R (z I - K A)^-1 L and
    y/F = R (z I - K A)^-1 K B, by Faddeev and LeVerrier in exact fractions.
    """
    exact = np.vectorize(Fraction, otypes=[object])
    a = exact(np.array(law.state))
    b = exact(np.array(law.force_m_per_n))
    gain = exact(np.array(law.innovation))
    weight = exact(np.array(law.feedback))
    n = law.states
    eye = exact(np.eye(n))
    keep = eye.copy()
    keep[:, law.measures] -= gain
    # In z - 1: (z - 1) I - (K A - I).
    step = keep @ a - eye
    push = keep @ b
    poles: Polynomial = [_ONE]
    adjugate = eye
    from_position = [weight @ gain]
    from_force = [weight @ push]
    for power in range(1, n + 1):
        image = step @ adjugate
        coefficient = -np.trace(image) / power
        poles.append(coefficient)
        adjugate = image + coefficient * eye
        if power < n:
            from_position.append(weight @ adjugate @ gain)
            from_force.append(weight @ adjugate @ push)
    return ObserverTransfer(product(from_position, [_ONE, _ONE]), from_force, poles)


def _inside(polynomial: Polynomial) -> bool:
    """Return whether all roots of a polynomial lie inside the unit circle, by Schur and Cohn, in exact fractions."""
    while polynomial and polynomial[0] == 0:
        polynomial = polynomial[1:]
    if not polynomial:
        return False
    while len(polynomial) > 1:
        first = polynomial[0]
        last = polynomial[-1]
        if abs(last) >= abs(first):
            return False
        share = last / first
        mirrored = zip(polynomial, polynomial[::-1], strict=True)
        polynomial = [coefficient - share * mirror for coefficient, mirror in mirrored][:-1]
        # Dividing keeps the fractions short.
        polynomial = [coefficient / polynomial[0] for coefficient in polynomial]
    return True
