"""The exported C of a coupling between two devices, compiled and called, one object for each end."""

from __future__ import annotations

import ctypes
import functools

from exported import C99, ONE_HAND, library

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.ends import ToolGains

LEADER = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\n"
# More than any end remembers.
_ROOM = 512


@functools.cache
def teleoperator_coupling(follower, stiffness, damping, local=0.0, device=LEADER):
    """A coupling with gains of one's own to the [follower]."""
    gains = ToolGains(stiffness, damping, local)
    return Coupling.to_end(avc.parse_problem(f"{device}[follower]\n{follower}\n{ONE_HAND}"), gains)


class ExportedPair:
    """The compiled source, and both ends as the leader counts positions and forces."""

    def __init__(self, coupling, *, compiler=C99, precision="double"):
        self.c = ctypes.CDLL(str(library(coupling, compiler, precision=precision)))
        self.number = number = {"single": ctypes.c_float, "double": ctypes.c_double}[precision]
        fields = [("number", ctypes.c_uint32), *((name, number) for name in ("position", "velocity", "force"))]
        self.Message = type("Message", (ctypes.Structure,), {"_fields_": fields})
        one, pointer = ctypes.c_void_p, ctypes.POINTER(self.Message)
        for name, given, back in (
            ("init", [one, one], None),
            ("step", [one, number, pointer], number),
            ("message", [one], self.Message),
            ("receive", [one, pointer], ctypes.c_int),
            ("sample", [one, number], None),
            ("force", [one], number),
        ):
            function = getattr(self.c, f"avc_coupling_{name}")
            function.argtypes, function.restype = given, back
        follower = coupling.follower
        self.leader = ExportedEnd(self, "LEADER", 1.0, 1.0)
        self.follower = ExportedEnd(self, "FOLLOWER", follower.position_scale, follower.force_scale)


class ExportedEnd:
    """One end; positions go in, and forces come out, as the leader counts them, messages as they are sent."""

    def __init__(self, pair, name, position_scale, force_scale):
        self._pair, self._scales = pair, (position_scale, force_scale)
        self._end = ctypes.c_char.in_dll(pair.c, f"AVC_COUPLING_{name}")
        self._memory = ctypes.create_string_buffer(b"\xff" * _ROOM, _ROOM)
        self.init()

    def init(self):
        self._pair.c.avc_coupling_init(self._memory, ctypes.addressof(self._end))

    def sample(self, position):
        self._pair.c.avc_coupling_sample(self._memory, self._scales[0] * position)

    def force(self):
        return self._scales[1] * self._pair.c.avc_coupling_force(self._memory)

    def step(self, position, message=None):
        given = None if message is None else ctypes.byref(message)
        force = self._pair.c.avc_coupling_step(self._memory, self._scales[0] * position, given)
        return self._scales[1] * force

    def message(self, touch=None):
        found = self._pair.c.avc_coupling_message(self._memory)
        if touch is not None:
            found.force = touch / self._scales[1]
        return found

    def receive(self, message):
        return self._pair.c.avc_coupling_receive(self._memory, ctypes.byref(message)) == 1
