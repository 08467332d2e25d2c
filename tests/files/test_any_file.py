"""Whatever a file holds, and whatever stands in its place, it is read or refused with faults that say something."""

import io
import json
import signal
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from avc_process import ENVIRONMENT
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

import avc_casadi as avc
from avc_casadi import InputError
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_document, read_coupling, read_file
from avc_casadi.identification.read import read_columns
from avc_casadi.model.ends import ToolGains

MOST_CHARACTERS = 2000
SCRAPS = st.one_of(
    st.sampled_from([b"[", b"]", b"{", b"}", b"=", b'"', b'"""', b"#", b".", b",", b"\n", b"\r", b"-", b"0", b"\xff"]),
    st.sampled_from([b"nan", b"inf", b"1e308", b"5e-324", b"1e400", b"true", b"null", b"9" * 400, b"\0", b"\x1b[2J"]),
    st.sampled_from([b"name = 1\n", b"[[scene.effects]]\n", b"[[device]]\n", b"[" * 3000, b'{"a":' * 2000]),
    st.binary(max_size=5),
)


def log_columns():
    time_s = 1e-3 * np.arange(300)
    return {"time_s": time_s, "position_m": 0.01 * np.sin(40 * time_s), "force_n": np.cos(40 * time_s)}


def saved(save, *, named=False):
    content = io.BytesIO()
    save(content, log_columns()) if named else save(content, **log_columns())
    return content.getvalue()


def csv_text(columns):
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]).encode()


def tool_document():
    made = Coupling.to_end(avc.load_problem("tool/mujoco-500hz"), ToolGains(500.0, 2.0, 0.5), {"margin": 0.1})
    return json.dumps(coupling_document(made)).encode()


GAINS = {
    "frequency_hz": 10.0 * np.arange(20) + 1,
    "damping_ns_per_m": 1.5 + np.arange(20),
    "stiffness_n_per_m": 100.0 * np.arange(20),
}
DEVICE_FILE = Path(__file__).parents[2] / "problems" / "devices" / "phantom-omni.toml"
GOLDEN = Path(__file__).parents[1] / "goldens" / "couplings" / "wall.json"
# Ending, valid content, and what reads it.
KINDS = {
    "problem": (".toml", lambda: avc.catalogue_path("figure5").read_bytes(), avc.load_problem),
    "device": (".toml", DEVICE_FILE.read_bytes, avc.load_device),
    "coupling": (".json", GOLDEN.read_bytes, read_file),
    "tool": (".json", tool_document, read_coupling),
    "gains": (".csv", lambda: csv_text(GAINS), read_file),
    "log, CSV": (".csv", lambda: csv_text(log_columns()), read_columns),
    "log, NPZ": (".npz", lambda: saved(np.savez), read_columns),
    "log, MAT": (".mat", lambda: saved(scipy.io.savemat, named=True), read_columns),
}


@cache
def valid(kind):
    return KINDS[kind][1]()


def refused(read, *arguments):
    with pytest.raises(avc.AvcError) as caught:
        read(*arguments)
    assert 0 < len(str(caught.value)) <= MOST_CHARACTERS
    return caught.value


@pytest.mark.parametrize("kind", KINDS)
def test_a_valid_file_is_read(kind, tmp_path):
    path = tmp_path / f"a{KINDS[kind][0]}"
    path.write_bytes(valid(kind))
    assert KINDS[kind][2](path) is not None


@pytest.mark.parametrize("kind", first(KINDS, 2))
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_a_spoiled_file_is_read_or_refused(kind, data, tmp_path_factory):
    content = valid(kind)
    for _ in range(data.draw(st.integers(1, 4))):
        begin = data.draw(st.integers(0, len(content)))
        removed = data.draw(st.sampled_from([0, 0, 1, 3, 20, 200]))
        content = content[:begin] + data.draw(SCRAPS) + content[begin + removed :]
    path = tmp_path_factory.getbasetemp() / f"spoiled{KINDS[kind][0]}"
    path.write_bytes(content)
    error = None
    try:
        KINDS[kind][2](path)
    except avc.InputError as refusal:
        error = refusal
    if error is not None:
        assert error.faults
        assert all(fault.message for fault in error.faults)
        assert len(str(error)) <= MOST_CHARACTERS


