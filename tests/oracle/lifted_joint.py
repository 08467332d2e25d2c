"""A joint in an engine, step by step in time with SciPy's matrix exponential: shares no code with the package."""

import numpy as np
from scipy.linalg import expm


def map_of_step(mass, drag, step_s, kp, kd, *, integrator="semi-implicit", substeps=1, late=0, difference=False,
                spring=0.0):  # fmt: skip
    """Return the map of (x, v, x before, forces under way) over a step, column by column from unit states."""
    size = 3 + late

    def stepped(state):
        x, v, before = state[:3]
        waiting = list(state[3:])
        speed = (x - before) / step_s if difference else v
        solved_k = kp if integrator == "implicit" else 0.0
        solved_d = kd if integrator.startswith("implicit") else 0.0
        waiting.append((kp - solved_k) * x + (kd - solved_d) * speed)
        force = -waiting.pop(0)
        h = step_s / substeps
        last = x
        for _ in range(substeps):
            k, d = spring + solved_k, drag + solved_d
            if integrator == "exact":
                x, v, _ = expm(np.array([[0, 1, 0], [-k / mass, -d / mass, 1 / mass], [0, 0, 0]]) * h) @ [x, v, force]
            elif integrator == "explicit":
                x, v = x + h * v, v + h * (force - k * x - d * v) / mass
            elif integrator == "semi-implicit":
                v = v + h * (force - k * x - d * v) / mass
                x = x + h * v
            else:  # m (v+ - v) = h (F - k (x + h v+ where solved) - d v+)
                solves = h * k if integrator == "implicit" else 0.0
                v = (mass * v + h * (force - k * x)) / (mass + h * (d + solves))
                x = x + h * v
        return np.array([x, v, last, *waiting])

    return np.array([stepped(column) for column in np.eye(size)]).T


def radius(*joint, **how):
    """Return the spectral radius of the map."""
    return np.abs(np.linalg.eigvals(map_of_step(*joint, **how))).max()
