"""Ctrl-C ends every command that runs for long, wherever it is, and nothing of it goes on."""

import os
import signal
import subprocess
import time

import pytest
from avc_process import AVC, ENVIRONMENT, strict_json

LONG = {
    "table1": ("table1", "--hands", "100000"),
}


def started(arguments, cwd, after_s):
    process = subprocess.Popen(  # noqa: S603
        [*AVC, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=cwd,
        env=ENVIRONMENT,
        start_new_session=True,
    )
    time.sleep(after_s)
    assert process.poll() is None
    return process


def output(process):
    """The pipes close when the last process that writes to them has ended, not when the first has."""
    try:
        return process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


# Wherever in the command these times fall: the end must be the same.
@pytest.mark.parametrize("after_s", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("verb", LONG)
def test_interrupt_ends_the_command(verb, after_s, tmp_path):
    process = started([*LONG[verb], "--json"], tmp_path, after_s)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, err = output(process)
    assert process.returncode == 130, err.decode()
    assert strict_json(out)["errors"][0]["message"] == "interrupted"
    assert err == b""


def test_interrupt_of_the_command_alone_ends_its_workers_too(tmp_path):
    process = started(LONG["table1"], tmp_path, 2.5)
    process.send_signal(signal.SIGINT)
    assert output(process) == (b"", b"avc: interrupted\n")
    assert process.returncode == 130


def test_workers_end_when_the_command_is_killed(tmp_path):
    process = started(LONG["table1"], tmp_path, 2.5)
    process.kill()
    assert output(process) == (b"", b"")
