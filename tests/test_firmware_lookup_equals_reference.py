"""The look-up on the board, in the exported header and in numpy: the same bits."""

import ctypes
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hardware_bench import host_library, require, run, schedule, scratch
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi.coupling import GainSchedule
from avc_hardware import export_c, gain_table
from avc_hardware._reference import ln, lookup
from avc_hardware._runtime_program import GAINS, RuntimeFigures, runtime_programs
from avc_hardware._table import Float32Array
from avc_hardware.firmware_build import EXACT_FLOAT

positive = st.floats(2.0**-20, 2.0**20, width=32)


class Gains(ctypes.Structure):
    _fields_ = [("b", ctypes.c_float), ("k", ctypes.c_float), ("b_p", ctypes.c_float)]


def device_ln(x: float) -> np.float32:
    library = ctypes.CDLL(str(host_library()))
    library.avc_ln.restype = ctypes.c_float
    library.avc_ln.argtypes = [ctypes.c_float]
    return np.float32(library.avc_ln(x))


def device_lookup(gains: GainSchedule, frequency: Float32Array) -> Float32Array:
    """Look up in the compiled core; its table has room for 256 rows behind a header of 32 bytes."""
    library = ctypes.CDLL(str(host_library()))
    library.avc_table_lookup.restype = Gains
    library.avc_table_lookup.argtypes = [ctypes.c_void_p, ctypes.c_float, ctypes.POINTER(ctypes.c_uint32)]
    table = ctypes.create_string_buffer(32 + 256 * 16 + 256 * 4 + 8)
    image = gain_table(gains).image
    ctypes.memmove(table, image, len(image))
    library.avc_table_prepare(table)
    near = ctypes.c_uint32()
    found = [library.avc_table_lookup(table, float(f), ctypes.byref(near)) for f in frequency]
    return np.array([(g.b, g.k, g.b_p) for g in found], dtype=np.float32)


def frequencies(gains: GainSchedule, count: int, seed: int) -> Float32Array:
    """Inside, outside, on every row, next to every row, and undefined."""
    rows = gain_table(gains).rows[:, 0]
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


@pytest.mark.parametrize("rows", [1, 2, 3, 77, 256])
def test_lookup_is_the_same_bit_for_bit(rows: int) -> None:
    gains = schedule(rows, seed=rows)
    at = frequencies(gains, 2000, rows)
    device, host = device_lookup(gains, at), lookup(gain_table(gains).rows, at)
    assert device.tobytes() == host.tobytes()


@given(st.integers(1, 40), st.integers(0, 1000))
def test_lookup_stays_within_its_neighbours_and_near_the_exact_interpolation(rows: int, seed: int) -> None:
    gains = schedule(rows, seed=seed)
    table = gain_table(gains).rows.astype(np.float64)
    at = frequencies(gains, 30, seed)
    at = at[np.isfinite(at) & (at > 0)]
    got = lookup(gain_table(gains).rows, at)
    for column in range(3):
        exact = np.interp(np.log(at.astype(np.float64)), np.log(table[:, 0]), table[:, 1 + column])
        spread = np.ptp(table[:, 1 + column]) + abs(table[:, 1 + column]).max()
        assert np.abs(got[:, column] - exact).max() <= 2e-5 * spread
        assert got[:, column].min() >= table[:, 1 + column].min() - 1e-6 * spread
        assert got[:, column].max() <= table[:, 1 + column].max() + 1e-6 * spread


_PROGRAM = """
#include <stdio.h>
#include "gains.h"
int main(void)
{
    float f;
    while (fread(&f, sizeof f, 1, stdin) == 1) {
        const avc_gains_t gains = avc_lookup(f);
        fwrite(&gains, sizeof gains, 1, stdout);
    }
    avc_couple_state_t coupling;
    avc_couple_start(&coupling, 0.0f);
    const float force = avc_step(&coupling, 1e-3f, 10.0f, 10.0f, 1e4f);
    return force > 0.0f && avc_step(&coupling, -1e-3f, 10.0f, 10.0f, 1e4f) == 0.0f ? 0 : 1;
}
"""


@pytest.mark.parametrize("cc", ["gcc", "clang"])
@pytest.mark.parametrize("rows", [1, 2, 120])
def test_exported_header_is_the_same_bit_for_bit(cc: str, rows: int) -> None:
    require(cc)
    gains = schedule(rows, seed=11)
    folder = scratch() / f"export-{cc}-{rows}"
    folder.mkdir()
    (folder / "gains.h").write_text(export_c(gains), encoding="utf-8")
    source = folder / "main.c"
    source.write_text(_PROGRAM, encoding="utf-8")
    program = folder / "main"
    warnings = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-pedantic", "-ffp-contract=off"]
    run(cc, *warnings, str(source), "-o", str(program))
    at = frequencies(gains, 1000, 1)
    got = np.frombuffer(run(str(program), given=at.tobytes()), dtype=np.float32).reshape(-1, 3)
    assert got.tobytes() == lookup(gain_table(gains).rows, at).tobytes()


_STEPS = """
#include <stdio.h>
#include "gains.h"
int main(void)
{
    float in[2];
    avc_couple_state_t state;
    avc_couple_start(&state, -1e-3f);
    while (fread(in, sizeof in, 1, stdin) == 1) {
        const float force = avc_step(&state, in[0], in[1], 10.0f, 1e5f);
        fwrite(&force, sizeof force, 1, stdout);
    }
    return 0;
}
"""


def test_exported_step_is_the_firmware_s_bit_for_bit() -> None:
    require("gcc")
    gains = schedule(50, seed=12, largest=(300.0, 1e5, 50.0))
    folder = scratch() / "export-step"
    folder.mkdir()
    (folder / "gains.h").write_text(export_c(gains), encoding="utf-8")
    (folder / "main.c").write_text(_STEPS, encoding="utf-8")
    run("gcc", "-std=c11", "-O2", *EXACT_FLOAT, str(folder / "main.c"), "-o", str(folder / "main"))
    time = np.arange(800) * 1e-3
    x = (4e-4 * np.sin(2 * np.pi * (2 + 10 * time) * time)).astype(np.float32)
    frequency = (2 + 20 * time).astype(np.float32)
    got = np.frombuffer(run(str(folder / "main"), given=np.stack([x, frequency], axis=1).tobytes()), dtype=np.float32)
    _, couple, _ = runtime_programs(RuntimeFigures())
    wanted = lookup(gain_table(gains).rows, frequency)
    states = couple.start(np.asarray(-1e-3, dtype=np.float32))
    for tick, force in enumerate(got):
        inputs = {f"wanted_{name}": wanted[tick, index] for index, name in enumerate(GAINS)}
        inputs |= {"position_m": x[tick], "wall_damping_ns_per_m": 10.0, "wall_stiffness_n_per_m": 1e5}
        states, outputs = couple(states, inputs)
        assert outputs["force_n"].tobytes() == force.tobytes(), tick
    assert (got > 0).sum() > 100


def test_export_compiles_alone_as_a_header(tmp_path: Path) -> None:
    require("gcc")
    header = tmp_path / "gains.h"
    header.write_text(export_c(schedule(5, unusable=2)), encoding="utf-8")
    assert "#define AVC_ROWS 3" in header.read_text(encoding="utf-8")
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", *EXACT_FLOAT, "-fsyntax-only", "-x", "c"]
    run("gcc", *flags, str(header))
