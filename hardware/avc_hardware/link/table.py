"""TableImage: the gain table of a coupling as sent and as stored on the device, in single precision."""

from __future__ import annotations

import hashlib
import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._util.arrays import Float32Array
from avc_casadi.model.gains import interpolate
from avc_casadi.model.gains import single_ln as ln

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.runtime import StateFeedback


def lookup(rows: Float32Array, frequency_hz: ArrayLike) -> Float32Array:
    """Return gains at frequencies: linear in ln(frequency), the end rows beyond the ends, the first row where NaN."""
    return interpolate(rows, frequency_hz, ln)


HEADER = struct.Struct("<HH6fI")


@dataclass(frozen=True)
class TableImage:
    """A table ready to be sent."""

    rows: Float32Array
    sample_time_s: float
    wall_damping_ns_per_m: float
    wall_stiffness_n_per_m: float
    coupling_id: int
    max_force_n: float = 0.0
    safe_damping_ns_per_m: float = 0.0
    safe_stiffness_n_per_m: float = 0.0
    guard: bool = False
    varies: bool = True
    clips_last: bool = False
    rounding_max: float = 0.0
    feedback: StateFeedback | None = None
    config: bytes = b""  # that it is sent with; empty leaves the device its own

    @classmethod
    def of(cls, coupling: Coupling, *, safe: Gains | None = None) -> TableImage:
        """Take the table of a coupling, row by row, with its wall, guard and force limit."""
        feedback = coupling.runtime.state_feedback
        rows = coupling.table.single()
        wide = coupling.table.rows[:, 1:]
        wall = coupling.wall
        return cls(
            rows=rows,
            sample_time_s=coupling.sample_time_s,
            wall_damping_ns_per_m=wall.damping_ns_per_m,
            wall_stiffness_n_per_m=wall.stiffness_n_per_m,
            coupling_id=int(coupling.id, 16),
            max_force_n=coupling.max_force_n or 0.0,
            safe_damping_ns_per_m=0.0 if safe is None else safe.damping_ns_per_m,
            safe_stiffness_n_per_m=0.0 if safe is None else safe.stiffness_n_per_m,
            guard=coupling.runtime.guard is not None,
            varies=not coupling.table.constant,
            clips_last=coupling.contact == "clip-last",
            rounding_max=float((np.abs(rows[:, 1:] - wide) / np.where(wide == 0, 1.0, np.abs(wide))).max()),
            feedback=feedback,
        )

    @classmethod
    def alone(cls, config: bytes) -> TableImage:
        """Return a configuration, as `packed_config` returns it, without a table."""
        return cls(np.zeros((0, 4), dtype=np.float32), 0.0, 0.0, 0.0, 0, config=config)

    @property
    def states(self) -> int:
        """Number of observer states; 0 without feedback."""
        return 0 if self.feedback is None else self.feedback.states

    @property
    def image(self) -> bytes:
        """The bytes that are sent, checked and read back."""
        if not len(self.rows):
            return b""
        marks = (self.varies, self.guard, self.clips_last)
        flags = sum(mark << bit for bit, mark in enumerate(marks, 1)) | self.states << 8
        header = HEADER.pack(
            *(len(self.rows), flags, self.sample_time_s, self.wall_damping_ns_per_m, self.wall_stiffness_n_per_m),
            *(self.safe_damping_ns_per_m, self.safe_stiffness_n_per_m, self.max_force_n, self.coupling_id),
        )
        image = header + self.rows.astype("<f4").tobytes()
        if self.feedback is None:
            return image
        # After the rows: which states are positions, the numbers of the dead zone, then A by rows, B, L and R.
        numbers, zone = self.feedback.numbers(), self.feedback.zone_numbers
        matrices = numbers[: len(numbers) - len(zone)]
        positions = sum(1 << place for place in set(self.feedback.positions))
        head = struct.pack("<HH", self.feedback.measures, positions)
        return image + head + np.array([*zone, *matrices], dtype="<f4").tobytes()

    @property
    def crc32(self) -> int:
        """Checksum of the image, as `zlib.crc32`."""
        return zlib.crc32(self.image)

    @property
    def table_id(self) -> int:
        """Name of the table, from its content: the same table has the same name."""
        return int.from_bytes(hashlib.sha256(self.config + self.image).digest()[:4], "little") or 1
