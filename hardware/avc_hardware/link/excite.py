"""Excitation: a plan played by the device, its records read meanwhile; the device is stopped first in any error."""

from __future__ import annotations

import secrets
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi import InputError, LinkError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.identification.excitation import ExcitationFigures, Plan
from avc_casadi.identification.signal import FULL
from avc_hardware.codegen.figures import device_config
from avc_hardware.codegen.tick_program import packed_config
from avc_hardware.emulator.bench import BenchDevice, code_of_force, force_of_code
from avc_hardware.emulator.board import EmulatedBoard
from avc_hardware.link import messages as m
from avc_hardware.link.connection import DEFAULT_BAUD, EMULATOR, Connection, open_link
from avc_hardware.link.messages import Kind

if TYPE_CHECKING:
    from avc_casadi.model.device import Device as DeclaredDevice
    from avc_hardware.link.bytes import ByteLink
    from avc_hardware.link.device import Device


_HEAD = struct.Struct("<5I5f4H33HH")
_TONE = struct.Struct("<IHh")
ENDS = {
    2: "played to the end",
    3: "stopped by the host",
    4: "stopped: the device did not hear the host in time",
    5: "stopped: the travel limit was exceeded",
    6: "stopped: the speed limit was exceeded",
    7: "stopped: the device latched a fault (avc monitor)",
}
"""Ends of an excitation, by the device's number."""
_WORTH = 200
"""Records that are worth a request."""
_WAIT_S = 0.1
"""Longest wait for them."""
_ANSWER_BYTES = 1050
"""Bytes of a full answer and its request, ten bits each on a serial line."""
_ANSWER_RECORDS = 246
"""Records of a full answer."""
_THINKS_S = 0.02
"""Processing time of a host between an answer and the next request."""
_SINGLE_ROUNDING = 1e-5
"""Share by which a number that has travelled in single precision may differ."""
_FORCE_ROUNDING = 1e-6
"""Share by which a force limit that has travelled so may seem to be exceeded."""


@dataclass(frozen=True, eq=False)
class ExcitationLog:
    """Log of an excitation."""

    plan: Plan
    port: str
    end: str
    whole: bool
    start_tick: int
    index: IndexArray
    position_m: FloatArray
    force_n: FloatArray
    lost: int
    output_n: float = 0.0

    def through(self, full_n: float) -> ExcitationLog:
        """Return the log with the forces rounded by a 12-bit output of this range."""
        given = -force_of_code(code_of_force(-self.force_n, full_n), full_n)
        return replace(self, force_n=given, output_n=float(force_of_code(1 + code_of_force(0.0, full_n), full_n)))

    @property
    def stroke_m(self) -> float:
        """Motion from end to end."""
        return float(np.ptp(self.position_m)) if self.position_m.size else 0.0

    @property
    def figures(self) -> ExcitationFigures:
        """What was recorded, and the largest values."""
        window = self.plan.window
        moved = np.abs(self.position_m[window:] - self.position_m[:-window]).max(initial=0.0)
        start = self.position_m[:1]
        return ExcitationFigures(
            port=self.port,
            end=self.end,
            whole=self.whole,
            records=int(self.index.size),
            lost=self.lost,
            seconds=float(self.index.size * self.plan.sample_time_s),
            peak_force_n=float(np.abs(self.force_n).max(initial=0.0)),
            peak_speed_m_per_s=float(moved / (window * self.plan.sample_time_s)),
            peak_travel_m=float(np.abs(self.position_m - start).max(initial=0.0)),
        )

    def csv(self) -> str:
        """Return the log as `avc identify` reads it: tick, time, position, force; remarks after '#'."""
        plan = self.plan
        columns = "position_um,force_N" if plan.units.linear else "angle_urad,torque_Nm"
        time_ms = 1e3 * plan.sample_time_s * self.index
        given = (
            f"given, in steps of {self.output_n:.4g}," if self.output_n else "commanded, before the output rounds it,"
        )
        head = (
            f"# avc excite: {plan.kind}, {plan.band_hz[0]:.4g} to {plan.band_hz[1]:.4g} Hz; {self.end}\n"
            f"# the force is all that was {given} along +position, with the centring to where it began: "
            f"spring {plan.spring_n_per_m:.4g}, damper {plan.damper_ns_per_m:.4g} (SI)\n"
            f"tick,time_ms,{columns}\n"
        )
        rows = zip(self.start_tick + self.index, time_ms, 1e6 * self.position_m, self.force_n, strict=True)
        return head + "".join(
            f"{tick},{time:.10g},{position:.10g},{force:.9g}\n" for tick, time, position, force in rows
        )


