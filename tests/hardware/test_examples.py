"""Examples with real engines: what is recommended settles there, 1.3 times the limit does not; both are drawn."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hardware_bench import require

EXAMPLES = Path(__file__).parents[2] / "problems" / "examples"
ENGINES = {"mujoco": "MuJoCo", "pybullet": "PyBullet"}


def run(example, *arguments, **environment):
    command = [sys.executable, str(EXAMPLES / f"{example}.py"), *map(str, arguments)]
    return subprocess.run(  # noqa: S603
        command, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )


@pytest.mark.slow
@pytest.mark.parametrize("module", ENGINES)
def test_recommended_coupling_settles_and_one_beyond_the_limit_does_not(module, tmp_path):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed (the extra engines)")
    picture = tmp_path / "box.png"
    done = run(f"{module}_box", "--out", picture)
    assert done.returncode == 0, done.stderr
    counts = re.findall(rf"{ENGINES[module]}, .*: (\d) of 8 hands settle", done.stdout)
    assert counts == ["8", "0"]
    assert picture.read_bytes().startswith(b"\x89PNG")


# The example of a teleoperator over a socket: two boards with the exported C settle on a late link with losses.


def loopback(out, slower):
    require("cc")
    return run("teleoperation_loopback", "--slower", slower, "--out", out, CC="cc")


@pytest.mark.slow
def test_samples_that_come_late_ask_for_a_slower_run(tmp_path):
    assert "judge by a run with --slower" in loopback(tmp_path / "link.png", 0.01).stdout  # no computer is on time


@pytest.mark.slow
def test_two_boards_settle_and_are_drawn(tmp_path):
    """Slowed down: where other work takes the processor for long, the link is silent, and its force fades."""
    picture = tmp_path / "link.png"
    done = loopback(picture, 10)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ": settles, " in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
