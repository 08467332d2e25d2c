"""Random loops whose worst hand may stand inside the box, and brute force over a lattice of hands."""

import itertools

import numpy as np

from avc_casadi.files.problem_file import load_problem
from avc_casadi.loops.stable_walls import in_contact
from avc_casadi.loops.wall import frozen_law, linear_stability
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import Hand, hand_ranges

FIGURE5 = load_problem("figure5")
WALL = {"damping_ns_per_m": 0.7, "stiffness_n_per_m": 4650.0}
INSIDE = FIGURE5.changed(
    device={"mass_kg": 0.02, "damping_ns_per_m": 14.0, "delay_samples": 4},
    environment=WALL,
    boundaries={"upper": WALL, "lower": WALL},
    stability={"scope": "hands"},
    frequency={"start_hz": 3.3, "stop_hz": 3.3, "points": 1},
)
"""Its best gains by the corners of the box, 562.19 N.s/m and no stiffness, break with a hand of 0.111 kg."""


def random_problem(generator):
    """A device, a wall and a box of hands; every other one has a delay that is not whole."""

    def between(low, high):
        return float(np.exp(generator.uniform(np.log(low), np.log(high))))

    mass, damping, stiffness = between(0.02, 0.1), between(0.5, 5.0), between(30.0, 400.0)
    whole = generator.random() < 0.5
    return FIGURE5.changed(
        device={
            "mass_kg": between(0.01, 0.5),
            "damping_ns_per_m": between(0.1, 20.0),
            "delay_samples": int(generator.integers(0, 5)) if whole else float(generator.uniform(0.0, 4.0)),
        },
        environment={"damping_ns_per_m": between(0.1, 5.0), "stiffness_n_per_m": between(500.0, 3e4)},
        boundaries={
            "upper": {"damping_ns_per_m": 1e3, "stiffness_n_per_m": 1e6},
            "lower": {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 0.0},
        },
        hands={
            "mass_kg": (mass, mass * between(1.5, 8.0)),
            "damping_ns_per_m": (damping, damping * between(1.5, 10.0)),
            "stiffness_n_per_m": (stiffness, stiffness * between(1.5, 8.0)),
        },
    )


def random_gains(generator, rows):
    """b, k and b_p, (rows,) each; half of them dampers alone, and half without a contact damper."""
    b = np.exp(generator.uniform(0.0, np.log(1e3), rows))
    k = np.exp(generator.uniform(np.log(10.0), np.log(1e5), rows)) * (generator.random(rows) < 0.5)
    return b, k, np.where(generator.random(rows) < 0.5, 0.0, generator.uniform(0.0, 50.0, rows))


def brute_force(problem, b, k, contact, points=9):
    """Largest spectral radius over a lattice of the box, (rows,)."""
    axes = [np.linspace(low, high, points) for low, high in hand_ranges(problem.hands)]
    hands = Hand(*np.array(list(itertools.product(*axes))).T)
    return linear_stability(problem.device, frozen_law(problem, b, k, contact), hands).radius.max(axis=1)


def loop_radius(device, people, stiffness, damping):
    """Of walls with each hand at the device's worst corner, shape (walls, hands)."""
    walls = zip(stiffness, damping, strict=True)
    radius = [in_contact(device_corners(device, LINEAR_KEYS), people, float(k), float(b)).radius for k, b in walls]
    return np.reshape(radius, (len(radius), -1, len(people))).max(axis=1)
