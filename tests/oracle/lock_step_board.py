"""A board in QEMU in lock step: one record a tick over two named pipes, in QEMU's own virtual time."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from avc_casadi import LinkError, MissingExtraError

QEMU_INSTALL = "apt-get install -y --no-install-recommends qemu-system-arm qemu-system-misc"


@dataclass(frozen=True)
class Machine:
    """What runs a bench's firmware.

    Attributes:
        name: QEMU's.
        shift: nanoseconds an instruction as a power of two.
        clock_hz: of the timer that the bench reads.
        options: further ones of QEMU.
        program: QEMU's.
    """

    name: str
    shift: int
    clock_hz: float
    options: tuple[str, ...] = ()
    program: str = "qemu-system-arm"


_RECORD = struct.Struct("<fII")
_LINE_MAX = 64


class LockStepBoard:
    """A `ByteLink` to firmware in QEMU that waits for a position at every tick; use as a context manager.

    Attributes:
        force_n: force of the last tick.
        instructions: that the last tick took, by the emulator's instruction counter (to about one).
        ticks: so far.
        on_force: called with the force of every tick.
    """

    def __init__(
        self, image: Path, machine: Machine, *, position: Callable[[int], int], options: tuple[str, ...] = ()
    ) -> None:
        """Start QEMU.

        Args:
            image: of a board in lock step.
            machine: what runs it.
            position: encoder counts at a tick; it may look at ``force_n`` of the tick before.
            options: further ones of QEMU.

        Raises:
            MissingExtraError: QEMU is not installed.
        """
        program = shutil.which(machine.program)
        if program is None:
            raise MissingExtraError(f"{machine.program} is not installed; on Debian or Ubuntu: {QEMU_INSTALL}")
        self._instructions_per_cycle = 1e9 / machine.clock_hz / 2**machine.shift
        self._position = position
        self._folder = tempfile.TemporaryDirectory(prefix="avc-bench-")
        pipes = [Path(self._folder.name) / name for name in ("from_plant", "to_plant")]
        for pipe in pipes:
            os.mkfifo(pipe)
        self._process = subprocess.Popen(  # noqa: S603 - our own arguments
            [
                *(
                    program,
                    "-M",
                    machine.name,
                    *machine.options,
                    "-kernel",
                    str(image.resolve()),
                    "-nodefaults",
                    "-display",
                    "none",
                ),
                *("-semihosting-config", "enable=on,target=native", "-icount", f"shift={machine.shift},sleep=off"),
                *options,
            ],
            cwd=self._folder.name,
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        # Opening a pipe waits for the other end, which may never come: open without waiting, then watch QEMU.
        self._from_board = os.open(pipes[1], os.O_RDONLY | os.O_NONBLOCK)
        self._to_board = self._open_when_read(pipes[0])
        for handle in (self._from_board, self._to_board):
            os.set_blocking(handle, True)
        self._line = bytearray()
        self._received = bytearray()
        self.force_n = 0.0
        self.instructions = 0.0
        self.ticks = 0
        self.on_force: Callable[[float], None] = lambda _: None

    def _open_when_read(self, pipe: Path) -> int:
        """Return the pipe's writing end once the firmware has opened the other; it opens that to the plant before."""
        while True:
            try:
                return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
            except OSError as error:
                if self._process.poll() is not None:
                    os.close(self._from_board)
                    said = self._process.communicate()[1].decode(errors="replace").strip()
                    self._folder.cleanup()
                    raise LinkError(f"QEMU ended before the firmware ran: {said}") from error
                time.sleep(1e-3)

    def tick(self) -> None:
        """Let one sample pass.

        Raises:
            LinkError: QEMU has ended.
        """
        part, self._line = self._line[:_LINE_MAX], self._line[_LINE_MAX:]
        try:
            os.write(self._to_board, struct.pack("<iI", self._position(self.ticks), len(part)) + part)
        except BrokenPipeError as error:
            raise LinkError("the emulated board has ended") from error
        self.force_n, cycles, size = _RECORD.unpack(self._exactly(_RECORD.size))
        self._received += self._exactly(size)
        self.instructions = cycles * self._instructions_per_cycle
        self.ticks += 1
        self.on_force(self.force_n)

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = os.read(self._from_board, size - len(data))
            if not piece:
                raise LinkError("the emulated board has ended")
            data += piece
        return data

    @property
    def name(self) -> str:
        """How the user calls it."""
        return "qemu"

    def now_s(self) -> float:
        """Time of the samples, seconds."""
        return self.ticks * 1e-3

    def write(self, data: bytes) -> None:
        """Put bytes on the line, at most 64 a tick."""
        self._line += data

    def read(self, timeout_s: float) -> bytes:
        """Let time pass until the board has sent something."""
        end = self.ticks + max(1, round(timeout_s * 1e3))
        while not self._received and self.ticks < end:
            self.tick()
        data = bytes(self._received)
        self._received.clear()
        return data

    def close(self) -> None:
        """Nothing: the board goes on until `stop`, as a board does."""

    def stop(self) -> None:
        """End QEMU."""
        os.close(self._to_board)
        self._process.kill()
        self._process.wait()
        os.close(self._from_board)
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
