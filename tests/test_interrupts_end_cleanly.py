"""Ctrl-C ends every command that runs for long, wherever it is, and nothing of it goes on."""

import contextlib
import os
import signal
import subprocess
import time

import casadi
import pytest
from avc_process import AVC, ENVIRONMENT, strict_json, wait_until_begun

from avc_casadi._util.interrupt import HeldInterrupt, reraised_interrupts
from avc_casadi.cli import _main

LONG = {
    "table1": ("table1", "--hands", "100000", "--workers", "2"),
    "monitor": ("monitor", "--port", "emulator", "--seconds", "100000"),
    "stream": ("stream", "figure5", "--port", "emulator", "--seconds", "100000"),
    "static-tuned": ("solve", "slow.toml", "--method", "static-tuned"),
}
# What each loads when it has read its arguments; Ctrl-C before that ends it without a document.
NEEDED = {"table1": "_casadi", "monitor": "libunicorn", "stream": "libunicorn", "static-tuned": "_casadi"}
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


def started(verb, cwd, after_s, *options, workers=0):
    process = subprocess.Popen(  # noqa: S603
        [*AVC, *LONG[verb], *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=cwd,
        env=ENVIRONMENT,
        start_new_session=True,
    )
    try:
        wait_until_begun(process, NEEDED[verb], workers=workers)
        time.sleep(after_s)
        assert process.poll() is None
    except BaseException:
        _ended(process)
        raise
    return process


def output(process):
    """The pipes close when the last process that writes to them has ended, not when the first has."""
    try:
        return process.communicate(timeout=600)
    finally:
        _ended(process)


def _ended(process):
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


# Wherever in the command these times fall: the end must be the same.
@pytest.mark.thorough
@pytest.mark.parametrize(("verb", "after_s"), [*zip(LONG, (0.3, 1.5, 0.3, 1.5), strict=True)])
def test_interrupt_ends_the_command(verb, after_s, tmp_path):
    (tmp_path / "slow.toml").write_text(SLOW)
    process = started(verb, tmp_path, after_s, "--json")
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, err = output(process)
    assert process.returncode == 130, err.decode()
    assert strict_json(out)["errors"][0]["message"] == "interrupted"
    assert err == b""


@pytest.mark.thorough
def test_interrupt_of_the_command_alone_ends_its_workers_too(tmp_path):
    process = started("table1", tmp_path, 0.5, workers=2)
    process.send_signal(signal.SIGINT)
    assert output(process) == (b"", b"avc: interrupted\n")
    assert process.returncode == 130


@pytest.mark.thorough
def test_workers_end_when_the_command_is_killed(tmp_path):
    process = started("table1", tmp_path, 0.5, workers=2)
    process.kill()
    assert output(process) == (b"", b"")


def interrupted_block(seen):
    with HeldInterrupt() as interrupt:
        seen.append(interrupt.came)
        signal.raise_signal(signal.SIGINT)
        seen.append(interrupt.came)


def test_interrupt_is_held_until_the_end_of_the_block():
    seen = []
    with pytest.raises(KeyboardInterrupt):
        interrupted_block(seen)
    assert seen == [False, True]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class Interrupted:
    """An argument that Ctrl-C comes in while CasADi reads it."""

    def __init__(self, read=None):
        self.read = read

    def __DM__(self):  # noqa: N802 - CasADi's name
        signal.raise_signal(signal.SIGINT)
        return self.read


def doubled(read):
    """Return what CasADi makes of it; it tries to read the argument as another kind where it could not."""
    x = casadi.SX.sym("x")
    return casadi.Function("double", [x], [2 * x])(Interrupted(read))


def test_an_interrupt_that_casadi_makes_an_error_of_is_one():
    with pytest.raises(NotImplementedError):
        doubled(None)
    with pytest.raises(KeyboardInterrupt), reraised_interrupts():
        doubled(None)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def lost(tidied):
    with contextlib.suppress(NotImplementedError):
        doubled(None)
    try:
        time.sleep(60.0)
    finally:
        time.sleep(0.3)
        tidied.append(True)


def test_an_interrupt_that_casadi_loses_is_raised_again_and_left_alone_while_it_is_handled():
    tidied = []
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), reraised_interrupts(), reraised_interrupts():
        lost(tidied)
    assert time.monotonic() < begun + 30.0
    assert tidied == [True]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(
    ("words", "cause"),
    [("in CasADi: KeyboardInterrupt", None), ("returned a result with an exception set", KeyboardInterrupt())],
)
def test_interrupt_is_seen_in_an_error_that_it_caused(words, cause, monkeypatch, capsys):
    def run(_args, _console):
        raise SystemError(words) from cause

    parser = _main.build_parser()
    args = parser.parse_args(["list"])
    args.run = run
    monkeypatch.setattr(parser, "parse_args", lambda _: args)
    monkeypatch.setattr(_main, "build_parser", lambda: parser)
    assert _main.main(["list"]) == 130
    assert capsys.readouterr() == ("", "avc: interrupted\n")


@pytest.mark.thorough
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_an_interrupted_stream_says_what_the_device_does_without_it(options, tmp_path):
    process = started("stream", tmp_path, 0.0, *options)
    first = b"" if options else process.stdout.readline()
    if options:
        time.sleep(5.0)
    process.send_signal(signal.SIGINT)
    out, err = output(process)
    assert process.returncode == 130, err.decode()
    if options:
        document = strict_json(out)
        assert document["errors"][0]["message"] == "interrupted"
        assert document["sent"] > 0
    else:
        assert b"force" in first
        assert b"the emulated board ends with this command" in out
