"""The firmware of three boards in QEMU, in real time behind a pseudo-terminal, over pyserial; no rate is asserted."""

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
from avc_hardware.codegen.boards import TARGETS
from avc_hardware.codegen.build import build_image

BOARDS = ["netduinoplus2", "mps2-an386", "lm3s6965evb"]


@pytest.fixture
def port(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    require("qemu-system-arm", "arm-none-eabi-gcc")
    image = build_image(request.param, scratch())
    program = shutil.which("qemu-system-arm")
    assert program is not None
    log = tmp_path / "qemu.log"
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 - our own arguments
            [program, "-M", request.param, "-kernel", str(image), "-nodefaults", "-display", "none", "-serial", "pty"],
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
@pytest.mark.parametrize(("port", "board"), [(board, board) for board in BOARDS], indirect=["port"])
def test_push_stream_and_monitor(port: str, board: str) -> None:
    estimator = TARGETS[board].estimator
    made = coupling(200, seed=1, runtime=Runtime(estimator=estimator))
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
    other = "fused" if estimator != "fused" else "zero-crossing"
    with pytest.raises(UnsupportedError, match=f"the coupling.s {other}"):
        push(coupling(5, runtime=Runtime(estimator=other)), port)
