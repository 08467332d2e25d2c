"""A whole coupling in numpy: what the exported C computes, bit for bit, for many devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.model.gains import interpolate
from avc_casadi.simulation.emit import SINGLE, Precision
from avc_hardware.codegen.coupling_program import coupling_program
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds
from avc_hardware.codegen.tick_program import GAINS, states_at_rest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from avc_casadi.coupling import Coupling
    from avc_casadi.simulation.emit import FloatProgram

Columns = dict[str, Any]


class ReferenceCoupling:
    """Devices with the same coupling, each with its own motion."""

    def __init__(self, coupling: Coupling, devices: int = 1, precision: Precision = SINGLE) -> None:
        """Start them, as `avc_coupling_start`.

        Args:
            coupling: what runs.
            devices: how many.
            precision: of every operation.
        """
        self._program = coupling_program(coupling, precision)
        self._precision = precision
        self._rows: NDArray[Any] = coupling.table.rows.astype(precision.dtype)
        self._devices = devices
        self._wall_alone = coupling.problem.detent is None
        self._bounds = SensorBounds.of(coupling.problem.device, detents=not self._wall_alone)
        self.start()

    def start(self) -> None:
        """Forget everything."""
        self._known: NDArray[Any] = np.zeros(self._devices, dtype=int)
        self._below = self._wary = self._known
        self._before: NDArray[Any] = np.zeros(self._devices, self._precision.dtype)
        self._moved = self._face = self._before
        self._left = self._known + self._bounds.leaving_samples
        self._states: Columns = {name: np.zeros(self._devices, self._precision.dtype) for name in self._program.states}

    def step(self, position_m: ArrayLike) -> NDArray[Any]:
        """Run one sample, as `avc_coupling_step`; position and force have shape (devices,)."""
        number, zero = self._precision.dtype, self._precision.dtype(0)
        given = np.broadcast_to(np.asarray(position_m, dtype=number), (self._devices,))
        jump = number(self._bounds.jump_m)
        left = self._left < self._bounds.leaving_samples
        after = np.where(left, number(self._bounds.leaving_m), number(self._bounds.outside_m))
        inside = (self._left == 0) if self._wall_alone else True
        change = np.where(inside, number(self._bounds.change_m), after)
        good = (given >= number(-FARTHEST_M)) & (given <= number(FARTHEST_M))
        moved = given - self._before
        steady = ((self._known == 1) & (self._wary == 0)) | (np.abs(moved - self._moved) <= change)
        good &= (self._known == 0) | ((np.abs(moved) <= jump) & steady)
        doubted = self._wall_alone & ~good & (self._known == 1) & (np.abs(moved) <= jump)
        x = np.where(good, given, zero)
        begins, shown = good & (self._known == 0), self._face
        below, wary, anew = self._below, np.where(good, self._wary, 2), begins
        silent = np.zeros_like(good)
        if self._wall_alone:
            depth = np.maximum(self._before - self._face, zero)
            deeper = begins & (x - self._face > depth)
            shown = np.where(deeper, x - depth, self._face)
            shown = np.where(deeper & (x - shown > depth), x, shown)
            wary = np.where(begins & (x - shown > 0), 0, wary)
            leaves = (x <= 0) & (shown > 0)
            shown = np.where(leaves, zero, shown)
            below = np.where(x < 0, np.minimum(self._below + 1, 2), np.where(self._below < 2, 0, 2))
            clipped = good & (x == 0) & (below < 2)
            anew = (begins & (x - shown <= 0)) | leaves
            wary = np.where(good & (wary > 0), np.where(x > shown, wary - 1, 2), wary)
            shown = np.where(good & (wary == 1), x, shown)
            silent = clipped | (good & (wary > 0))
        else:
            clipped, wary = silent, np.zeros_like(wary)
            good &= ~(begins & (x > 0))
        seen = x - shown
        fresh = states_at_rest(self._program.states, self._program.initial, seen)
        states = {name: np.where(anew, fresh[name], value) for name, value in self._states.items()}
        following, command, force = self._tick(seen, states)
        runs = good & ~silent
        following = {name: np.where(silent, fresh[name], value) for name, value in following.items()}
        following = {name: np.where(good, value, self._states[name]) for name, value in following.items()}
        told = good & (silent | np.isfinite(command))
        following = {name: np.where(good & ~told, fresh[name], value) for name, value in following.items()}
        self._moved = np.where((good & ~begins) | doubted, moved, self._moved)
        self._known = np.where(told, np.where(begins | clipped, 1, 2), 0)
        self._before, self._face = np.where(good, x, self._before), np.where(good, shown, self._face)
        self._below, self._wary = np.where(good, below, self._below), wary
        left = np.where(x > 0, 0, np.minimum(self._left + 1, self._bounds.leaving_samples))
        self._left = np.where(good, left, self._left)
        self._states = {name: np.asarray(following[name], dtype=number) for name in states}
        return np.where(runs & told, force, zero).astype(number)

    def _tick(self, x: NDArray[Any], states: Columns) -> tuple[Columns, NDArray[Any], NDArray[Any]]:
        program = self._program
        given: Columns = {"position_m": x}
        following: Columns = {}
        if program.before is not None:
            early = _run(program.before, given, states)
            following |= {name: early[f"next_{name}"] for name in program.early}
            wanted = interpolate(self._rows, early["out_frequency_hz"], self._precision.ln)
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
