"""Whatever a file holds, and whatever stands in its place, ends in an answer or in a short message."""

import io
import json
import os
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.files.coupling_file import read_file
from avc_casadi.files.problem_file import as_problem
from avc_casadi.identification.read import read_columns, read_logs

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from fuzzed_files import KINDS, MOST_CHARACTERS, spoiled, tried

WALL = "[environment]\ndamping_ns_per_m = 1.0\nstiffness_n_per_m = 1000.0\n"
DEVICE = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 1.0\n"


def refused(read, *arguments):
    with pytest.raises(avc.AvcError) as caught:
        read(*arguments)
    assert len(str(caught.value)) <= MOST_CHARACTERS
    return str(caught.value)


@pytest.mark.parametrize("first", range(0, 210, 30))
def test_spoiled_files_are_read_or_refused(first, tmp_path):
    for index in range(first, first + 30):
        ended, said = tried(*spoiled(index), tmp_path / str(index))
        assert (ended in {"read", "refused"}, len(said) <= MOST_CHARACTERS) == (True, True), (index, ended, said)


@pytest.mark.parametrize("kind", KINDS)
def test_valid_files_are_read(kind, tmp_path):
    ends = [tried(kind, data, tmp_path / str(at)) for at, data in enumerate(KINDS[kind].valid())]
    assert ("read", "") in ends or kind == "folder of results"


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in {"folder of results", "board"}])
def test_what_is_no_regular_file_is_not_opened(kind, tmp_path):
    ending = KINDS[kind].ending
    os.mkfifo(tmp_path / f"pipe{ending}")
    (tmp_path / f"endless{ending}").symlink_to("/dev/zero")
    (tmp_path / f"loop{ending}").symlink_to(tmp_path / f"loop{ending}")
    (tmp_path / f"folder{ending}").mkdir()
    for name in ("pipe", "endless", "folder"):
        assert any(said in refused(KINDS[kind].read, tmp_path / f"{name}{ending}") for said in ("regular", "directory"))
    refused(KINDS[kind].read, tmp_path / f"loop{ending}")


@pytest.mark.parametrize("name", ["a\0b", "a\ud800b", "x" * 5000])
@pytest.mark.parametrize("kind", ["problem", "device", "coupling", "gains", "log, CSV", "log, MAT"])
def test_what_is_no_path_is_refused(kind, name, tmp_path):
    refused(KINDS[kind].read, tmp_path / f"{name}{KINDS[kind].ending}")


def claiming(shape, data=b""):
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return member.getvalue() + data


