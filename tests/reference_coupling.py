"""A whole coupling in numpy: what the exported C computes, bit for bit, for many devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.model.gains import interpolate
from avc_hardware.codegen.coupling_program import FARTHEST_M, coupling_program
from avc_hardware.codegen.operations import SINGLE, Precision
from avc_hardware.codegen.tick_program import GAINS, states_at_rest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from avc_casadi._util.arrays import BoolArray
    from avc_casadi.coupling import Coupling
    from avc_hardware.codegen.float_program import FloatProgram

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
        self.start()

    def start(self) -> None:
        """Forget everything."""
        self._started: BoolArray = np.zeros(self._devices, dtype=bool)
        self._before: NDArray[Any] = np.zeros(self._devices, self._precision.dtype)
        self._states: Columns = {name: np.zeros(self._devices, self._precision.dtype) for name in self._program.states}

    def step(self, position_m: ArrayLike) -> NDArray[Any]:
        """Run one sample, as `avc_coupling_step`; position and force have shape (devices,)."""
        number = self._precision.dtype
        given = np.broadcast_to(np.asarray(position_m, dtype=number), (self._devices,))
        good = (given >= number(-FARTHEST_M)) & (given <= number(FARTHEST_M))
        jump, moved = number(self._program.jump_m), given - self._before
        good &= ~self._started | ((moved <= jump) & (-moved <= jump))
        x = np.where(good, given, number(0))
        fresh = states_at_rest(self._program.states, self._program.initial, x)
        states = {name: np.where(self._started, value, fresh[name]) for name, value in self._states.items()}
        following, command, force = self._tick(x, states)
        good &= np.isfinite(command)
        self._started, self._before = good, x
        self._states = {name: np.asarray(following[name], dtype=number) for name in states}
        return np.where(good, force, number(0)).astype(number)

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
