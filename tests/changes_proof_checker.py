"""A checker of stored proofs of changing gains (L8) that shares no code with what makes them.

The loop comes from the equations of coupling, wall and mechanics. In corners, middle and draws of each cell of hands
every allowed change of rows must shrink every state: P_a - A' P_b A is positive definite, decided by Cholesky's
factors in 40 digits. Together the cells must fill the box.
"""

from __future__ import annotations

import itertools

import mpmath as mp
import numpy as np
from scipy.linalg import expm

DIGITS = 40


def accepts(document, problem, draws=4, seed=0):
    """Whether a `Changing` document proves its rows before the device, wall and hands of a problem."""
    device, gains = problem["device"], document["gains"]
    cells = [
        tuple(np.array(cell[name], dtype=float) for name in ("low", "high", "roots")) for cell in document["cells"]
    ]
    random = np.random.default_rng(seed)
    return (
        document["outcome"] == "proved"
        and document["order"] in ("any", "neighbours")
        and _known(device)
        and all(gain is None or gain >= 0 for row in gains for gain in row)
        and None not in gains[2]
        and _fill(cells, *_box(device, problem["hands"]))
        and all(_holds(cell, document, problem, draws, random) for cell in cells)
    )


def _known(device):
    """Rigid, with an ideal amplifier and a whole delay that is known."""
    whole = device["delay_samples"] == int(device["delay_samples"]) and device["range"].get("delay_samples") is None
    return whole and device["resonance"] is None and device["amplifier_bandwidth_hz"] is None


def _holds(cell, document, problem, draws, random):
    low, high, roots = cell
    gains, device = document["gains"], problem["device"]
    rows, size = len(gains[0]), 4 + int(device["delay_samples"])
    forms = np.swapaxes(roots, 1, 2) @ roots if roots.ndim == 3 else np.empty(0)
    if roots.shape != (rows, size, size) or not (np.isfinite(roots).all() and np.linalg.eigvalsh(forms).min() > 0):
        return False
    allowed = [
        (before, after)
        for before, after in itertools.product(range(rows), repeat=2)
        if document["order"] == "any" or abs(before - after) <= 1
    ]
    shares = [*itertools.product((0.0, 1.0), repeat=3), (0.5, 0.5, 0.5), *random.uniform(size=(draws, 3))]
    for number, share in enumerate(shares):
        point = low + np.array(share) * (high - low)
        loops = [
            _loop(device, problem["environment"], problem["hands"], [row[i] for row in gains], point)
            for i in range(rows)
        ]
        if not all(_shrinks(loops[a], forms[a], forms[b], exact=number < 8) for a, b in allowed):
            return False
    return True


def _box(device, hands):
    """1 over all mass, damping, stiffness: lower and upper corner."""
    ends = [
        np.add(device["range"].get(name) or (device[name],) * 2, hands[name])
        for name in ("mass_kg", "damping_ns_per_m")
    ]
    spring = hands["stiffness_n_per_m"]
    return (1 / ends[0][1], ends[1][0], spring[0]), (1 / ends[0][0], ends[1][1], spring[1])


def _fill(cells, low, high):
    """Cut at every side of every cell, the middle of each piece lies in one."""
    if not cells or any((one > other).any() for one, other, _ in cells):
        return False
    middles = []
    for side in range(3):
        ends = {low[side] * (1 + 1e-12), high[side] * (1 - 1e-12)}
        ends |= {min(max(cell[upper][side], low[side]), high[side]) for cell in cells for upper in (0, 1)}
        ends = sorted(ends)
        middles.append([0.5 * (one + other) for one, other in itertools.pairwise(ends)] if len(ends) > 1 else ends)
    return all(
        any((one <= point).all() and (point <= other).all() for one, other, _ in cells)
        for point in itertools.product(*middles)
    )


def _loop(device, wall, hands, gains, point):
    """x, v T, the x before, the joint before, forces under way in the distance they move the lightest mass."""
    lightness, damping, stiffness = point
    t, late = device["sample_time_s"], int(device["delay_samples"])
    rate = np.array([[0.0, 1.0, 0.0], [-stiffness * lightness, -damping * lightness, lightness], [0.0, 0.0, 0.0]]) * t
    step = expm(rate)
    b, k, contact = gains
    b_e, k_e = wall["damping_ns_per_m"], wall["stiffness_n_per_m"]
    joint = np.array([1.0, 0.0, 0.0])
    if b is not None and k is not None:
        joint = np.array([k + b / t, -b / t, (b + b_e) / t]) / (k + k_e + (b + b_e) / t)
    force = (k_e + b_e / t) * joint + np.array([contact / t, -contact / t, -b_e / t])
    size = 4 + late
    found = np.zeros((size, size))
    found[:2, :2] = step[:2, :2] * [[1.0, 1 / t], [t, 1.0]]
    found[2, 0] = 1.0
    found[3, [0, 2, 3]] = joint
    moved = step[:2, 2] * [1.0, t]
    unit = t**2 / (device["mass_kg"] + hands["mass_kg"][0])
    if not late:
        found[:2, [0, 2, 3]] -= np.outer(moved, force)
        return found
    found[4, [0, 2, 3]] = force * unit
    for place in range(5, size):
        found[place, place - 1] = 1.0
    found[:2, -1] -= moved / unit
    return found


def _shrinks(loop, before, after, *, exact):
    change = before - loop.T @ after @ loop
    if not np.linalg.eigvalsh(change / np.abs(before).max()).min() > 0:
        return False
    if not exact:
        return True
    with mp.workdps(DIGITS):
        a, one, other = (mp.matrix(part.tolist()) for part in (loop, before, after))
        change = one - a.T * other * a
        try:
            mp.cholesky((change + change.T) / 2)
        except ValueError:
            return False
    return True
