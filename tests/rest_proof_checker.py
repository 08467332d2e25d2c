"""A checker of stored proofs of rest that shares no code with what makes them.

Where proofs fold the spectrum of the held force, this discretises the device exactly; where they cut cells of frequency
and hand, this takes hand after hand and all frequencies at once: Re{M (1 + L)} |denominators|^2 is a polynomial in
cos(omega), whose Bernstein coefficients over [-1, 1], in 80 digits, are positive once the interval is cut often enough.
"""

from __future__ import annotations

import itertools
import math

import mpmath as mp
import numpy as np
from scipy.linalg import expm

DIGITS = 80
GRID = np.concatenate([np.geomspace(1e-4, 0.1, 150), np.linspace(0.1, math.pi, 450)])


def accepts(document, hands=8, seed=0):
    """Whether the multiplier proves rest with every corner of the box and some hands within it, at every frequency."""
    law, device = document["law"], document["device"]
    assert law["state_feedback"] is None
    assert device["resonance"] is None
    assert device["amplifier_bandwidth_hz"] is None
    if document["outcome"] != "proved" or document["contact"] != "clip-last":
        return False
    taps = {int(lag): float(tap) for lag, tap in document["multiplier"].items()}
    if 0 in taps or min(taps.values(), default=0.0) < 0 or not math.fsum(taps.values()) < 1:
        return False
    numbers = {key: value for key, value in law.items() if key != "state_feedback"}
    if (
        any(value is not None and not value >= 0 for value in numbers.values())
        or device["sample_time_s"] != law["sample_time_s"]
    ):
        return False
    box = [document["hand"][name] for name in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")]
    if any(not 0 <= low <= high for low, high in box) or not box[2][0] > 0:
        return False
    corners = list(itertools.product(*box))
    if not all(_positive_on_grid(device, law, taps, hand) for hand in corners):
        return False
    random = np.random.default_rng(seed)
    drawn = [tuple(random.uniform(low, high) for low, high in box) for _ in range(hands)]
    with mp.workdps(DIGITS):
        return all(_positive_everywhere(device, law, taps, hand) for hand in (*corners, *drawn))


def _mechanics(device, hand, exponential, number):
    """Numerator and denominator of position over force in w = 1/z, the force held: exact discretisation."""
    m, b, k = (
        number(own) + number(held)
        for own, held in zip((device["mass_kg"], device["damping_ns_per_m"], 0.0), hand, strict=True)
    )
    t = number(device["sample_time_s"])
    step = exponential([[0, t, 0], [-k * t / m, -b * t / m, t / m], [0, 0, 0]])
    a, c, f, g, one, two = step[0, 0], step[0, 1], step[1, 0], step[1, 1], step[0, 2], step[1, 2]
    late = int(device["delay_samples"])
    assert late == device["delay_samples"]
    return [0] * (late + 1) + [one, c * two - g * one], [1, -(a + g), a * g - c * f]


def _coupling(law, number):
    """Numerator and denominator of force over position in w: coupling and wall in series, and the contact damper."""
    t = number(law["sample_time_s"])

    def joint(damping, stiffness):
        rate = number(damping) / t
        return [number(stiffness) + rate, -rate]

    wall = joint(law["wall_damping_ns_per_m"], law["wall_stiffness_n_per_m"])
    damper = joint(law["contact_damping_ns_per_m"], 0.0)
    if law["damping_ns_per_m"] is None or law["stiffness_n_per_m"] is None:
        return _sum(wall, damper), [number(1)]
    own = joint(law["damping_ns_per_m"], law["stiffness_n_per_m"])
    both = _sum(own, wall)
    return _sum(_product(own, wall), _product(damper, both)), both


def _parts(device, law, hand, exponential, number):
    mechanics, poles = _mechanics(device, hand, exponential, number)
    force, series = _coupling(law, number)
    below = _product(poles, series)
    return _sum(below, _product(mechanics, force)), below


def _positive_on_grid(device, law, taps, hand):
    above, below = _parts(device, law, hand, lambda rows: expm(np.array(rows, dtype=float)), float)
    w = np.exp(-1j * GRID)
    multiplier = 1 - sum(tap * w**lag for lag, tap in taps.items())
    return bool((multiplier * np.polyval(above[::-1], w) / np.polyval(below[::-1], w)).real.min() > 0)


def _positive_everywhere(device, law, taps, hand):
    above, below = _parts(device, law, hand, lambda rows: mp.expm(mp.matrix(rows)), mp.mpf)
    found = {}
    around = {0: mp.mpf(1)} | {lag: -mp.mpf(tap) for lag, tap in taps.items()}
    for (lag, tap), (i, one), (j, other) in itertools.product(around.items(), enumerate(above), enumerate(below)):
        turns = abs(lag + i - j)
        found[turns] = found.get(turns, mp.mpf(0)) + tap * one * other
    power = _from_chebyshev([found.get(n, mp.mpf(0)) for n in range(max(found) + 1)])
    return _positive(_bernstein(power))


def _from_chebyshev(coefficients):
    """Sum of c_n T_n as a polynomial, lowest power first."""
    last, now = [mp.mpf(1)], [mp.mpf(0), mp.mpf(1)]
    total = [coefficients[0]]
    for coefficient in coefficients[1:]:
        total = _sum(total, [coefficient * value for value in now])
        last, now = now, _sum([mp.mpf(0), *(2 * value for value in now)], [-value for value in last])
    return total


def _bernstein(power):
    """Bernstein coefficients over [-1, 1] of a polynomial, lowest power first."""
    n = len(power) - 1
    # In u of x = 2 u - 1.
    shifted = [mp.mpf(0)] * (n + 1)
    for degree, coefficient in enumerate(power):
        for part in range(degree + 1):
            shifted[part] += coefficient * mp.binomial(degree, part) * mp.mpf(2) ** part * (-1) ** (degree - part)
    return [sum(mp.binomial(i, j) / mp.binomial(n, j) * shifted[j] for j in range(i + 1)) for i in range(n + 1)]


def _positive(coefficients, depth=60):
    open_ = [(coefficients, depth)]
    while open_:
        some, left = open_.pop()
        if min(some) > 0:
            continue
        if some[0] <= 0 or some[-1] <= 0 or left == 0:
            return False
        low, high, row = [some[0]], [some[-1]], some
        while len(row) > 1:
            row = [(one + other) / 2 for one, other in itertools.pairwise(row)]
            low.append(row[0])
            high.append(row[-1])
        open_ += [(low, left - 1), (high[::-1], left - 1)]
    return True


def _product(one, other):
    found = [0] * (len(one) + len(other) - 1)
    for (i, left), (j, right) in itertools.product(enumerate(one), enumerate(other)):
        found[i + j] = found[i + j] + left * right
    return found


def _sum(one, other):
    return [left + right for left, right in itertools.zip_longest(one, other, fillvalue=0)]
