"""A table that must not run is refused by the device itself, with the row and the reason."""

import dataclasses
import struct
import zlib

import numpy as np
import pytest
from hardware_bench import coupling, host_core, image, refused
from host_device import HostLink

from avc_casadi import InputError
from avc_casadi.model.gains import GainTable
from avc_hardware import Connection, TableImage
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Reason, Refusal
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import RefusedError


def with_cell(row: int, column: int, value: float) -> TableImage:
    table = image(8)
    rows = table.rows.copy()
    rows[row, column] = value
    return dataclasses.replace(table, rows=rows)


@pytest.mark.parametrize(
    ("row", "column", "value", "reason"),
    [
        (3, 1, np.nan, Reason.NOT_FINITE),
        (0, 2, np.inf, Reason.NOT_FINITE),
        (7, 0, -np.inf, Reason.NOT_FINITE),
        (5, 1, -1.0, Reason.LIMIT),
        (2, 2, 2e8, Reason.LIMIT),
        (2, 3, 2e4, Reason.LIMIT),
        (0, 0, 0.0, Reason.LIMIT),
        (0, 0, 1e-40, Reason.LIMIT),
        (4, 0, 1.0, Reason.NOT_MONOTONIC),
    ],
)
def test_device_names_the_bad_row(row: int, column: int, value: float, reason: Reason) -> None:
    refusal = refused(with_cell(row, column, value))
    assert refusal == Refusal(reason, row)
    assert f"row {row}" in str(refusal)


def test_repeated_frequency_is_refused_on_both_sides() -> None:
    table = image(8)
    rows = table.rows.copy()
    rows[4, 0] = rows[3, 0]
    assert refused(dataclasses.replace(table, rows=rows)) == Refusal(Reason.NOT_MONOTONIC, 4)
    made = coupling(8)
    wide = made.table.rows.copy()
    wide[4, 0] = wide[3, 0] * (1 + 1e-9)
    with pytest.raises(InputError, match="two rows have the frequency"):
        TableImage.of(dataclasses.replace(made, table=GainTable(wide)))


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ({"safe_stiffness_n_per_m": 1e9}, Reason.LIMIT),
        ({"safe_damping_ns_per_m": np.inf}, Reason.NOT_FINITE),
    ],
)
def test_device_refuses_a_bad_header(header: dict[str, float], reason: Reason) -> None:
    refusal = refused(dataclasses.replace(image(3), **header))
    assert refusal == Refusal(reason, 0xFFFF)
    assert "header" in str(refusal)


@pytest.mark.parametrize(
    ("header", "reason", "told"),
    [
        ({"wall_damping_ns_per_m": -1.0}, Reason.WALL, "no wall, or one outside"),
        ({"wall_stiffness_n_per_m": np.nan}, Reason.WALL, "no wall, or one outside"),
        ({"wall_stiffness_n_per_m": 1.1e8}, Reason.WALL, "no wall, or one outside"),
        ({"wall_damping_ns_per_m": 0.0, "wall_stiffness_n_per_m": 0.0}, Reason.WALL, "no wall, or one outside"),
        ({"max_force_n": -1.0}, Reason.FORCE, "more force than the device gives"),
        ({"max_force_n": 50.01}, Reason.FORCE, "more force than the device gives"),
        ({"max_force_n": np.nan}, Reason.FORCE, "more force than the device gives"),
        ({"coupling_id": 0}, Reason.COUPLING, "does not name its coupling"),
        ({"sample_time_s": 1.001e-3}, Reason.SAMPLE_TIME, "another sample time"),
        ({"sample_time_s": np.nan}, Reason.SAMPLE_TIME, "another sample time"),
    ],
)
def test_a_table_for_another_loop_is_refused_by_a_reason_of_its_own(
    header: dict[str, float], reason: Reason, told: str
) -> None:
    refusal = refused(dataclasses.replace(image(3), **header))
    assert refusal.reason is reason
    assert told in str(refusal)


def refused_spoilt(table: bytes, rows: int, crc32: int, told: str) -> None:
    """The device takes bytes of a table in right frames, and refuses them at the end."""
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    ask = connection.session.ask
    connection.run(ask(Kind.BEGIN, m.begin(1, 5, crc32, rows), m.Acknowledged))
    connection.run(ask(Kind.CHUNK, m.chunk(1, 5, 0, table), m.Acknowledged))
    with pytest.raises(RefusedError, match=told):
        connection.run(ask(Kind.COMMIT, m.commit(1, 5, crc32), m.Committed))
    assert core.image() is None


@pytest.mark.parametrize("bit", [4, 5, 6, 7])
def test_a_table_that_asks_for_what_the_firmware_does_not_know_is_refused(bit: int) -> None:
    table = image(3).image
    asks = table[:2] + struct.pack("<H", struct.unpack_from("<H", table, 2)[0] | 1 << bit) + table[4:]
    refused_spoilt(asks, 3, zlib.crc32(asks), "header has a flag that the firmware does not know")


def test_spoilt_table_with_right_frames_is_refused_by_its_checksum() -> None:
    table = image(8)
    refused_spoilt(bytes(len(table.image)), 8, table.crc32, "wrong size")
    spoilt = bytearray(table.image)
    spoilt[40] ^= 1
    refused_spoilt(bytes(spoilt), 8, table.crc32, "checksum of the table")
