"""Ctrl-C ends every command, wherever it is: with 130, its word, no worker that goes on and no half of a file."""

import os
import signal
import subprocess
import sys
import time

import pytest
from avc_process import ENVIRONMENT, strict_json, wait_until_begun

# A caller that has Ctrl-C ignored, as nohup has, hands that on: here it is not.
PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
BEFORE
from avc_casadi._entry import run
sys.exit(run())
"""
LONG = {
    "recommend": ("recommend", "reference-r1", "--out", "c.json"),
    "run": ("run", "figure5", "--out", "results"),
    "table1": ("table1", "--hands", "100000", "--workers", "2"),
    "monitor": ("monitor", "--port", "emulator", "--seconds", "100000"),
    "stream": ("stream", "figure5", "--port", "emulator", "--seconds", "100000"),
    "solve": ("solve", "slow.toml", "--method", "static-tuned"),
}
NEEDED = {"monitor": "libunicorn", "stream": "libunicorn"}
SLOW = """\
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
coulomb_friction_n = 0.2
[environment]
damping_ns_per_m = 10.0
stiffness_n_per_m = 1e5
[coupling]
structure = "damped"
contact_damping_ns_per_m = [0.0, 200.0]
[frequency]
points = 20000
"""


def begun(arguments, cwd, before=""):
    return subprocess.Popen(  # noqa: S603
        [sys.executable, "-W", "error", "-c", PROGRAM.replace("BEFORE", before), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=cwd,
        env=ENVIRONMENT,
        start_new_session=True,
    )


def output(process):
    """The pipes close when the last process that writes to them has ended, not when the first has."""
    try:
        return process.communicate(timeout=600)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "after_s"), [*zip(LONG, (2.0, 3.0, 0.3, 1.5, 1.5, 0.3), strict=True)])
def test_interrupt_ends_the_command_and_leaves_no_half_written_file(verb, after_s, tmp_path):
    (tmp_path / "slow.toml").write_text(SLOW)
    process = begun([*LONG[verb], "--json"], tmp_path)
    wait_until_begun(process, NEEDED.get(verb, "_casadi"))
    time.sleep(after_s)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, err = output(process)
    assert process.returncode == 130, err.decode()
    assert strict_json(out)["errors"][0]["message"] == "interrupted"
    assert all(b" ..." in line for line in err.splitlines()), err  # progress, where it took longer than ten seconds
    assert [path.name for path in tmp_path.iterdir()] == ["slow.toml"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stop", "said", "code"),
    [
        (signal.SIGINT, b"avc: interrupted\n", 130),
        (signal.SIGTERM, b"avc: interrupted\n", 143),
        (signal.SIGKILL, b"", -signal.SIGKILL),
    ],
)
def test_workers_end_with_the_command(stop, said, code, tmp_path):
    """The pipes close as the workers have ended; the tracker of semaphores reports none as leaked."""
    process = begun(LONG["table1"], tmp_path)
    wait_until_begun(process, "_casadi", workers=1)
    process.send_signal(stop)
    assert output(process) == (b"", said)
    assert process.returncode == code
