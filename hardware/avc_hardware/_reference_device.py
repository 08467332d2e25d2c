"""The whole control tick in numpy single precision: what the firmware computes, bit for bit, for many devices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi.runtime import StateFeedback, Step, state_feedback_step
from avc_casadi.support import Float32Array
from avc_hardware._figures import RuntimeFigures
from avc_hardware._float_program import FloatProgram
from avc_hardware._host import BoardLimits
from avc_hardware._reference import lookup
from avc_hardware._runtime_program import GAINS, RuntimeProgram, runtime_programs
from avc_hardware._table import TableImage

_f = np.float32
Columns = dict[str, Float32Array]


@dataclass(frozen=True)
class ReferenceTick:
    """What one tick gives, each of shape (devices,).

    Attributes:
        force_n: output.
        frequency_hz: estimate; NaN at rest.
        lookup_hz: where the table is read.
        gains: b, k, b_p in force, shape (devices, 3).
    """

    force_n: Float32Array
    frequency_hz: Float32Array
    lookup_hz: Float32Array
    gains: Float32Array


class ReferenceFeedback:
    """The step of an observer with state feedback in single precision, its matrices as parameters, for many devices."""

    def __init__(self, settings: StateFeedback, devices: int) -> None:
        """Start them."""
        step = state_feedback_step(settings)
        self._numbers = settings.numbers()
        self._states = np.zeros((len(step.states), devices), dtype=np.float32)
        self._program = FloatProgram(_scalars(step))

    def __call__(self, position_m: Float32Array, force_n: Float32Array) -> Float32Array:
        """Run one tick; returns the position that the wall sees, of the shape (devices,) of its inputs."""
        *following, position = self._program(*self._states, position_m, force_n, *self._numbers)
        self._states = np.array([np.broadcast_to(value, position_m.shape) for value in following])
        return position


def _scalars(step: Step) -> Any:
    """Return a step as a function of scalars: states, inputs, parameters -> next states, outputs."""
    import casadi as ca  # noqa: PLC0415

    parts = [[ca.SX.sym(name) for name in names] for names in (step.states, step.inputs, step.parameters)]
    following, outputs = step.apply(*parts)
    return ca.Function(step.name, [symbol for part in parts for symbol in part], [*following, *outputs])


class ReferenceDevice:
    """Devices with the same table, each with its own motion; the host is taken to be alive."""

    def __init__(self, figures: RuntimeFigures, limits: BoardLimits, devices: int) -> None:
        """Make devices without a table."""
        self._limits = limits
        self._estimate, self._couple, self._guard = runtime_programs(figures)
        self._states: dict[str, Columns] = {}
        self._force = np.zeros(devices, dtype=np.float32)
        self._table: TableImage | None = None
        self._feedback: ReferenceFeedback | None = None

    def swap(self, table: TableImage) -> None:
        """Give a table that comes into force with the next tick."""
        self._table = table
        self._feedback = None if table.feedback is None else ReferenceFeedback(table.feedback, len(self._force))

    def tick(self, counts: NDArray[np.int32]) -> ReferenceTick:
        """Run one tick; ``counts`` are the encoders' positions, shape (devices,)."""
        x = counts.astype(np.float32) * _f(self._limits.metres_per_count)
        table = self._table
        rows = None if table is None else table.rows
        if not self._states:
            self._states["estimate"] = self._estimate.start(x)
        rest_hz = np.asarray(1.0 if rows is None else rows[0, 0], dtype=np.float32)
        seen = self._run(self._estimate, {"position_m": x, "rest_hz": rest_hz})
        frequency = np.where(seen["valid"] != 0, seen["estimate_hz"], _f(np.nan))
        if table is None or rows is None:
            self._states["couple"], self._states["guard"] = self._couple.start(x), self._guard.start(x)
            nothing = np.zeros((len(x), 3), dtype=np.float32)
            return ReferenceTick(np.zeros_like(x), frequency, seen["frequency_hz"], nothing)
        wanted = lookup(rows, seen["frequency_hz"])
        inputs: Columns = {f"wanted_{name}": wanted[..., index] for index, name in enumerate(GAINS)}
        y = x if self._feedback is None else self._feedback(x, self._force)
        inputs |= {
            "position_m": y,
            "rest_stiffness_n_per_m": rows[0, 2],
            "wall_damping_ns_per_m": np.asarray(table.wall_damping_ns_per_m, dtype=np.float32),
            "wall_stiffness_n_per_m": np.asarray(table.wall_stiffness_n_per_m, dtype=np.float32),
            "relaxes": np.asarray(table.varies, dtype=np.float32),
            "clips_last": np.asarray(table.clips_last, dtype=np.float32),
        }
        made = self._run(self._couple, inputs)
        force = made["force_n"]
        if table.guard:
            watched = {"position_m": y, "force_n": force, "stored_j": made["stored_j"]}
            force = self._run(self._guard, watched)["guarded_n"]
        most = min(_f(table.max_force_n) or _f(self._limits.max_force_n), _f(self._limits.max_force_n))
        force = np.where(force > most, most, np.where(force < -most, -most, force))
        self._states["couple"]["asked_force_n"] = force
        self._states["guard"]["held_force_n"] = force
        self._force = force
        return ReferenceTick(force, frequency, seen["frequency_hz"], np.stack([made[name] for name in GAINS], axis=-1))

    def _run(self, part: RuntimeProgram, inputs: Columns) -> Columns:
        self._states[part.name], outputs = part(self._states[part.name], inputs)
        return outputs
