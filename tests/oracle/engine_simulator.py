"""A device, a hand and an engine with its tool, sample by sample in plain Python: shares nothing with the project."""

import math

import numpy as np
from scipy.linalg import expm


class EngineSimulator:
    """One axis, numbers as in a problem file.

    A device is mass, damping, T and delay in samples; a hand mass, damping and stiffness, 0 where it is released; a
    tool mass and damping, in contact with nothing (None), (k_c, b_c) on both sides or a rigid "wall" at x = 0. The
    first step of the engine comes a share `phase` of T after a sample.
    """

    def __init__(
        self,
        device,
        hand,
        tool,
        step_s,
        integrator="semi-implicit",
        exchange="on-time",
        steps_late=0,
        contact=None,
        phase=0.0,
        substeps=1,
    ):
        mass, damping, self.T, self.delay = device
        hand_mass, hand_damping, hand_stiffness = hand
        m, b = mass + hand_mass, damping + hand_damping
        # Position, velocity, force, and position and velocity of the hand's target.
        rate = np.zeros((5, 5))
        rate[0, 1] = rate[3, 4] = 1
        rate[1] = [-hand_stiffness / m, -b / m, -1 / m, hand_stiffness / m, hand_damping / m]
        self.step = expm(rate * self.T)[:2]
        self.tool_mass, self.tool_damping = tool
        self.step_s, self.integrator, self.exchange = step_s, integrator, exchange
        self.late = steps_late + (exchange == "late")
        self.contact, self.phase, self.substeps = contact, phase, substeps
        self.motor = 1.0  # its force over what is asked of it

    def run(self, stiffness, damping, samples, *, local=0.0, target=None, start=0.0, kick=0.0, force=8.0, drop=None):
        """Return positions of device and tool at each sample, before a step of the engine there.

        `local` is the device's own damper, `kick` its speed at the beginning, `drop` which steps the engine misses; the
        hand's target moves evenly between the samples.
        """
        x, v = start, kick
        held = [0.0] * self.delay
        tool, speed = min(start, 0.0) if self.contact == "wall" else start, 0.0
        last, older = start, start
        queue = [0.0 if self.exchange == "held-force" else (tool, speed)] * (self.late + 1)
        count, found = 0, []
        aims = np.zeros(samples + 1) if target is None else np.append(target, target[-1])
        for k in range(samples):
            found.append((x, tool))
            # A step within this sample sees it; one since the last sample saw that one.
            while (count * self.step_s + self.phase * self.T) / self.T <= k + 1e-9:
                fresh = abs((count * self.step_s + self.phase * self.T) / self.T - k) < 1e-6
                seen, rate = (x, (x - last) / self.T) if fresh else (last, (last - older) / self.T)
                if drop is None or count not in drop:
                    before = (tool, speed)
                    asked = stiffness * (seen - tool) + damping * (rate - speed)
                    tool, speed = self._moved(tool, speed, seen, rate, stiffness, damping)
                    handed = {"held-force": asked, "ahead": (tool, speed)}.get(self.exchange, before)
                    queue = [*queue[1:], handed]
                count += 1
            rate = (x - last) / self.T
            given = queue[0]
            pull = given if self.exchange == "held-force" else stiffness * (x - given[0]) + damping * (rate - given[1])
            pull = float(np.clip(pull + local * rate, -force, force))
            held.append(self.motor * pull)
            now = held.pop(0)
            last, older = x, last
            x, v = self.step @ np.array([x, v, now, aims[k], (aims[k + 1] - aims[k]) / self.T])
        return np.array(found).T

    def _moved(self, x, v, seen, rate, k, b):
        """One step: the engine solves in each internal step what its integrator has, the rest of the force is held."""
        if math.isinf(self.tool_mass):
            return 0.0, 0.0
        held = k * seen + b * rate
        if self.integrator != "implicit":
            held, k = held - k * x, 0.0
        if self.integrator[:8] != "implicit":
            held, b = held - b * v, 0.0
        for _ in range(self.substeps):
            x, v = self._internal(x, v, held, k, b)
        return x, v

    def _internal(self, x, v, held, k, b):
        m, d, t = self.tool_mass, self.tool_damping, self.step_s / self.substeps
        k_c, b_c = self.contact if isinstance(self.contact, tuple) else (0.0, 0.0)
        wall = self.contact == "wall"
        if self.integrator == "exact":
            rate = np.array([[0, 1, 0], [-k_c / m, -(d + b_c) / m, 1 / m], [0, 0, 0]])
            place, after = (expm(rate * t) @ [x, v, held])[:2]
        elif self.integrator == "implicit":
            after = (m * v + t * (held - (k + k_c) * x)) / (m + t * (d + b + b_c) + t * t * (k + k_c))
        elif self.integrator == "implicit-damping":
            after = (m * v + t * (held - k_c * x)) / (m + t * (d + b + b_c))
        else:
            after = v + t / m * (held - (d + b_c) * v - k_c * x)
        if self.integrator == "explicit":
            place = x + t * v
        if self.integrator in ("explicit", "exact"):
            return (0.0, min(after, 0.0)) if wall and place >= 0 else (place, after)
        if wall:
            after = min(after, -x / t)
        return x + t * after, after
