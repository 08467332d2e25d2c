"""A whole coupling in numpy: what the exported C computes, bit for bit, for many devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from reference_device import states_at_rest

from avc_casadi.model.gains import interpolate
from avc_casadi.simulation.emit import SINGLE, Precision
from avc_hardware.codegen.c_frame import FARTHEST_M, SensorBounds
from avc_hardware.codegen.coupling_program import coupling_program
from avc_hardware.codegen.tick_program import GAINS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from avc_casadi.coupling import Coupling
    from avc_casadi.simulation.emit import FloatProgram

Columns = dict[str, Any]


class ReferenceCoupling:
    """Devices with the same coupling, each with its own motion."""

    def __init__(self, coupling: Coupling, devices: int = 1, precision: Precision = SINGLE) -> None:
        """Start them, as `avc_coupling_start`."""
        self._program = coupling_program(coupling, precision)
        self._precision = precision
        self._rows: NDArray[Any] = coupling.table.rows.astype(precision.dtype)
        self._devices = devices
        self._wall_alone = coupling.problem.detent is None
        self._bounds = SensorBounds.of(coupling.problem.device, detents=not self._wall_alone)
        self.start()

    def start(self) -> None:
        """Forget everything."""
        number = self._precision.dtype
        self._known = self._runs = self._shifted = np.zeros(self._devices, dtype=bool)
        self._before: NDArray[Any] = np.zeros(self._devices, number)
        self._moved = self._face = self._depth = self._before
        zero = np.zeros(self._devices, number)
        self._states: Columns = states_at_rest(self._program.states, self._program.initial, zero)

    def step(self, position_m: ArrayLike) -> NDArray[Any]:
        """Run one sample, as `avc_coupling_step`; position and force have shape (devices,)."""
        number, zero = self._precision.dtype, self._precision.dtype(0)
        given = np.broadcast_to(np.asarray(position_m, dtype=number), (self._devices,))
        finite = (given >= number(-FARTHEST_M)) & (given <= number(FARTHEST_M))
        x = np.where(finite, given, zero)
        moved = np.where(self._known, x - self._before, zero)
        inside = (self._runs & (self._before > 0)) if self._wall_alone else True
        bounds = self._bounds
        change = np.where(inside, number(bounds.change_m - bounds.unsure_m), number(bounds.outside_m - bounds.unsure_m))
        changed = moved - self._moved
        possible = np.abs(changed) <= change + number(bounds.unsure_m)
        good = finite & (np.abs(moved) <= number(self._bounds.jump_m)) & possible
        reached = np.where(possible, moved, self._moved + np.where(changed > 0, change, -change))
        self._before, self._moved = np.where(finite, x, self._before), np.where(finite, reached, self._moved)
        self._known = self._known | finite
        begins = good & ~self._runs
        if self._wall_alone:
            deeper = begins & (x - self._face > self._depth)
            face = np.where(deeper, x - self._depth, self._face)
            face = np.where(x <= 0, zero, face)
            depth = np.maximum(x - face, zero)
            anew = good & ((begins & (depth <= 0)) | ((x <= 0) & self._shifted))
            self._face, self._depth = np.where(good, face, self._face), np.where(good, depth, self._depth)
            self._shifted = np.where(good, face > 0, self._shifted)
        else:
            good = good & ~(begins & (x > 0))
            anew = begins & good
        seen = x - self._face
        fresh = states_at_rest(self._program.states, self._program.initial, seen)
        states = {name: np.where(anew, fresh[name], value) for name, value in self._states.items()}
        following, command, force = self._tick(seen, states)
        told = good & np.isfinite(command)
        for name, value in self._states.items():
            kept = np.where(told, following[name], np.where(good, fresh[name], value))
            self._states[name] = np.asarray(kept, dtype=number)
        self._runs = told
        return np.where(told, force, zero).astype(number)

    def _tick(self, x: NDArray[Any], states: Columns) -> tuple[Columns, NDArray[Any], NDArray[Any]]:
        program = self._program
        given: Columns = {"position_m": x}
        following: Columns = {}
        if program.before is not None:
            early = _run(program.before, given, states)
            following |= {name: early[f"next_{name}"] for name in states if f"next_{name}" in early}
            wanted = interpolate(self._rows, early["out_frequency_hz"], self._precision.ln)
            given = {"seen_m": early["out_seen_m"]}
            given |= {f"wanted_{name}": wanted[..., index] for index, name in enumerate(GAINS)}
        late = _run(program.after, given, states)
        following |= {name: late[f"next_{name}"] for name in states if f"next_{name}" in late}
        shape = x.shape
        command, force = (np.broadcast_to(late[f"out_{name}"], shape) for name in ("command_n", "force_n"))
        return {name: np.broadcast_to(value, shape) for name, value in following.items()}, command, force


def _run(program: FloatProgram, given: Columns, states: Columns) -> Columns:
    """Run a part; returns its outputs by name."""
    values = given | {f"state_{name}": value for name, value in states.items()}
    return dict(zip(program.outputs, program(*(values[name] for name in program.inputs)), strict=True))
