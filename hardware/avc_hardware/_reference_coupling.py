"""A whole coupling in numpy single precision: what the exported C computes, bit for bit, for many devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_hardware._coupling_program import FARTHEST_M, LARGEST, coupling_program
from avc_hardware._reference import lookup
from avc_hardware._runtime_program import GAINS, states_at_rest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from avc_casadi.coupling import Coupling
    from avc_casadi.support import BoolArray, Float32Array
    from avc_hardware._float_program import FloatProgram

Columns = dict[str, Any]


class ReferenceCoupling:
    """Devices with the same coupling, each with its own motion."""

    def __init__(self, coupling: Coupling, devices: int = 1) -> None:
        """Start them, as `avc_coupling_start`.

        Args:
            coupling: what runs.
            devices: how many.
        """
        self._program = coupling_program(coupling)
        self._rows = coupling.table.single()
        self._devices = devices
        self.start()

    def start(self) -> None:
        """Forget everything."""
        self._started: BoolArray = np.zeros(self._devices, dtype=bool)
        self._states: Columns = {name: np.zeros(self._devices, np.float32) for name in self._program.states}

    def step(self, position_m: ArrayLike) -> Float32Array:
        """Run one sample, as `avc_coupling_step`; position and force have shape (devices,)."""
        given = np.broadcast_to(np.asarray(position_m, dtype=np.float32), (self._devices,))
        good = (given >= np.float32(-FARTHEST_M)) & (given <= np.float32(FARTHEST_M))
        x = np.where(good, given, np.float32(0))
        fresh = states_at_rest(self._program.states, self._program.initial, x)
        states = {name: np.where(self._started, value, fresh[name]) for name, value in self._states.items()}
        following, command, force = self._tick(x, states)
        good &= (command >= np.float32(-LARGEST)) & (command <= np.float32(LARGEST))
        self._started = good
        self._states = {name: np.asarray(following[name], dtype=np.float32) for name in states}
        return np.where(good, force, np.float32(0)).astype(np.float32)

    def _tick(self, x: Float32Array, states: Columns) -> tuple[Columns, Float32Array, Float32Array]:
        program = self._program
        given: Columns = {"position_m": x}
        following: Columns = {}
        if program.before is not None:
            early = _run(program.before, given, states)
            following |= {name: early[f"next_{name}"] for name in program.early}
            wanted = lookup(self._rows, early["out_frequency_hz"])
            given = {"seen_m": early["out_seen_m"]}
            given |= {f"wanted_{name}": wanted[..., index] for index, name in enumerate(GAINS)}
        late = _run(program.after, given, states)
        following |= {name: late[f"next_{name}"] for name in states if name not in program.early}
        shape = x.shape
        command, force = (np.broadcast_to(late[f"out_{name}"], shape) for name in ("command_n", "force_n"))
        return {name: np.broadcast_to(value, shape) for name, value in following.items()}, command, force


def _run(program: FloatProgram, given: Columns, states: Columns) -> Columns:
    """Run a part; returns its outputs by name."""
    values = given | {f"state_{name}": value for name, value in states.items()}
    return dict(zip(program.outputs, program(*(values[name] for name in program.inputs)), strict=True))
