"""The exported C of velocity estimators, compiled, against their papers' algorithms in plain Python."""

import ctypes
import json
import tempfile
from pathlib import Path

import numpy as np
import plain_velocity
import pytest
from exported import C99, CPP11, WARNINGS
from hardware_bench import require, run, scratch

import avc_casadi as avc
from avc_casadi.cli import main
from avc_hardware import export_velocity_c

T, STEP = 1e-3, 2e-5
CASES = {
    "foaw": ({}, lambda start: plain_velocity.Foaw(T, start, STEP)),
    "foaw, ends": (
        {"band_m": 3e-5, "window_samples": 9, "fit": "end"},
        lambda start: plain_velocity.Foaw(T, start, 3e-5, 9, "end"),
    ),
    "levant": ({"acceleration_m_per_s2": 40.0}, lambda start: plain_velocity.Levant(T, start, 40.0)),
    "levant, explicit": (
        {"acceleration_m_per_s2": 40.0, "discretisation": "explicit", "position": "estimated"},
        lambda start: plain_velocity.Levant(T, start, 40.0, "explicit"),
    ),
    "kalman": ({"acceleration_m_per_s2": 5.0}, lambda start: plain_velocity.Kalman(T, start, 5.0, STEP / 12**0.5)),
    "first-order": ({"cutoff_hz": 60.0}, None),
}


def problem(name, keys):
    effects = [{"kind": "wall"}, {"kind": "encoder"}]
    effects += [{"kind": "velocity-filter", "estimator": name.partition(",")[0], **keys}]
    device = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "sample_time_s": T, "encoder_resolution_m": STEP}
    wall = {"damping_ns_per_m": 1.0, "stiffness_n_per_m": 1e3}
    return avc.Problem.model_validate(
        {"name": "bench", "device": device, "environment": wall, "scene": {"effects": effects, "coupling": "none"}}
    )


def velocities(files, name, positions, number, compiler=C99):
    """What the compiled estimator returns, and the position for the spring, at each position."""
    require(compiler[0])
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for file, text in files.items():
        (folder / file).write_text(text, encoding="ascii")
    tool, *options = compiler
    library = folder / "estimator.so"
    run(tool, *options, "-O2", *WARNINGS, "-fPIC", "-shared", str(folder / f"{name}_velocity.c"), "-o", str(library))
    c, memory = ctypes.CDLL(str(library)), ctypes.create_string_buffer(b"\xff" * 1024, 1024)
    start, step, place = (getattr(c, f"{name}_velocity{end}") for end in ("_init", "", "_position"))
    start.argtypes, step.argtypes, place.argtypes = (
        [ctypes.c_void_p, number],
        [ctypes.c_void_p, number],
        [ctypes.c_void_p],
    )
    step.restype = place.restype = number
    start(memory, positions[0])
    return np.array([(step(memory, one), place(memory)) for one in positions]).T


def counted_way():
    times = T * np.arange(600)
    return STEP * np.round(8e-3 * np.sin(2 * np.pi * 3 * times + 0.4) / STEP)


@pytest.mark.parametrize("case", sorted(CASES))
def test_each_is_its_papers_algorithm(case):
    keys, make = CASES[case]
    way = counted_way()
    found, place = velocities(
        export_velocity_c(problem(case, keys), precision="double"), "avc_coupling", way.tolist(), ctypes.c_double
    )
    if make is None:
        share, last, expected = np.exp(-2 * np.pi * keys["cutoff_hz"] * T), 0.0, []
        for raw in np.diff(way, prepend=way[0]) / T:
            last = share * last + (1 - share) * raw
            expected.append((last, 0.0))
        expected = np.array(expected).T
        expected[1] = way
    else:
        plain = make(float(way[0]))
        expected = np.array([(plain(value), plain.position) for value in way.tolist()]).T
    np.testing.assert_allclose(found, expected[0], rtol=0, atol=1e-7 * np.abs(expected[0]).max())
    own = keys.get("position") == "estimated"
    np.testing.assert_allclose(place, expected[1] if own else way, rtol=0, atol=1e-9)


def test_single_precision_is_near_and_no_number_is_left_out():
    way = counted_way()
    files = export_velocity_c(problem("foaw", {}), name="mine")
    assert set(files) == {"mine_velocity.h", "mine_velocity.c"}
    single, _ = velocities(files, "mine", way.tolist(), ctypes.c_float, CPP11)
    double, _ = velocities(
        export_velocity_c(problem("foaw", {}), precision="double"), "avc_coupling", way.tolist(), ctypes.c_double
    )
    # A sample on the edge of the band may fall on its other side: another window.
    assert np.median(np.abs(single - double)) < 1e-3 * np.abs(double).max()
    spoilt = way.copy()
    spoilt[300] = np.nan
    left_out, _ = velocities(files, "mine", spoilt.tolist(), ctypes.c_float, CPP11)
    assert np.isfinite(left_out).all()
    assert left_out[300] == left_out[299]


@pytest.mark.parametrize("case", sorted(CASES))
@pytest.mark.parametrize("wrong", [np.nan, np.inf, 3e38, -3e38, 1e20, 2e6])
def test_a_position_that_is_none_leaves_no_trace(case, wrong):
    """Not of the first one either: who is switched on with it begins at rest at the first good one."""
    files, way = export_velocity_c(problem(case, CASES[case][0])), counted_way()
    clean, place = velocities(files, "avc_coupling", way.tolist(), ctypes.c_float)
    without = np.array([wrong, *way[:300], wrong, wrong, *way[300:]])
    found, there = velocities(files, "avc_coupling", without.tolist(), ctypes.c_float)
    kept = np.delete(np.arange(len(without)), [0, 301, 302])
    assert found[kept].tobytes() == clean.tobytes()
    assert there[kept].tobytes() == place.tobytes()
    assert found[0] == 0
    assert found[301] == found[302] == found[300]


def test_the_command_writes_both_files_and_asks_for_an_estimator(tmp_path, capsys):
    path = tmp_path / "bench.toml"
    path.write_text(avc_toml())
    assert main(["export", str(path), "--velocity", "--c", str(tmp_path / "c"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["estimator"] == "foaw"
    assert sorted(path.name for path in (tmp_path / "c").iterdir()) == [
        "avc_coupling_velocity.c",
        "avc_coupling_velocity.h",
    ]
    assert main(["export", "soft", "--velocity", "--c", str(tmp_path / "d")]) == 2
    assert "velocity-filter" in capsys.readouterr().err


def avc_toml():
    return (
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 0.5\nsample_time_s = 0.001\nencoder_resolution_m = 2e-5\n"
        "[environment]\nstiffness_n_per_m = 1000.0\ndamping_ns_per_m = 1.0\n"
        '[scene]\ncoupling = "none"\n[[scene.effects]]\nkind = "environment"\n[[scene.effects]]\nkind = "encoder"\n'
        '[[scene.effects]]\nkind = "velocity-filter"\nestimator = "foaw"\n'
    )
