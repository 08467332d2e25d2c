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
HAND = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
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
    box = [document["hand"][name] for name in HAND]
    if box[2][0] <= 0 or any(not 0 <= low <= high for low, high in box):
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
    m, b, t = (number(device[name]) for name in ("mass_kg", "damping_ns_per_m", "sample_time_s"))
    held = [number(value) for value in hand]
    m, b, k = m + held[0], b + held[1], held[2]
    rate = [[0, 1, 0], [-k / m, -b / m, 1 / m]]
    n = len(rate)
    step = exponential([[t * value for value in row] for row in (*rate, [0] * (n + 1))])
    above, poles = _transfer([[step[i, j] for j in range(n)] for i in range(n)], [step[i, n] for i in range(n)])
    late = int(device["delay_samples"])
    assert late == device["delay_samples"]
    return [0] * (late + 1) + above, poles


def _transfer(step, push):
    """First state over push, in w, by Faddeev and LeVerrier."""
    n = len(step)
    adjugate = [[int(i == j) for j in range(n)] for i in range(n)]
    above, poles = [push[0]], [1]
    for power in range(1, n + 1):
        moved = [[sum(step[i][k] * adjugate[k][j] for k in range(n)) for j in range(n)] for i in range(n)]
        poles.append(-sum(moved[i][i] for i in range(n)) / power)
        adjugate = [[moved[i][j] + (poles[-1] if i == j else 0) for j in range(n)] for i in range(n)]
        above.append(sum(one * other for one, other in zip(adjugate[0], push, strict=True)))
    return above[:n], poles


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
