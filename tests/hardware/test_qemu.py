"""The firmware in QEMU, in real time behind a pseudo-terminal, over pyserial; no rate is asserted."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from hardware_bench import coupling, push, require, scratch, stream

from avc_casadi import UnsupportedError
from avc_casadi.model.runtime import Runtime
from avc_hardware import TableImage, monitor
from avc_hardware.codegen.build import build_image


@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    require("qemu-system-arm", "arm-none-eabi-gcc")
    image = build_image(out=scratch())
    program = shutil.which("qemu-system-arm")
    assert program is not None
    log = tmp_path / "qemu.log"
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 - our own arguments
            [
                program,
                "-M",
                "netduinoplus2",
                "-kernel",
                str(image),
                "-nodefaults",
                "-display",
                "none",
                "-serial",
                "pty",
            ],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    try:
        named = None
        while named is None:
            assert process.poll() is None, log.read_text()
            named = re.search(r"redirected to (/dev/pts/\d+)", log.read_text())
        # QEMU looks for a reader once a second; a spare one keeps it sending while ports are opened and closed.
        spare = os.open(named.group(1), os.O_RDWR | os.O_NOCTTY)
        yield named.group(1)
        os.close(spare)
    finally:
        process.kill()
        process.wait()


@pytest.mark.thorough
def test_push_stream_and_monitor(port: str) -> None:
    made = coupling(200, seed=1)
    result = push(made, port)
    assert result.readback_equal
    assert result.crc32 == TableImage.of(made).crc32
    again = push(made, port)
    assert again.table_id == result.table_id
    streamed = stream(made, port, rate_hz=50, seconds=0.5)
    assert streamed.sent == 25
    assert streamed.status.stream_number == 24
    assert streamed.status.stream_stale == streamed.status.stream_missing == 0
    assert not streamed.status.streaming
    first, *_, last = monitor(port, rate_hz=20, seconds=0.2)
    assert last.ticks > first.ticks
    assert last.coupling_id == made.id
    assert streamed.status.table_crc32 == result.crc32
    assert streamed.status.swaps == 1
    assert streamed.status.bytes_lost == 0
    with pytest.raises(UnsupportedError, match=r"the coupling.s zero-crossing"):
        push(coupling(5, runtime=Runtime(estimator="zero-crossing")), port)
