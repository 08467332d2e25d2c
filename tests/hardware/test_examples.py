"""Examples with real engines: what is recommended settles there, 1.3 times the limit does not; both are drawn."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import require

from avc_casadi.model.ends import ToolGains

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


def loopback():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("teleoperation_loopback", EXAMPLES / "teleoperation_loopback.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("late_s", "slower", "needed"), [(0.0009, 1.0, None), (0.004, 1.0, "8"), (0.003, 10.0, "60")])
def test_samples_that_come_late_ask_for_a_slower_run(late_s, slower, needed):
    """Twice as slow as what brings the latest sample into its period."""
    at_rest = [np.zeros((5000, 3)), np.zeros((5000, 3))]
    text = "\n".join(loopback().result_lines(at_rest, ToolGains(600.0, 5.0), late_s, slower))
    assert re.findall(r"--slower (\d+)", text) == ([] if needed is None else [needed])


@pytest.mark.slow
def test_two_boards_settle_and_are_drawn(tmp_path):
    """Slowed down: where other work takes the processor for long, the link is silent, and its force fades."""
    require("cc")
    picture = tmp_path / "link.png"
    done = run("teleoperation_loopback", "--slower", 6, "--out", picture, CC="cc")
    assert done.returncode == 0, done.stdout + done.stderr
    assert ": settles, " in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
