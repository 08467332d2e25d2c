"""A checker of stored proofs over hands (L5) that shares no code with what makes them.

The cells are made anew from the stored cuts: halving fills the box whatever the cuts are. In each cell the
characteristic function, from a discretisation of its own, is looked at in corners and at points drawn within; the cells
along the unit circle give way to the eigenvalues at their point of the box, from the loop written as equations.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.linalg import expm

SIDES = ("angle", "mass_kg", "damping_ns_per_m", "stiffness_n_per_m", "fraction")


def accepts(document, problem, draws=4, seed=0):
    """Whether a `HandsProof` document proves one row of gains before the device, wall and hands of a problem."""
    gains, device, hands = document["gains"], problem["device"], problem["hands"]
    random = np.random.default_rng(seed)
    return (
        document["outcome"] == "proved"
        and device["resonance"] is None
        and device["amplifier_bandwidth_hz"] is None
        and _means(gains, problem)
        and bool(document["pieces"])
        and _delays_covered(document["pieces"], device)
        and all(_piece_holds(piece, gains, device, hands, draws, random) for piece in document["pieces"])
    )


def _means(gains, problem):
    """One row, none of it negative, before the wall and at the sample time of the problem."""
    device, wall = problem["device"], problem["environment"]
    rows = [gains[name] for name in ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")]
    told = gains["wall_damping_ns_per_m"], gains["wall_stiffness_n_per_m"], gains["sample_time_s"]
    return (
        all(len(row) == 1 and (row[0] is None or row[0] >= 0) for row in rows)
        and rows[2][0] is not None
        and told == (wall["damping_ns_per_m"], wall["stiffness_n_per_m"], device["sample_time_s"])
    )


def _ends(device, key):
    spread = device["range"].get(key)
    return (device[key], device[key]) if spread is None else tuple(spread)


def _delays_covered(pieces, device):
    low, high = _ends(device, "delay_samples")
    if low == high:
        return len(pieces) == 1 and pieces[0]["fraction"] is not None and _delay(pieces[0]) == low
    reached = low
    for piece in sorted(pieces, key=lambda one: one["whole_delay"]):
        if piece["fraction"] is not None or len(piece["low"]) != 5 or piece["whole_delay"] + piece["low"][4] > reached:
            return False
        reached = piece["whole_delay"] + piece["high"][4]
    return reached >= high


def _delay(piece):
    return piece["whole_delay"] + piece["fraction"]


def _piece_holds(piece, gains, device, hands, draws, random):
    low, high, point = (np.array(piece[name], dtype=float) for name in ("low", "high", "point"))
    turns = np.array(piece["cells"]["half_plane_rad"], dtype=float)
    sides = 4 if piece["fraction"] is not None else 5
    if not (len(low) == len(high) == len(point) + 1 == sides and _holds_box(low, high, device, hands)):
        return False
    cells = _cells(low, high, piece["cells"]["cuts"])
    if cells is None or len(turns) != len(cells[0]) or (point < low[1:]).any() or (point > high[1:]).any():
        return False
    delay = _delay(piece) if piece["fraction"] is not None else piece["whole_delay"] + point[3]
    if not (delay >= 0 and _radius(gains, point, delay) < 1 - 1e-9):
        return False
    shares = np.array(list(itertools.product((0.0, 1.0), repeat=sides)))
    shares = np.concatenate([shares, random.uniform(size=(draws, sides))])
    points = cells[0][:, None] + shares * (cells[1] - cells[0])[:, None]
    value = _characteristic(gains, piece, points.reshape(-1, sides).T).reshape(len(turns), -1)
    return bool(((value * np.exp(-1j * turns)[:, None]).real > 0).all())


def _holds_box(low, high, device, hands):
    """Whether a box holds half the unit circle, and every hand with every device."""
    if not (low <= high).all() or low[0] > 0 or high[0] < math.pi or not low[1] > 0:
        return False
    own = _ends(device, "mass_kg"), _ends(device, "damping_ns_per_m"), (0.0, 0.0)
    return all(
        low[side] <= least + hands[name][0] and high[side] >= most + hands[name][1]
        for side, name, (least, most) in zip((1, 2, 3), SIDES[1:4], own, strict=True)
    )


def _cells(low, high, cuts):
    """Corners of the cells, (n, v) each; None where the cuts are no tree."""
    waiting, lows, highs = [(tuple(low), tuple(high))], [], []
    for letter in cuts:
        if not waiting:
            return None
        first, last = waiting.pop()
        if letter == ".":
            lows.append(first)
            highs.append(last)
            continue
        if not letter.isdecimal() or int(letter) >= len(low):
            return None
        side = int(letter)
        middle = 0.5 * first[side] + 0.5 * last[side]
        waiting.append(((*first[:side], middle, *first[side + 1 :]), last))
        waiting.append((first, (*last[:side], middle, *last[side + 1 :])))
    return None if waiting or not lows else (np.array(lows), np.array(highs))


def _moves(mass, damping, stiffness, held):
    """State x, v after a stretch of time with a held force: step (n, 2, 2) and push (n, 2)."""
    rate = np.zeros((len(mass), 3, 3))
    rate[:, 0, 1] = held
    rate[:, 1] = np.stack([-stiffness / mass, -damping / mass, 1 / mass], axis=1) * np.reshape(held, (-1, 1))
    found = expm(rate)
    return found[:, :2, :2], found[:, :2, 2]


def _mechanics(gains, mass, damping, stiffness, late):
    """Step, what the newer force moves and what the older one does."""
    t = gains["sample_time_s"] * np.ones_like(mass)
    step, whole = _moves(mass, damping, stiffness, t)
    newer = _moves(mass, damping, stiffness, (1 - late) * t)[1] if np.any(late) else whole
    return step, newer, whole - newer


def _characteristic(gains, piece, points):
    """z^2 (series poles x mechanics' poles + force x mechanics) in w = 1/z, by points of shape (v, n)."""
    angle, mass, damping, stiffness = points[:4]
    late = points[4] if len(points) == 5 else piece["fraction"] * np.ones_like(mass)
    step, newer, older = _mechanics(gains, mass, damping, stiffness, late)
    w = np.exp(-1j * angle)
    a, b, c, d = step[:, 0, 0], step[:, 0, 1], step[:, 1, 0], step[:, 1, 1]
    poles = 1 - (a + d) * w + (a * d - b * c) * w**2
    pushed = sum(
        w ** (1 + more) * (push[:, 0] + w * (b * push[:, 1] - d * push[:, 0]))
        for more, push in enumerate((newer, older))
    )
    force, series = _rendering(gains, w)
    return w**-2 * (poles * series + pushed * w ** piece["whole_delay"] * force)


def _rendering(gains, w):
    """Force over position of coupling, wall and contact damper: numerator and denominator at w."""
    t = gains["sample_time_s"]
    b, k, contact = (gains[f"{name}_ns_per_m" if "damping" in name else name][0] for name in _ROW)
    wall = gains["wall_stiffness_n_per_m"] + gains["wall_damping_ns_per_m"] / t * (1 - w)
    damper = contact / t * (1 - w)
    if b is None or k is None:
        return wall + damper, np.ones_like(w)
    own = k + b / t * (1 - w)
    return own * wall + damper * (own + wall), own + wall


_ROW = ("damping", "stiffness_n_per_m", "contact_damping")


def _radius(gains, point, delay):
    """Spectral radius of the loop as equations from sample to sample, with all that moves of a point."""
    whole = int(delay)
    late, size = delay - whole, 4 + math.ceil(delay)
    mass, damping, stiffness = (np.array([value]) for value in point[:3])
    step, newer, older = (part[0] for part in _mechanics(gains, mass, damping, stiffness, np.array([late])))
    loop = np.zeros((size, size))
    joint, force = _equations(gains)
    loop[:2, :2] = step
    loop[2, 0] = 1.0
    loop[3, [0, 2, 3]] = joint
    under_way = np.zeros((2 + math.ceil(delay), size))
    under_way[0, [0, 2, 3]] = force
    for place in range(4, size):
        under_way[place - 3, place] = 1.0
    for place in range(4, size):
        loop[place] = under_way[place - 4]
    loop[:2] -= np.outer(newer, under_way[whole]) + np.outer(older, under_way[whole + 1])
    return np.abs(np.linalg.eigvals(loop)).max()


def _equations(gains):
    """Joint and force from x, the x before and the joint before."""
    t = gains["sample_time_s"]
    b, k, contact = (gains[f"{name}_ns_per_m" if "damping" in name else name][0] for name in _ROW)
    b_e, k_e = gains["wall_damping_ns_per_m"], gains["wall_stiffness_n_per_m"]
    if b is None or k is None:
        joint = np.array([1.0, 0.0, 0.0])
    else:
        all_ = k + k_e + (b + b_e) / t
        joint = np.array([k + b / t, -b / t, (b + b_e) / t]) / all_
    force = (k_e + b_e / t) * joint + np.array([contact / t, -contact / t, -b_e / t])
    return joint, force
