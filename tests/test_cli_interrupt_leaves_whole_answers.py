"""Ctrl-C while the process begins, or while its answer is written, leaves no traceback and no broken document."""

import json
import os
import signal
import subprocess
import sys

import pytest
from avc_process import ENVIRONMENT, avc, strict_json
from hardware_bench import host_core
from host_device import HostLink

import avc_hardware
from avc_casadi import InputError, fault_document
from avc_casadi.cli import main
from avc_casadi.cli._files import output_folder

LARGE = """
import sys
from avc_casadi.cli._console import Answer, Console
console = Console(as_json=True)
sys.stderr.write("ready")
sys.stderr.flush()
console.answer(Answer({"samples": list(range(200000))}, ""))
"""


@pytest.mark.thorough
def test_the_answer_is_written_to_its_end():
    with subprocess.Popen(  # noqa: S603
        [sys.executable, "-c", LARGE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT
    ) as process:
        assert process.stderr.read(5) == b"ready"
        start = os.read(process.stdout.fileno(), 100)  # the pipe holds far less than the document
        for _ in range(5):
            process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=600)
    assert strict_json(start + out)["samples"][-1] == 199999
    assert process.returncode == 0
    assert err == b""


BEGIN = """
import os, signal, sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == "MODULE":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
from avc_casadi._entry import run
sys.exit(run())
"""


def interrupted_at(module, *arguments):
    return avc("list", *arguments, program=BEGIN.replace("MODULE", module))


# numpy cannot be loaded a second time after an interrupt: what is said then needs none.
@pytest.mark.thorough
@pytest.mark.parametrize(
    "module",
    ["avc_casadi.cli", "avc_casadi.cli._main", "avc_casadi.cli._list", "avc_casadi.files", "numpy.exceptions"],
)
def test_an_interrupt_of_the_imports_is_answered_like_any_other(module):
    done = interrupted_at(module)
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"avc: interrupted\n")
    done = interrupted_at(module, "--json")
    assert (done.returncode, done.stderr) == (130, b"")
    assert strict_json(done.stdout) == fault_document(InputError.of("interrupted"))


def test_a_folder_that_was_made_goes_again_where_nothing_comes_of_it(tmp_path):
    there = tmp_path / "there"
    there.mkdir()

    def interrupted(asked):
        with output_folder(str(tmp_path / asked), "--out") as folder:
            (folder / "half.json").write_text("{")
            raise KeyboardInterrupt

    for asked in ("new/inner", "there/new"):
        with pytest.raises(KeyboardInterrupt):
            interrupted(asked)
    assert list(tmp_path.iterdir()) == [there]
    assert list(there.iterdir()) == []
    with output_folder(str(tmp_path / "new" / "inner"), "--out") as folder:
        (folder / "whole.json").write_text("{}")
    assert [path.name for path in (tmp_path / "new" / "inner").iterdir()] == ["whole.json"]


@pytest.mark.thorough
def test_an_interrupt_after_the_answer_changes_nothing():
    program = """
import os, signal, sys
from avc_casadi._entry import run
code = run()
os.kill(os.getpid(), signal.SIGINT)
sys.exit(code)
"""
    done = avc("list", "--json", program=program)
    assert done.returncode == 0
    assert strict_json(done.stdout)["schema"] == "avc-list/2"
    assert done.stderr == b""


@pytest.mark.thorough
def test_monitor_keeps_what_it_saw(monkeypatch, capsys):
    seen = list(avc_hardware.monitor(HostLink(host_core()), seconds=0.1, rate_hz=20))

    def stopped(*_arguments, **_options):
        yield from seen
        raise KeyboardInterrupt

    monkeypatch.setattr(avc_hardware, "monitor", stopped)
    assert main(["monitor", "--port", "x", "--json"]) == 130
    document = json.loads(capsys.readouterr().out)
    assert document["errors"][0]["message"] == "interrupted"
    assert [sample["ticks"] for sample in document["samples"]] == [status.ticks for status in seen]
