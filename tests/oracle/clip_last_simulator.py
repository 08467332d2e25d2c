"""A loop that clips its force last, simulated by its equations: nothing of the project is imported.

Device (rigid, or motor and handle), amplifier of first order, delay whole or not, hands of mass, spring and damper
that move with it, or on a stylus; coupling, contact damper and wall by their differences, solved for the tool at each
sample.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


class Simulator:
    """h hands at once.

    `device`: mass_kg, damping_ns_per_m, sample_time_s, delay_samples, amplifier_bandwidth_hz, resonance
    (frequency_hz, damping_ratio, mass_ratio), max_force_n. `gains`: b, k, b_p, b_e, k_e; b or k infinite for a rigid
    coupling. `hands`: by name, arrays of shape (h,).
    """

    def __init__(self, device, gains, hands, target_m):
        self.device, self.gains = device, gains
        self.target = np.asarray(target_m, dtype=float)
        h = len(self.target)
        mode, rate = device.get("resonance"), device.get("amplifier_bandwidth_hz")
        stylus = "arm_stiffness_n_per_m" in hands
        bodies = ["motor"] + ["handle"] * bool(mode) + ["hand"] * stylus
        n = 2 * len(bodies) + bool(rate)
        mass = {"motor": np.full(h, device["mass_kg"])}
        links = [("motor", None, np.zeros(h), np.full(h, device["damping_ns_per_m"]), False)]
        if mode:
            share, whole = mode["mass_ratio"], device["mass_kg"]
            mass = {"motor": np.full(h, (1 - share) * whole), "handle": np.full(h, share * whole)}
            omega, reduced = 2 * np.pi * mode["frequency_hz"], share * (1 - share) * whole
            spring = np.full(h, reduced * omega**2)
            links.append(("motor", "handle", spring, np.full(h, 2 * mode["damping_ratio"] * omega * reduced), False))
        grip = "handle" if mode else "motor"
        if stylus:
            mass["hand"] = np.asarray(hands["mass_kg"], dtype=float)
            links.append((grip, "hand", hands["grip_stiffness_n_per_m"], hands["grip_damping_ns_per_m"], False))
            links.append(("hand", None, hands["arm_stiffness_n_per_m"], hands["arm_damping_ns_per_m"], True))
        else:
            mass[grip] = mass[grip] + np.asarray(hands["mass_kg"], dtype=float)
            links.append((grip, None, hands["stiffness_n_per_m"], hands["damping_ns_per_m"], True))
        at = {body: 2 * place for place, body in enumerate(bodies)}
        whole = np.zeros((h, n + 1, n + 1))
        constant = np.zeros((h, n))
        for body, place in at.items():
            whole[:, place, place + 1] = 1.0
            for one, other, k, b, to_target in links:
                if body not in (one, other):
                    continue
                far = other if body == one else one
                whole[:, place + 1, place] -= k / mass[body]
                whole[:, place + 1, place + 1] -= b / mass[body]
                if far is not None:
                    whole[:, place + 1, at[far]] += k / mass[body]
                    whole[:, place + 1, at[far] + 1] += b / mass[body]
                elif to_target:
                    constant[:, place + 1] += k / mass[body] * self.target
        if rate:
            rate *= 2 * np.pi
            whole[:, 1, n - 1] = -1 / mass["motor"]
            whole[:, n - 1, n - 1], whole[:, n - 1, n] = -rate, rate
        else:
            whole[:, 1, n] = -1 / mass["motor"]
        self.n = n
        late = device["delay_samples"]
        self.whole_delay, share = int(late), late - int(late)
        t = device["sample_time_s"]
        both = np.zeros((h, n + 2, n + 2))
        both[:, : n + 1, : n + 1] = whole
        both[:, :n, n + 1] = constant
        self.steps = [expm(both * (part * t)) for part in (share, 1 - share)]
        self.state = np.zeros((h, n))
        self.under_way = np.zeros((h, self.whole_delay + 2))
        self.before = np.zeros(h)
        self.tool = np.zeros(h)

    def start(self, position, velocity, before=None, tool=None, under_way=None):
        """Set all bodies in motion together; what the law remembers is as if it had stood still, unless it is given."""
        bodies = self.n // 2
        self.state[:, 0 : 2 * bodies : 2] = np.asarray(position)[:, None]
        self.state[:, 1 : 2 * bodies : 2] = np.asarray(velocity)[:, None]
        self.before = np.array(position if before is None else before, dtype=float)
        self.tool = np.array(self.before if tool is None else tool, dtype=float)
        if under_way is not None:
            self.under_way[:, : under_way.shape[1]] = under_way

    def force(self):
        """The force for this sample; the law remembers it."""
        g, t, x = self.gains, self.device["sample_time_s"], self.state[:, 0]
        if np.isinf(g["b"]) or np.isinf(g["k"]):
            tool = x.copy()
        else:
            near, far = g["k"] + g["b"] / t, g["k_e"] + g["b_e"] / t
            past = g["b"] / t * (self.before - self.tool)
            tool = (near * x - past + g["b_e"] / t * self.tool) / (near + far)
        pushed = g["k_e"] * tool + g["b_e"] * (tool - self.tool) / t + g["b_p"] * (x - self.before) / t
        self.before, self.tool = x.copy(), tool
        limit = self.device.get("max_force_n") or np.inf
        return np.clip(pushed, 0.0, limit)

    def step(self):
        """One sample; returns position, velocity and force at its beginning."""
        position, velocity = self.state[:, 0].copy(), self.state[:, 1].copy()
        now = self.force()
        forces = np.concatenate([now[:, None], self.under_way], axis=1)
        new, old = forces[:, self.whole_delay], forces[:, self.whole_delay + 1]
        for matrix, acting in zip(self.steps, (old, new), strict=True):
            full = np.concatenate([self.state, acting[:, None], np.ones((len(acting), 1))], axis=1)
            self.state = np.einsum("hij,hj->hi", matrix[:, : self.n], full)
        self.under_way = forces[:, : self.under_way.shape[1]]
        return position, velocity, now

    def run(self, samples):
        """Positions, velocities and forces, each of shape (samples, h)."""
        rows = [self.step() for _ in range(samples)]
        return tuple(np.array(part) for part in zip(*rows, strict=True))


def at_rest(simulator, seconds):
    """Which hands come to rest: slow at the end, or slower there than a while before."""
    t = simulator.device["sample_time_s"]
    _, velocity, _ = simulator.run(round(seconds / t))
    part = len(velocity) // 5
    last, before = np.abs(velocity[-part:]).max(axis=0), np.abs(velocity[-2 * part : -part]).max(axis=0)
    return (last < 1e-4) | (last < 0.9 * before)
