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


def run(module, tmp_path, **environment):
    picture = tmp_path / "box.png"
    command = [sys.executable, str(EXAMPLES / f"{module}_box.py"), "--out", str(picture)]
    environment = {**os.environ, **environment}
    done = subprocess.run(  # noqa: S603
        command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path
    )
    return picture, done


@pytest.mark.slow
@pytest.mark.parametrize("module", ENGINES)
def test_recommended_coupling_settles_and_one_beyond_the_limit_does_not(module, tmp_path):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed (the extra engines)")
    picture, done = run(module, tmp_path)
    assert done.returncode == 0, done.stderr
    counts = re.findall(rf"{ENGINES[module]}, .*: (\d) of 8 hands settle", done.stdout)
    assert counts == ["8", "0"]
    assert picture.read_bytes().startswith(b"\x89PNG")


# The example of a teleoperator over a socket: two boards with the exported C settle on a late link with losses.

EXAMPLE = Path(__file__).parents[2] / "problems" / "examples" / "teleoperation_loopback.py"


@pytest.mark.slow
def test_two_boards_settle_and_are_drawn(tmp_path):
    """Slowed down: where other work takes the processor for long, the link is silent, and its force fades."""
    require("cc")
    picture = tmp_path / "link.png"
    command = [sys.executable, str(EXAMPLE), "--slower", "10", "--out", str(picture)]
    done = subprocess.run(  # noqa: S603
        command, capture_output=True, text=True, check=False, env={**os.environ, "CC": "cc"}, cwd=tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert ": settles, " in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
