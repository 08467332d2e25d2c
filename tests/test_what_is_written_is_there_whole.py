"""A file or a folder that is written is there whole or as it was before, whatever ends the process."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import avc_casadi as avc
import avc_hardware

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'hardware'}"}
FULL_DISK = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
"""
KILLED_BEFORE_THE_EXCHANGE = """
import os, shutil, signal
shutil.copytree = lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL)
"""
KILLED_WHILE_IT_WRITES = """
import os, signal
os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)
"""


def run(before, arguments, cwd):
    program = f"{before}\nimport sys\nfrom avc_casadi.cli import main\nsys.exit(main({arguments!r}))"
    return subprocess.run(  # noqa: S603
        [sys.executable, "-c", program], cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def coupling(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "c.json"
    problem = avc.load_problem("soft")
    avc.write_coupling(avc.Coupling.of(problem, avc.solve(problem, "static")), path)
    return path


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.thorough
@pytest.mark.parametrize(("before", "code"), [(FULL_DISK, 2), (KILLED_WHILE_IT_WRITES, -signal.SIGKILL)])
def test_a_file_is_the_old_one_or_the_new_one(before, code, tmp_path):
    out = tmp_path / "c.json"
    out.write_text("what was there\n")
    arguments = ["solve", "soft", "--method", "static", "--out", "c.json"]
    done = run(before, arguments, tmp_path)
    assert done.returncode == code, done.stderr
    assert out.read_text() == "what was there\n"
    assert run("", arguments, tmp_path).returncode == 0
    assert json.loads(out.read_text())["method"] == "static"
    assert [path.name for path in tmp_path.iterdir()] == ["c.json"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["export", "COUPLING", "--c", "made", "--unsafe"], "--c: 'made' cannot be written"),
        (["simulate", "soft", "--plot", "run.svg"], "--plot: 'run.svg' cannot be written"),
        (["simulate", "soft", "--trace", "run.npz"], "--trace: 'run.npz' cannot be written"),
    ],
)
def test_a_full_disk_is_told_of_what_was_typed(arguments, named, coupling, tmp_path):
    done = run(FULL_DISK, [str(coupling) if one == "COUPLING" else one for one in arguments], tmp_path)
    assert done.returncode == 2
    assert f"{named} (File too large)" in done.stderr
    assert ".avc-" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_cannot_begin_leaves_no_file(tmp_path, monkeypatch):
    def full(path, *_, **__):
        path.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(avc.InputError, match=r"log\.csv: cannot be written \(No space left on device\)"):
        avc_hardware.open_log(tmp_path / "log.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("before", [KILLED_BEFORE_THE_EXCHANGE, KILLED_WHILE_IT_WRITES], ids=["exchange", "write"])
def test_a_folder_is_the_old_one_or_the_new_one(before, coupling, tmp_path):
    arguments = ["export", str(coupling), "--c", "made", "--unsafe"]
    (tmp_path / "made" / "own").mkdir(parents=True)
    (tmp_path / "made" / "own" / "notes.txt").write_text("mine\n")
    (tmp_path / "made" / "avc_coupling.c").write_text("of before\n")
    old = contents(tmp_path / "made")
    assert run(before, arguments, tmp_path).returncode == -signal.SIGKILL
    assert contents(tmp_path / "made") == old
    assert len(list(tmp_path.iterdir())) == 2
    done = run("", arguments, tmp_path)
    assert done.returncode == 0, done.stderr
    new = contents(tmp_path / "made")
    assert len(new) > len(old)
    assert new[Path("own/notes.txt")] == b"mine\n"
    assert new[Path("avc_coupling.c")] != old[Path("avc_coupling.c")]
    assert [path.name for path in tmp_path.iterdir()] == ["made"]


@pytest.mark.thorough
def test_a_folder_that_the_process_stands_in_stays_that_folder(coupling, tmp_path):
    before = tmp_path.stat().st_ino
    done = run("", ["export", str(coupling), "--c", ".", "--unsafe"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert tmp_path.stat().st_ino == before
    assert (tmp_path / "avc_coupling.c").is_file()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_link_and_a_mode_stay(tmp_path):
    target, link = tmp_path / "real.json", tmp_path / "link.json"
    target.write_text("x")
    target.chmod(0o640)
    link.symlink_to(target)
    avc.write_coupling(avc.Coupling.of(avc.load_problem("soft"), avc.solve("soft", "static")), link)
    assert link.is_symlink()
    assert avc.read_coupling(target).method == "static"
    assert target.stat().st_mode & 0o777 == 0o640
