"""The look-up on the board and in numpy: the same bits."""

import ctypes
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hardware_bench import coupling, host_library
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi._util.arrays import Float32Array
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import GainTable
from avc_casadi.model.gains import single_ln as ln
from avc_hardware import BoardLimits, RuntimeFigures, TableImage
from avc_hardware.codegen.figures import Config
from avc_hardware.link.table import lookup

positive = st.floats(2.0**-20, 2.0**20, width=32)


class Gains(ctypes.Structure):
    _fields_ = [("b", ctypes.c_float), ("k", ctypes.c_float), ("b_p", ctypes.c_float)]


def device_ln(x: float) -> np.float32:
    library = ctypes.CDLL(str(host_library()))
    library.avc_host_ln.restype = ctypes.c_float
    library.avc_host_ln.argtypes = [ctypes.c_float]
    return np.float32(library.avc_host_ln(x))


def device_lookup(made: Coupling, frequency: Float32Array) -> Float32Array:
    """Look up in the compiled core; its table has room for 256 rows behind a header, and what it prepares."""
    library = ctypes.CDLL(str(host_library()))
    library.avc_host_lookup.restype = Gains
    library.avc_host_lookup.argtypes = [ctypes.c_void_p, ctypes.c_float, ctypes.POINTER(ctypes.c_uint32)]
    table = ctypes.create_string_buffer(32 + 256 * 16 + 256 * 4 + 513 * 2 + 256)
    image = TableImage.of(made).image
    ctypes.memmove(table, image, len(image))
    library.avc_table_prepare(table, Config(BoardLimits(), RuntimeFigures()).packed())
    near = ctypes.c_uint32()
    found = [library.avc_host_lookup(table, float(f), ctypes.byref(near)) for f in frequency]
    return np.array([(g.b, g.k, g.b_p) for g in found], dtype=np.float32)


def frequencies(made: Coupling, count: int, seed: int) -> Float32Array:
    """Inside, outside, on every row, next to every row, and undefined."""
    rows = made.table.single()[:, 0]
    rng = np.random.default_rng(seed)
    special = [np.nan, 1e-6, 1e6, np.inf, 0.0, -1.0]
    near = [rows, np.nextafter(rows, np.float32(0)), np.nextafter(rows, np.float32(np.inf))]
    inside = np.exp(rng.uniform(np.log(0.5), np.log(600.0), count))
    return np.concatenate([*near, inside, special]).astype(np.float32)


@given(positive)
def test_logarithm_is_the_same_on_both_sides_and_accurate(x: float) -> None:
    got = device_ln(x)
    assert got == ln(np.float32(x))
    exact = float(mpmath.log(mpmath.mpf(x)))
    # three roundings of the sum near the largest exponent
    assert abs(float(got) - exact) <= 2.5e-7 * max(1.0, abs(exact))


@pytest.mark.parametrize(
    ("rows", "even"), [*((rows, True) for rows in (1, 2, 3, 77, 256)), *((rows, False) for rows in (3, 64, 65, 256))]
)
def test_lookup_is_the_same_bit_for_bit(rows: int, even: bool) -> None:
    made = coupling(rows, seed=rows, even=even)
    at = frequencies(made, 2000, rows)
    device, host = device_lookup(made, at), lookup(made.table.single(), at)
    assert device.tobytes() == host.tobytes()


@pytest.mark.thorough
@given(
    st.lists(st.floats(1.0, 450.0, width=32), min_size=1, max_size=40, unique=True),
    st.floats(0.5, 600.0, width=32),
    st.integers(1, 200),
)
def test_lookup_is_the_same_however_rows_lie_and_crowd(rows: list[float], crowd_hz: float, crowd: int) -> None:
    """Rows anywhere, and many next to each other: neighbouring numbers of single precision."""
    near = np.float32(crowd_hz).view(np.int32) + np.arange(crowd, dtype=np.int32) * np.int32(1 + crowd % 7)
    frequency = np.unique(np.concatenate([np.array(rows, dtype=np.float32), near.view(np.float32)]))
    gains = np.random.default_rng(crowd).uniform(0.0, 100.0, (len(frequency), 3))
    template = coupling(1)
    made = replace(template, table=GainTable(np.column_stack([frequency, gains])))
    at = frequencies(made, 200, crowd)
    device, host = device_lookup(made, at), lookup(made.table.single(), at)
    assert device.tobytes() == host.tobytes()


@pytest.mark.thorough
@given(st.integers(1, 40), st.integers(0, 1000))
def test_lookup_stays_within_its_neighbours_and_near_the_exact_interpolation(rows: int, seed: int) -> None:
    made = coupling(rows, seed=seed)
    table = made.table.single().astype(np.float64)
    at = frequencies(made, 30, seed)
    at = at[np.isfinite(at) & (at > 0)]
    got = lookup(made.table.single(), at)
    for column in range(3):
        exact = np.interp(np.log(at.astype(np.float64)), np.log(table[:, 0]), table[:, 1 + column])
        spread = np.ptp(table[:, 1 + column]) + abs(table[:, 1 + column]).max()
        assert np.abs(got[:, column] - exact).max() <= 2e-5 * spread
        assert got[:, column].min() >= table[:, 1 + column].min() - 1e-6 * spread
        assert got[:, column].max() <= table[:, 1 + column].max() + 1e-6 * spread
