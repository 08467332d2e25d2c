"""The portable core compiled for this computer: the same C as on the board, as an object and as a link."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import Float32Array
from avc_hardware import TableImage
from avc_hardware.codegen.build import compile_with, compiler, generate, options_of, source_hash
from avc_hardware.codegen.figures import BoardLimits, Config, RuntimeFigures
from avc_hardware.codegen.tick_program import packed_config
from avc_hardware.link.frames import Decoder, Frame
from avc_hardware.link.messages import parse
from avc_hardware.link.session import Answer, Exchange, Session

HOST_INSTALL = "apt-get install -y --no-install-recommends gcc"
_ROOM = 8192
# Counts: where a device stands that nobody has put anywhere, out of contact.
BEFORE_WALL = -100


def build_host(out: Path, *, cc: str = "gcc", flags: tuple[str, ...] = (), estimator: str = "fused") -> Path:
    """Build the portable core as a shared library."""
    out.mkdir(parents=True, exist_ok=True)
    library = out / "libavc.so"
    made = out / "generated"
    sources = generate(made, Config(BoardLimits(), RuntimeFigures(estimator=estimator)), bound=True)
    sources.append(Path(__file__).parent / "host_board.c")
    options = [*options_of(made, source_hash(estimator)), *flags, "-fPIC", "-shared"]
    compile_with([compiler(cc, HOST_INSTALL), *options, *map(str, sources), "-o", str(library)])
    return library


class State(ctypes.Structure):
    """The firmware's `avc_state_t`."""

    _fields_ = [
        *((name, ctypes.c_uint32) for name in ("ticks", "overruns", "saturated", "stream_expired", "swaps")),
        ("encoder_count", ctypes.c_int32),
        *((name, ctypes.c_float) for name in ("position_m", "velocity_m_per_s", "frequency_hz", "lookup_hz")),
        *((name, ctypes.c_float) for name in ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")),
        ("force_n", ctypes.c_float),
        ("energy_j", ctypes.c_float),
        *((name, ctypes.c_uint8) for name in ("mode", "streaming", "contact", "has_table")),
    ]


class HostCore:
    """One device."""

    def __init__(
        self,
        library: Path,
        limits: BoardLimits | None = None,
        figures: RuntimeFigures | None = None,
        *,
        bound: bool = True,
    ) -> None:
        """Load the library that `build_host` made; figures are at the limits' sample time and encoder."""
        self._c = ctypes.CDLL(str(library))
        self._c.avc_host_new.restype = ctypes.c_void_p
        self._c.avc_host_read.restype = ctypes.c_size_t
        self._c.avc_host_image.restype = ctypes.c_size_t
        self.limits = limits or BoardLimits()
        time_s, step_m = self.limits.sample_time_s, self.limits.metres_per_count
        made = replace(figures or RuntimeFigures(), sample_time_s=time_s, metres_per_count=step_m)
        self._config, self._bound = packed_config(Config(self.limits, made)), bound
        self._device: ctypes.c_void_p | None = None
        self._boots = 0
        self.reset()

    def reset(self) -> None:
        """Start anew: the table is gone."""
        self.free()
        self._boots += 1
        self._device = ctypes.c_void_p(self._c.avc_host_new(self._config, int(self._bound), self._boots))

    def free(self) -> None:
        if self._device is not None:
            self._c.avc_host_free(self._device)
            self._device = None

    def __del__(self) -> None:
        self.free()

    def write(self, data: bytes) -> None:
        self._c.avc_host_write(self._device, data, ctypes.c_size_t(len(data)))

    def read(self) -> bytes:
        room = ctypes.create_string_buffer(_ROOM)
        size = self._c.avc_host_read(self._device, room, ctypes.c_size_t(_ROOM))
        return room.raw[:size]

    def tick(self, counts: NDArray[np.int32]) -> tuple[Float32Array, Float32Array]:
        """Run one tick for each encoder position; returns forces and frequency estimates, each of shape (n,)."""
        counts = np.ascontiguousarray(counts, dtype=np.int32)
        force = np.empty(len(counts), dtype=np.float32)
        frequency = np.empty(len(counts), dtype=np.float32)
        self._c.avc_host_ticks(
            self._device,
            ctypes.c_void_p(counts.ctypes.data),
            ctypes.c_void_p(force.ctypes.data),
            ctypes.c_void_p(frequency.ctypes.data),
            ctypes.c_size_t(len(counts)),
        )
        return force, frequency

    def state(self) -> State:
        state = State()
        self._c.avc_host_state(self._device, ctypes.byref(state))
        return state

    def disable(self, disabled: bool) -> None:
        self._c.avc_host_disable(self._device, int(disabled))

    def overrun(self) -> None:
        self._c.avc_host_overrun(self._device)

    def drives(self) -> bool:
        return bool(self._c.avc_host_drives(self._device))

    def faults(self) -> int:
        return int(self._c.avc_host_faults(self._device))

    def image(self) -> bytes | None:
        room = ctypes.create_string_buffer(_ROOM)
        size = self._c.avc_host_image(self._device, room)
        return room.raw[:size] or None


class HostLink:
    """A `ByteLink` to a `HostCore`, one tick a sample of virtual time; bytes take no time."""

    def __init__(
        self,
        core: HostCore,
        *,
        position: Callable[[int], int] = lambda _: BEFORE_WALL,
        on_force: Callable[[float], None] = lambda _: None,
    ) -> None:
        """Connect; ``position`` gives the encoder's counts at a tick, ``on_force`` takes its force."""
        self.core = core
        self._position = position
        self._on_force = on_force
        self._ticks = 0

    @property
    def name(self) -> str:
        return "host"

    def now_s(self) -> float:
        return self._ticks * self.core.limits.sample_time_s

    def write(self, data: bytes) -> None:
        self.core.write(data)

    def read(self, timeout_s: float) -> bytes:
        """Let the device tick until it has sent something."""
        end = self._ticks + max(1, round(timeout_s / self.core.limits.sample_time_s))
        while not (data := self.core.read()) and self._ticks < end:
            force, _ = self.core.tick(np.array([self._position(self._ticks)], dtype=np.int32))
            self._on_force(float(force[0]))
            self._ticks += 1
        return data

    def close(self) -> None:
        pass


def queue(core: HostCore, table: TableImage) -> None:
    """Bring a device to the point where only the next tick is missing for the swap; no time passes."""
    core.read()
    session = Session(1, timeout_s=1.0)
    decoder = Decoder()
    waiting: list[Frame] = []

    def answered(dialogue: Generator[Exchange, Answer, Any]) -> Any:
        exchange = next(dialogue)
        while True:
            core.write(exchange.data)
            waiting.extend(decoder.feed(core.read()))
            if not waiting:
                return None  # only the commit waits for a tick
            frame = waiting.pop(0)
            message = parse(frame)
            assert message is not None
            try:
                exchange = dialogue.send((frame.sequence, message))
            except StopIteration as stop:
                return stop.value

    device = answered(session.hello())
    answered(session.push(table, device))
