"""How a mass on a spring and a damper moves within one sample: its power series with the remainder enclosed.

In units of the sample time, u'' + beta u' + kappa u = 0 with u(0) = 0 and u'(0) = 1: phi(s) = u(s), and psi(s) its
integral from 0, which is the step response. With c(n) = n! times the coefficient of s^n in u,

    c(0) = 0, c(1) = 1, c(n+2) = -beta c(n+1) - kappa c(n),    |c(n)| <= q^(n-1) for q >= beta + sqrt(kappa),

for q^2 >= beta q + kappa. The same sequence with plus signs has coefficients that are not negative and is convex, so
that its derivatives are at most its value with beta or kappa greater by 1.
"""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.prove.interval import Interval, Jet

_REMAINDER = 1e-18
_MOST_TERMS = 120


def oscillator(
    beta: Interval, kappa: Interval, late: Jet[Interval] | None = None
) -> tuple[Jet[Interval], Jet[Interval]]:
    """Enclose phi and psi over cells of beta and kappa, neither negative.

    Args:
        beta: damping times sample time over mass, shape (n,).
        kappa: stiffness times sample time squared over mass, shape (n,).
        late: s in [0, 1] with its slopes, of which the last belongs to s; None takes s = 1.

    Returns:
        phi and psi; slopes along beta, kappa and, where it is given, s.
    """
    variables = 2 if late is None else 3
    zero = np.zeros((variables, *beta.shape))

    def variable(value: Interval, index: int) -> Jet[Interval]:
        unit = zero.copy()
        unit[index] = 1.0
        return Jet(value, Interval.of(unit))

    damping, spring = variable(beta, 0), variable(kappa, 1)
    reach = (beta + (kappa + 1.0).sqrt() + 1.0).high
    terms, left = _terms(reach)
    before, now = (Jet(Interval.of(np.full(beta.shape, start)), Interval.of(zero)) for start in (0.0, 1.0))
    series = [now]
    for _ in range(terms - 1):
        before, now = now, -(damping * now + spring * before)
        series.append(now)
    # Horner's scheme: u = s (c1 + s/2 (c2 + s/3 (c3 + ...))), and one place further for the integral.
    phi, psi = (Jet(Interval.of(np.zeros(beta.shape)), Interval.of(zero)) for _ in range(2))
    for n in range(terms, 0, -1):
        phi, psi = ((one + series[n - 1]) for one in (phi, psi))
        if late is not None:
            phi, psi = phi * late, psi * late
        phi, psi = _over(phi, n), _over(psi, n + 1)
    if late is not None:
        psi = psi * late
    spread = Interval(-left, left)
    return Jet(phi.value + spread, phi.slope + spread), Jet(psi.value + spread, psi.slope + spread)


def _over(one: Jet[Interval], number: int) -> Jet[Interval]:
    return Jet(one.value / float(number), one.slope / float(number))


def _terms(reach: FloatArray) -> tuple[int, FloatArray]:
    """Return how many terms are summed, and the bound of all that follow and of their slopes."""
    terms = 8
    while True:
        q = Interval.of(reach)
        power = Interval.of(np.ones_like(reach))
        for n in range(1, terms + 1):
            power = power * q / float(n)
        left = (power / (1.0 - q / float(terms + 1))).high
        bound = np.where(reach < terms, left, np.inf)
        if terms >= _MOST_TERMS or bool((bound < _REMAINDER).all()):
            return terms, bound
        terms += 4