@pytest.mark.parametrize(
    ("data", "said"),
    [(claiming((10**12,)), "claims"), (claiming((2**25,), bytes(2**28)), "at most 134217728 bytes"), (b"", "magic")],
    ids=["a header", "a bomb", "nothing"],
)
def test_archives_are_measured_before_they_are_read(data, said, tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("time_s.npy", data)
    assert said in refused(read_logs, [tmp_path / "a.npz"])


@pytest.mark.parametrize("read", [lambda path: read_logs([path]), read_columns], ids=["identify", "diagnose"])
@pytest.mark.parametrize("content", ["nan", "inf", "", "1e308", "1e200"])
def test_logs_of_no_numbers_are_refused(content, read, tmp_path):
    rows = "".join(f"{1e-3 * row},{content},1\n" for row in range(300))
    (tmp_path / "a.csv").write_text(f"time_s,position_m,force_n\n{rows}")
    assert "position" in refused(read, tmp_path / "a.csv")
    one = "".join(f"{1e-3 * row},{content},1\n" for row in range(1))
    (tmp_path / "a.csv").write_text(f"time_s,position_m,force_n\n{one}")
    refused(read, tmp_path / "a.csv")


@pytest.mark.parametrize("feed", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_texts_are_read_in_pieces_as_in_one(mark, feed, tmp_path):
    """More than a piece of rows, odd ones among them, against numpy's reader on the plain ones."""
    rng = np.random.default_rng(3)
    values = np.c_[1e-3 * np.arange(60_000), 0.1 * rng.normal(size=(60_000, 2))]
    rows = [mark.join(f"{value:.12g}" for value in row) for row in values]
    plain = np.loadtxt(rows, delimiter=None if mark == " " else mark)
    rows[40_000] = mark.join(f'"{cell}"' if mark != " " else cell for cell in rows[40_000].split(mark))
    rows[50_000] += f"{feed}# a remark{feed}"
    text = feed.join([mark.join(("time_s", "position_m", "force_n")), *rows])
    (tmp_path / "a.csv").write_bytes(text.encode())
    (log,) = read_columns(tmp_path / "a.csv")
    assert np.array_equal(np.c_[log.time_s, log.position_m, log.force_n], plain)
    assert (log.at(0), log.at(49_999), log.at(50_001)) == (2, 50_001, 50_005)


def test_sizes_are_bounded_and_told(tmp_path):
    frequencies = ", ".join(f"{1 + 1e-4 * row:.4f}" for row in range(120_000))
    text = f"{DEVICE}{WALL}[frequency]\nvalues_hz = [{frequencies}]\n"
    assert "at most 20000" in refused(avc.parse_problem, text[: 2**20])
    assert "at most 20000" in refused(avc.parse_problem, text[: text.index("3.5001")] + "4]\n")
    table = "frequency_hz,damping_ns_per_m,stiffness_n_per_m\n" + "".join(f"{row},1,x\n" for row in range(1, 30_000))
    (tmp_path / "a.csv").write_text(table)
    assert "at most 20000" in refused(read_file, tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text(table[: table.index("\n15000")])
    assert refused(read_file, tmp_path / "a.csv").endswith("more faults")
    deep = "[" * 900 + "]" * 900
    (tmp_path / "a.json").write_text(f'{{"schema": "avc-gains/1", "notes": {deep}}}')
    assert "nested" in refused(read_file, tmp_path / "a.json")
    assert "nested" in refused(avc.parse_problem, f"a = {deep}")


@pytest.mark.parametrize("value", ["NaN", "Infinity", "1e999", "[[-Infinity]]"])
@pytest.mark.parametrize("key", ["certificate", "trial", "versions"])
def test_a_certificate_holds_numbers_of_json(key, value, tmp_path):
    avc.write_coupling(avc.Coupling.of(avc.load_problem("soft"), avc.solve("soft", "static")), tmp_path / "c.json")
    document = json.loads((tmp_path / "c.json").read_text())
    text = json.dumps({**document, key: {"a": "HERE"}}).replace('"HERE"', value)
    (tmp_path / "c.json").write_text(text)
    said = refused(avc.read_coupling, tmp_path / "c.json")
    assert key in said
    assert "finite" in said


def test_of_many_faults_the_first_are_told_and_the_rest_counted():
    text = DEVICE + WALL + "".join(f"[[scene.effects]]\nkind = {n}\n" for n in range(5000))
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(text)
    lines = str(caught.value).splitlines()
    assert len(lines) <= 21
    assert lines[-1].endswith(f"has {len(caught.value.faults) - len(lines) + 1} more faults")


@pytest.mark.parametrize(
    ("table", "key", "said"),
    [
        ("mass_g = 120", "device.mass_g", "mass_kg = 0.12"),
        ("mass_kg = 0.1\nsample_time_ms = 2", "device.sample_time_ms", "sample_time_s = 0.002"),
        ("mass_kg = 0.1\nsample_rate_hz = 500", "device.sample_rate_hz", "sample_time_s = 0.002"),
        ("mass_kg = 0.1\nencoder_resolution_um = 55", "device.encoder_resolution_um", "encoder_resolution_m = 5.5e-05"),
        ("mass_g = 120\nrange.mass_g = [100, 140]", "device.range.mass_g", "mass_kg = [0.1, 0.14]"),
    ],
)
def test_a_key_in_another_unit_is_one_fault_with_what_to_write(table, key, said):
    with pytest.raises(avc.InputError) as caught:
        avc.parse_problem(f"[device]\ndamping_ns_per_m = 1.0\n{table}\n{WALL}")
    assert any(fault.key == key and fault.message.endswith(f"write {said}") for fault in caught.value.faults)
    assert len(caught.value.faults) == table.count("_g ") + table.count("_ms") + table.count("_um") + table.count(
        "rate"
    )


def test_a_problem_may_be_the_tables_of_its_file():
    tables = {
        "device": {"mass_kg": 0.1, "damping_ns_per_m": np.float64(2.0)},
        "environment": {"damping_ns_per_m": 1.0, "stiffness_n_per_m": 1000.0},
    }
    text = DEVICE.replace("damping_ns_per_m = 1.0", "damping_ns_per_m = 2.0") + WALL
    assert as_problem(tables) == avc.parse_problem(text, name="")
    said = refused(avc.recommend, {})
    assert all(key in said for key in ("device", "mass_kg (", "environment", "stiffness_n_per_m ("))
    for nothing in (None, 3, [1]):
        assert "as a dict" in refused(avc.recommend, nothing)