def excite(
    plan: Plan,
    port: str | ByteLink,
    *,
    on_bench: DeclaredDevice | None = None,
    baud: int = DEFAULT_BAUD,
    progress: Progress = SILENT,
    cut: Callable[[ExcitationLog], None] | None = None,
) -> ExcitationLog:
    """Play a plan on a device and read the records."""
    bench = on_bench if port == EMULATOR else None
    link = open_link(port, baud=baud, board=EmulatedBoard if bench is None else BenchDevice(bench).board)
    with Connection(link, baud=baud) as connection:
        if bench is not None:
            connection.configure(packed_config(device_config(bench)))
        _check(plan, connection.device, link.name, baud)
        number = secrets.randbits(32) or 1
        records = _Records(plan, link.name)
        try:
            connection.ask(Kind.EXCITE, plan_bytes(plan, number), m.Acknowledged)
            log = _read(connection, records, number, progress)
        except BaseException as error:
            with DeferredInterrupt():
                with suppress(LinkError):
                    connection.ask(Kind.STOP, m.words(number), m.Acknowledged)
                if cut is not None and isinstance(error, KeyboardInterrupt) and records.following:
                    cut(records.log("cut by Ctrl-C"))
            raise
        # The output's step of a wired board is unknown here.
        return log.through(connection.device.max_force_n) if port == EMULATOR else log


def plan_bytes(plan: Plan, number: int) -> bytes:
    """Return a plan as sent."""
    signal = plan.signal
    head = _HEAD.pack(
        *(number, plan.ticks, plan.ramp_ticks, plan.silent_ticks, signal.growth),
        *(plan.max_force_n, plan.max_speed_m_per_s, plan.max_travel_m, plan.spring_n_per_m, plan.damper_ns_per_m),
        *(plan.window, 0, len(signal.step), 0),
        *signal.knots,
        0,
    )
    return head + b"".join(_TONE.pack(*tone) for tone in zip(signal.step, signal.phase, signal.amplitude, strict=True))


@dataclass
class _Records:
    """Received records."""

    plan: Plan
    port: str
    parts: list[m.Records] = field(default_factory=list)

    @property
    def following(self) -> int:
        """Index of the next record to request."""
        return self.parts[-1].first + len(self.parts[-1].counts) if self.parts else 0

    def log(self, end: str | None = None) -> ExcitationLog:
        """Return the log of the received records, at least one answer; `end` is the reason for the end."""
        part = self.parts[-1]
        index = np.concatenate([part.first + np.arange(len(part.counts)) for part in self.parts])
        counts = np.concatenate([part.counts for part in self.parts])
        units = np.concatenate([part.units for part in self.parts])
        return ExcitationLog(
            plan=self.plan,
            port=self.port,
            end=end or ENDS.get(part.state, f"ended in a way unknown to this program ({part.state})"),
            whole=end is None and part.state == 2,
            start_tick=part.start_tick,
            index=index,
            position_m=counts * self.plan.metres_per_count,
            force_n=units * (float(np.float32(self.plan.max_force_n)) / FULL),
            lost=int((part.made if end is None else self.following) - index.size),
        )


def _read(connection: Connection, records: _Records, number: int, progress: Progress) -> ExcitationLog:
    """Request records until the last; every request shows the device that this host is alive."""
    plan = records.plan
    while True:
        following = records.following
        part = connection.ask(Kind.RECORDS, m.words(number, following), m.Records)
        records.parts.append(part)
        progress.advance(min(records.following, plan.ticks), plan.ticks, "records")
        waiting = part.made - records.following
        if part.state != 1 and not waiting:
            return records.log()
        if waiting < _WORTH:
            connection.wait(min(_WAIT_S, (_WORTH - waiting) * plan.sample_time_s))


def _check(plan: Plan, device: Device, name: str, baud: int) -> None:
    """Refuse a plan of another device, and one whose records the link is too slow for."""
    limits = device.limits
    faults = []
    for quantity, planned, actual in (
        ("a sample time", plan.sample_time_s, limits.sample_time_s),
        ("encoder steps", plan.metres_per_count, limits.metres_per_count),
    ):
        if not np.isclose(planned, actual, rtol=_SINGLE_ROUNDING):
            faults.append(f"the plan is for {quantity} of {planned:g}, the device has {actual:g}")
    if plan.max_force_n > limits.max_force_n * (1 + _FORCE_ROUNDING):
        faults.append(f"the plan has max_force_n = {plan.max_force_n:g}, the device gives {limits.max_force_n:g}")
    if faults:
        raise LinkError(f"{name}: the excitation was not started: {'; '.join(faults)}; correct the device file")
    carried = _ANSWER_RECORDS / (_ANSWER_BYTES * 10 / baud + _THINKS_S)
    surplus = 1 / plan.sample_time_s - carried
    if surplus > 0 and surplus * plan.seconds > device.kept_records:
        raise InputError.of(
            f"{plan.seconds:g} s at {1 / plan.sample_time_s:g} Hz are more than {baud} baud can carry ({carried:.0f} "
            f"records a second; the device stores {device.kept_records}); allowed: at most "
            f"{device.kept_records / surplus:.2g} s, or a faster --baud",
            key="seconds",
        )
