"""A whole coupling in numpy: what the exported C computes, bit for bit, for many devices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from reference_device import states_at_rest

from avc_casadi.model.gains import interpolate
from avc_casadi.simulation.emit import SINGLE, Precision
from avc_hardware.codegen.coupling_program import coupling_program
from avc_hardware.codegen.sensor import FARTHEST_M, SensorBounds, fade_samples
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
        device = coupling.problem.device
        self._fade = fade_samples(device)
        self._bounds, number = SensorBounds.of(device), precision.dtype
        self._length = {
            name: number(value) for name, value in vars(self._bounds).items() if name.endswith(("_m", "_n"))
        }
        feedback = coupling.runtime.state_feedback
        self._ahead = number(0 if feedback is None or not self._wall_alone else feedback.face_m)
        self.start()

    def start(self) -> None:
        """Forget everything."""
        number, count = self._precision.dtype, self._devices
        self._runs = self._shifted = np.zeros(count, dtype=bool)
        self._missed = self._pushed = self._known = np.zeros(count, dtype=int)
        zero: NDArray[Any] = np.zeros(count, number)
        self._before = self._moved = self._face = self._depth = self._given = zero
        self._share = self._rise = np.ones(count, number)
        self._states: Columns = states_at_rest(self._program.states, self._program.initial, zero)

    def _driven(self) -> NDArray[Any]:
        """Return the largest change of movement by what acts."""
        return np.where(self._pushed > 0, self._length["driven_m"], self._length["hand_m"])

    def _certain(self) -> NDArray[Any]:
        """Return the share of the depth that the device cannot have left."""
        number = self._precision.dtype
        samples = self._missed.astype(number)
        leaving = np.minimum(self._moved, number(0))
        left = samples * (number(0.5) * (samples + number(1)) * self._driven() - leaving)
        held = left < self._depth
        return np.where(held, (self._depth - left) / np.where(held, self._depth, number(1)), number(0)).astype(number)

    def _look(self, given: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return what is believed, where for the first time after refused samples, and the positions."""
        number, length, bounds = self._precision.dtype, self._length, self._bounds
        one, zero = number(1), number(0)
        finite = (given >= number(-FARTHEST_M)) & (given <= number(FARTHEST_M))
        x = np.where(finite, given, zero)
        again, unknown = self._missed > 0, self._known == 0
        samples = self._missed.astype(number) + one
        moved, carried = x - self._before, samples * self._moved
        low, high = (
            np.where(again, np.minimum(carried, zero), carried),
            np.where(again, np.maximum(carried, zero), carried),
        )
        inside = (self._runs & (self._before > 0)) if self._wall_alone else True
        next_one = np.where(inside, length["inside_m"], self._driven()) + length["unsure_m"]
        under_way = ~again & (self._known == 1) & ~(np.abs(moved) <= next_one)
        next_one = np.where(under_way, length["start_m"], next_one)
        later = samples * (number(0.5) * (samples + one) * self._driven() + length["unsure_m"])
        unsure = np.minimum(np.where(again, later, next_one), length["jump_m"])
        near = (np.abs(moved) <= samples * length["jump_m"]) & (moved >= low - unsure) & (moved <= high + unsure)
        good = finite & (near | unknown)
        movement = np.where(unknown, zero, moved / samples).astype(number)
        missed = np.minimum(self._missed + 1, bounds.lost_samples)
        lost = np.where(missed >= bounds.lost_samples, 0, self._known)
        self._known = np.where(good, np.where(unknown, 1, 2), lost)
        self._before, self._moved = np.where(good, x, self._before), np.where(good, movement, self._moved)
        self._missed = np.where(good, 0, missed)
        return good, good & (again | under_way), x

    def step(self, position_m: ArrayLike) -> NDArray[Any]:
        """Run one sample, as `avc_coupling_step`; position and force have shape (devices,)."""
        number, zero, one = self._precision.dtype, self._precision.dtype(0), self._precision.dtype(1)
        kept, missed = np.where(self._missed > 0, self._certain(), one), self._missed
        before = self._before
        believed, again, x = self._look(np.broadcast_to(np.asarray(position_m, dtype=number), (self._devices,)))
        fading = self._certain() * self._given
        if self._wall_alone:
            stays = (self._depth <= 0) & (x + self._ahead <= 0) & (np.abs(x - before) <= self._length["unsure_m"])
            again = again & ~stays
        self._runs = self._runs & ~again
        self._share = np.where(again, kept * self._share, self._share)
        rise = one / np.minimum(missed + 1, self._fade).astype(number)
        self._rise = np.where(again, rise, self._rise)
        waits = again & ~(self._share > 0) & ((x + self._ahead > 0) if self._wall_alone else True)
        good, starting = believed & ~waits, ~self._runs
        if not self._wall_alone:
            waits = waits | (good & starting & (x > 0))
            good = good & ~waits
        begins = good & starting
        if self._wall_alone:
            place = x + self._ahead
            deeper = begins & (place - self._face > self._depth)
            face = np.where(deeper, place - self._depth, self._face)
            face = np.where(place <= 0, zero, face)
            depth = np.maximum(place - face, zero)
            anew = good & ((begins & (depth <= 0)) | ((place <= 0) & self._shifted))
            self._share = np.where(anew & (place <= 0), one, self._share)
            self._face, self._depth = np.where(good, face, self._face), np.where(good, depth, self._depth)
            self._shifted = np.where(good, face > 0, self._shifted)
        else:
            anew = begins
        seen = x - self._face
        fresh = states_at_rest(self._program.states, self._program.initial, seen)
        states = {name: np.where(anew, fresh[name], value) for name, value in self._states.items()}
        following, command, force = self._tick(seen, states)
        told = good & np.isfinite(command)
        rising = told & (self._share < 1)
        self._share = np.where(rising, np.minimum(self._share + self._rise, one), self._share).astype(number)
        force = np.where(rising, self._share * force, force).astype(number)
        following |= dict.fromkeys(self._program.asked, force)
        for name, value in self._states.items():
            kept_value = np.where(told, following[name], np.where(good, fresh[name], value))
            self._states[name] = np.asarray(kept_value, dtype=number)
        # Refused: what was given stays the measure; waiting or overflowing: none is.
        self._given = np.where(told, force, np.where(good | waits, zero, self._given)).astype(number)
        acting = np.where(
            np.abs(force) > self._length["quiet_n"], self._bounds.pushed_samples, np.maximum(self._pushed - 1, 0)
        )
        self._pushed = np.where(told, acting, self._pushed)
        self._runs = np.where(believed, told, self._runs)
        return np.where(told, force, np.where(believed, zero, fading)).astype(number)

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
