"""The exported C of a coupling to a simulation, compiled and called; and a device and an engine that run it."""

from __future__ import annotations

import ctypes
import functools

import numpy as np
from engine_simulator import EngineSimulator
from exported import C99, ONE_HAND, library

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import ToolGains

DEVICE = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\nmax_force_n = 8.0\n"
# More than any coupling remembers.
_ROOM = 256


@functools.cache
def tool_coupling(simulation: str, stiffness: float, damping: float, local: float = 0.0, device: str = DEVICE):
    """A coupling with gains of one's own to the [simulation]."""
    hands = "" if "rotary" in device else ONE_HAND
    problem = avc.parse_problem(f"{device}[simulation]\n{simulation}\n{hands}")
    return Coupling.to_end(problem, ToolGains(stiffness, damping, local))


class ExportedTool:
    """One device with the exported coupling to a simulation."""

    def __init__(self, coupling, *, compiler=C99, precision="double"):
        self._c = ctypes.CDLL(str(library(coupling, compiler, precision=precision)))
        number = {"single": ctypes.c_float, "double": ctypes.c_double}[precision]
        given = 1 if coupling.tool.exchange == "held-force" else 2
        for name, count in {
            "step": 1 + given,
            "force": given,
            "tool_force": 2,
            "handed_force": 2,
            "sample": 1,
            "alive": 0,
        }.items():
            function = getattr(self._c, f"avc_coupling_{name}", None)
            if function is None:
                continue
            function.argtypes = [ctypes.c_void_p, *[number] * count]
            function.restype = number if name.endswith(("step", "force")) else None
        self._memory = ctypes.create_string_buffer(b"\xff" * _ROOM, _ROOM)
        self._numbers = (number(), number())
        self._fade = round(0.05 / coupling.sample_time_s)
        self._at_rest = (lambda _: (0.0,)) if given == 1 else (lambda place: (place, 0.0))
        self.joint = coupling.in_scene.stiffness_n_per_m, coupling.in_scene.damping_ns_per_m
        if coupling.tool.solved == "spring and damper":
            self._c.avc_coupling_target.argtypes = [ctypes.c_void_p] + 2 * [ctypes.POINTER(number)]
            self._c.avc_coupling_target.restype = number
        self.init()

    def target(self):
        """Share of spring and damper, and the position and velocity that they lead to."""
        place, speed = self._numbers
        share = self._c.avc_coupling_target(self._memory, ctypes.byref(place), ctypes.byref(speed))
        return share, place.value, speed.value

    def begin(self):
        self._c.avc_coupling_init(self._memory)

    def init(self, at=0.0, tool_at=0.0):
        """Begin with both ends at rest until the force has come in."""
        self.begin()
        for _ in range(self._fade):
            self.step(at, *self._at_rest(tool_at))
            self.alive()

    def __getattr__(self, name):
        function = getattr(self._c, f"avc_coupling_{name}")
        return lambda *numbers: function(self._memory, *numbers)


def _sound(_k, x):
    return x


class ExportedLoop(EngineSimulator):
    """The same device and engine with the exported C between them; the tool moves in units of the scene."""

    def _engine(self, c, joint, place, speed):
        """Return the force that is handed out and the state after a step of an engine that has `joint` = (K, B)."""
        handed = c.handed_force(place, speed) if self.exchange == "held-force" and self.integrator[0] == "i" else None
        k = b = 0.0
        if self.integrator == "implicit":
            share, goal, goal_speed = c.target()
            k, b = share * joint[0], share * joint[1]
            asked = k * goal + b * goal_speed
        else:
            asked = c.tool_force(place, speed)
            b = joint[1] if self.integrator == "implicit-damping" else b
            handed = asked if handed is None else handed
        for _ in range(self.substeps):
            place, speed = self._internal(place, speed, asked, k, b)
        return handed, (place, speed)

    def run_exported(self, c, tool, samples, *, target, kick, start=0.0, silent=(), glitch=_sound):
        """Return positions of device and tool at each sample, before the engine's steps since the last, and forces."""
        x, v, held = start, kick, [0.0] * self.delay
        place, speed = start * tool.position_scale, 0.0
        queue = [0.0 if self.exchange == "held-force" else (place, speed)] * (1 + self.late)
        joint = c.joint
        c.init(start, place)
        due = (np.arange(samples * self.T / self.step_s + 1) * self.step_s + self.phase * self.T) / self.T
        found, count = [], 0

        def step():
            nonlocal place, speed, queue, count
            if count not in silent:
                before = (place, speed)
                asked, (place, speed) = self._engine(c, joint, place, speed)
                queue = [*queue[1:], {"held-force": asked, "ahead": (place, speed)}.get(self.exchange, before)]
            count += 1

        for k in range(samples):
            seen = place
            while due[count] < k - 1e-6:  # since the last sample, which it saw
                step()
            fresh = due[count] <= k + 1e-6
            if self.exchange in ("on-time", "late"):
                # The state that a step now due begins with is known before it.
                known = [*queue[1:], (place, speed)] if fresh and count not in silent else queue
                force = c.step(glitch(k, x), *known[0])
                if fresh:
                    step()
            else:
                c.sample(glitch(k, x))
                if fresh:
                    step()
                given = queue[0]
                force = c.force(*(given if isinstance(given, tuple) else (given,)))
            found.append((x, seen, force))
            held.append(-force)
            now = held.pop(0)
            aim = target[k], (target[min(k + 1, samples - 1)] - target[k]) / self.T
            x, v = self.step @ np.array([x, v, now, *aim])
        return np.array(found).T
