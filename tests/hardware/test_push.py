"""Push, stream and monitor against the real firmware image on the emulated board."""

import json
import math

import numpy as np
import pytest
from hardware_bench import coupling, push, require

from avc_hardware import Connection, EmulatedBoard, TableImage, monitor
from avc_hardware.link.table import lookup


@pytest.fixture(autouse=True)
def _emulator() -> None:
    require("unicorn")


@pytest.mark.slow
def test_pushed_table_is_read_back_as_single_precision() -> None:
    made = coupling(200, seed=3)
    result = push(made, "emulator")
    document = json.loads(json.dumps(result.document(), allow_nan=False))
    assert document["rows"] == 200
    assert document["readback_equal"] is True
    assert document["attempts"] == 1
    assert document["crc32"] == TableImage.of(made).crc32
    assert document["coupling_id"] == made.id
    assert 0 < document["rounding_max"] <= 2**-24
    assert document["seconds"] < 2.0  # virtual time
    assert document["sample_time_s"] == 1e-3


@pytest.mark.slow
def test_preemption_at_any_instruction_changes_no_byte() -> None:
    """The main loop is interrupted after every few instructions, also inside conditional blocks."""
    images = []
    for slice_cycles in (3, 5, 11, 168_000):
        board = EmulatedBoard(slice_cycles=slice_cycles, motion_m=lambda _: 0.0)
        with Connection(board) as connection:
            upload = connection.run(connection.session.push(TableImage.of(coupling(20)), connection.device))
            images.append(upload.image)
            assert upload.attempts == 1
    assert set(images) == {TableImage.of(coupling(20)).image}


@pytest.mark.slow
def test_gains_in_force_follow_the_table_at_the_estimated_frequency() -> None:
    """A steady tap: after the slew, the gains are those of the row, rounded once for each step of the way."""
    made = coupling(60, seed=5)
    board = EmulatedBoard(motion_m=lambda time: 4e-4 * math.sin(2 * math.pi * 6.0 * time))
    push(made, board)
    rows = made.table.single()
    *_, status = monitor(board, seconds=3.0, rate_hz=20)
    assert status.frequency_hz == pytest.approx(6.0, rel=0.02)
    near = lookup(rows, np.float32(status.frequency_hz) * np.array([0.97, 1.03], dtype=np.float32))
    for index, value in enumerate((status.damping_ns_per_m, status.stiffness_n_per_m)):
        assert near[:, index].min() * 0.97 <= value <= near[:, index].max() * 1.03