@pytest.mark.parametrize("feed", first(["\n", "\r\n", "\r"]))
@pytest.mark.parametrize("mark", first([",", ";", "\t", " "]))
def test_texts_are_read_as_numpy_reads_them(mark, feed, tmp_path):
    """Odd rows among them, against numpy's reader on the plain ones."""
    rng = np.random.default_rng(3)
    values = np.c_[1e-3 * np.arange(6_000), 1e-3 * np.cumsum(rng.normal(size=(6_000, 2)), axis=0)]
    rows = [mark.join(f"{value:.12g}" for value in row) for row in values]
    plain = np.loadtxt(rows, delimiter=None if mark == " " else mark)
    rows[4_000] = mark.join(f'"{cell}"' if mark != " " else cell for cell in rows[4_000].split(mark))
    rows[5_000] += f"{feed}# a remark{feed}"
    text = feed.join([mark.join(("time_s", "position_m", "force_n")), *rows])
    (tmp_path / "a.csv").write_bytes(text.encode())
    log = read_columns(tmp_path / "a.csv")
    assert np.array_equal(np.c_[log.time_s, log.position_m, log.force_n], plain)
    assert (log.line_of(0), log.line_of(4_999), log.line_of(5_001)) == (2, 5_001, 5_005)


def test_a_number_put_in_place_unchecked_is_refused():
    soft = avc.load_problem("soft")
    device = soft.device.model_copy(update={"mass_kg": float("nan")})
    assert "device.mass_kg: is nan" in str(refused(avc.solve, soft.model_copy(update={"device": device})))


HEADER = "frequency_hz,damping_ns_per_m,stiffness_n_per_m\n"


@given(st.text(alphabet='0123456789.,-einfax"\n\0 ', max_size=60))
def test_a_csv_of_any_text_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "gains.csv"
    path.write_text(HEADER + text)
    refusal = None
    try:
        found = read_file(path)
    except InputError as error:
        refusal = error
    if refusal is not None:
        assert all(fault.message and len(fault.message) < 400 for fault in refusal.faults)
        return
    assert np.isfinite(found.rows).all()
    assert (found.rows >= 0).all()
    assert (np.diff(found.frequency_hz) > 0).all()


@pytest.mark.parametrize("row", ["2,1,1", "1,1,1", "3,-1,1", "3,1,-1", "500,1,1"])
def test_a_row_that_is_none_is_refused(row, tmp_path):
    """Frequencies rise and stay below 1/(2 T), gains are not negative."""
    path = tmp_path / "gains.csv"
    path.write_text(f"{HEADER}2,1,1\n499.99,1,1\n")
    assert len(read_coupling(path, "soft").schedule.frequency_hz) == 2
    for rows in (f"2,1,1\n{row}\n", f"2,1\n{row}\n"):
        path.write_text(f"{HEADER}{rows}")
        refused(read_coupling, path, "soft")


# A full disk would cut off what Python caches of a module too.
NO_CACHE = ENVIRONMENT | {"PYTHONDONTWRITEBYTECODE": "1"}
FULL_DISK = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
"""
KILLED_WHILE_IT_WRITES = """
import os, signal
os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
"""


def run(before, arguments, cwd):
    program = f"{before}\nimport sys\nfrom avc_casadi.cli import main\nsys.exit(main({arguments!r}))"
    return subprocess.run(  # noqa: S603
        [sys.executable, "-c", program], cwd=cwd, env=NO_CACHE, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
@pytest.mark.parametrize(("before", "code"), [(FULL_DISK, 2), (KILLED_WHILE_IT_WRITES, -signal.SIGKILL)])
def test_a_file_is_the_old_one_or_the_new_one(before, code, tmp_path):
    out = tmp_path / "c.json"
    run("", ["solve", "soft", "--method", "direct", "--out", "c.json"], tmp_path)
    before_it = out.read_text()
    arguments = ["solve", "soft", "--method", "static", "--out", "c.json"]
    done = run(before, arguments, tmp_path)
    assert done.returncode == code, done.stderr
    assert out.read_text() == before_it
    assert run("", arguments, tmp_path).returncode == 0
    assert json.loads(out.read_text())["method"] == "static"
