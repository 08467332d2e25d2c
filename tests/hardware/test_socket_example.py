"""The example of a teleoperator over a socket: two boards with the exported C settle on a late link with losses."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hardware_bench import require

EXAMPLE = Path(__file__).parents[2] / "problems" / "examples" / "teleoperation_loopback.py"


@pytest.mark.thorough
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
