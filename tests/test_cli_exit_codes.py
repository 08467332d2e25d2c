"""0 done, 1 the answer is no, 2 bad input, 130 interrupted; never a traceback; refusals obey --json."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time

import pytest
from avc_process import AVC, ENVIRONMENT, avc, strict_json

from avc_casadi import dump_problem, load_problem, solve
from avc_casadi.cli import main

FIVE_FAULTS = """\
title = "five faults"
[device]
mass_kg = -0.1
damping_ns_per_m = "2"
[environment]
damping_ns_per_m = 10.0
stiffness_n_per_m = inf
[coupling]
structure = "parallel"
colour = "red"
"""


def text_of(done):
    text = done.stderr.decode()
    assert "Traceback" not in text
    return text


@pytest.mark.thorough
def test_five_faults_give_five_messages(tmp_path):
    (tmp_path / "bad.toml").write_text(FIVE_FAULTS)
    done = avc("solve", "bad.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == b""
    lines = text_of(done).splitlines()
    assert lines[-1] == "avc: 5 faults"
    places = [line.removeprefix("avc: ").split(": ")[0] for line in lines[:-1]]
    assert places == ["bad.toml:3", "bad.toml:4", "bad.toml:7", "bad.toml:9", "bad.toml:10"]

    done = avc("solve", "bad.toml", "--json", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == b""
    errors = strict_json(done.stdout)["errors"]
    assert [error["line"] for error in errors] == [3, 4, 7, 9, 10]
    assert [error["key"] for error in errors][:2] == ["device.mass_kg", "device.damping_ns_per_m"]
    assert all(set(error) == {"file", "line", "key", "message"} for error in errors)


@pytest.mark.parametrize(
    ("arguments", "key", "words"),
    [
        (("solve", "figgure5"), "", "figure5"),
        (("solve", "figure5", "--method", "magic"), "--method", "closed-form, direct, exact"),
        (("solve", "figure5", "--solver", "magic"), "--solver", "ipopt"),
        (("solve", "figure5", "--tolerance", "tight"), "--tolerance", "tight"),
        (("solve", "figure5", "--out", "gains.xls"), "--out", ".json, .csv"),
        (("solve", "figure5", "--out", "nowhere/gains.json"), "--out", "nowhere"),
        (("solve", "figure5", "--method", "direct", "--as-printed"), "--as-printed", "closed-form"),
        (("compare", "figure5", "--mine", "7000"), "--mine", "K,B"),
        (("compare", "figure5", "--mine", "7000,-1"), "--mine", ">= 0"),
        (("compare", "figure5", "--plot", "f.bmp"), "--plot", ".png, .svg, .pdf"),
        (("simulate", "soft", "--screen", "--explain"), "--explain", "--screen"),
        (("simulate", "soft", "--tolerance", "0.1"), "--tolerance", "--screen"),
        (("push", "missing.json", "--port", "emulator"), "", "does not exist"),
        (("push", "missing.json"), "", "--port"),
        (("monitor", "--port", "emulator", "--rate-hz", "0"), "--rate-hz", "above 0"),
        (("run", "figure5", "--out", "file"), "--out", "file"),
        (("paint",), "VERB", "solve"),
        ((), "", "VERB"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_bad_input(arguments, key, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way of a folder")
    assert main(arguments) == 2
    plain = capsys.readouterr()
    assert plain.out == ""
    assert words in plain.err

    assert main([*arguments, "--json"]) == 2
    answered = capsys.readouterr()
    (error,) = json.loads(answered.out)["errors"]
    assert error["key"] == key
    assert words in error["message"] or words in error["file"]
    assert answered.err == ""


def feasible_with(frequency_hz, more_damping):
    """Whether the infeasible box has passive gains at this frequency on a device with more damping."""
    problem = load_problem("hard/infeasible-box")
    device = problem.device.model_copy(update={"damping_ns_per_m": problem.device.damping_ns_per_m + more_damping})
    frequency = problem.frequency.model_copy(update={"values_hz": (frequency_hz,)})
    return solve(problem.model_copy(update={"device": device, "frequency": frequency}), "exact").usable[0]


@pytest.mark.thorough
def test_infeasible_box_names_the_constraint_and_the_smallest_relaxation():
    done = avc("solve", "hard/infeasible-box")
    assert done.returncode == 1
    text = text_of(done)
    assert "200 of 200 frequencies have no gains" in text
    assert "stability.margin_ns_per_m" in text
    told = re.findall(r"infeasible at (\S+) Hz: .* missed by (\S+): add as much device damping", text)
    assert len(told) == 2
    for frequency, missed in told:
        assert feasible_with(float(frequency), 1.001 * float(missed))
        assert not feasible_with(float(frequency), 0.97 * float(missed))
    assert avc("compare", "hard/infeasible-box", "--json").returncode == 1


@pytest.mark.thorough
def test_what_is_not_deployable_is_refused_and_names_the_claim(tmp_path):
    few = load_problem("figure5").changed(frequency={"points": 20})
    (tmp_path / "few.toml").write_text(dump_problem(few))
    assert avc("solve", "few.toml", "--out", "c.json", cwd=tmp_path).returncode == 0
    for verb in (("push", "c.json", "--port", "emulator"), ("export", "c.json", "--c", "c")):
        done = avc(*verb, "--json", cwd=tmp_path)
        assert done.returncode == 1
        (error,) = strict_json(done.stdout)["errors"]
        assert "hands (L5): linearly unstable with a hand of" in error["message"]
        assert "avc recommend" in error["message"]
        assert avc(*verb, "--unsafe", cwd=tmp_path).returncode == 0
    said = avc("push", "c.json", "--port", "emulator", "--unsafe", "--json", cwd=tmp_path)
    document = strict_json(said.stdout)
    assert document["unsafe"].startswith("UNSAFE, went on by request: not deployable: hands")
    assert document["deployable"]["pass"] is False


@pytest.mark.thorough
def test_refused_push_is_a_no(tmp_path):
    (tmp_path / "stiff.csv").write_text("frequency_hz,damping_ns_per_m,stiffness_n_per_m\n5.0,0.0,2e8\n50.0,0.0,2e8\n")
    done = avc("push", "stiff.csv", "--problem", "soft", "--port", "emulator", "--unsafe", "--json", cwd=tmp_path)
    assert done.returncode == 1
    (error,) = strict_json(done.stdout)["errors"]
    assert "narrow coupling.stiffness_n_per_m" in error["message"]


WEAK = """\
[device]
mass_kg = 0.1
damping_ns_per_m = 0.01
[environment]
damping_ns_per_m = 10.0
stiffness_n_per_m = 1e5
[stability]
model = "sampled-data"
scope = "{scope}"
[frequency]
values_hz = [5.0, 50.0]
"""


@pytest.mark.thorough
@pytest.mark.parametrize(("scope", "level"), [("pointwise", "L0"), ("band", "L1"), ("all", "L3"), ("hands", "L5")])
def test_certify_says_no_to_what_may_not_be_deployed_whatever_the_problem_claims(scope, level, tmp_path):
    (tmp_path / "weak.toml").write_text(WEAK.format(scope=scope))
    (tmp_path / "stiff.csv").write_text(
        "frequency_hz,damping_ns_per_m,stiffness_n_per_m\n5.0,1000.0,1e7\n50.0,1000.0,1e7\n"
    )
    done = avc("certify", "weak.toml", "stiff.csv", "-v", cwd=tmp_path)
    assert done.returncode == 1
    assert text_of(done) == "avc: weak: stiff.csv is not deployable\n"
    text = done.stdout.decode()
    assert "✗ Deployable     no: not linearly stable with hands" in text
    (asked,) = [line.split(maxsplit=2)[2] for line in text.splitlines() if line.startswith("    Asked for ")]
    (tmp_path / "soft.csv").write_text("frequency_hz,damping_ns_per_m,stiffness_n_per_m\n5.0,5.0,1e3\n50.0,5.0,1e3\n")
    done = avc("certify", "weak.toml", "soft.csv", "--json", cwd=tmp_path)
    assert done.returncode == 0
    document = strict_json(done.stdout)
    assert document["deployable"]["pass"] is True
    assert document["claimed"] == level
    assert asked == f"{document['levels'][level]['title']}: not met"


@pytest.mark.thorough
def test_the_problem_that_diverges_is_not_deployable(tmp_path):
    assert avc("solve", "diverging", "--method", "exact", "--out", "c.json", cwd=tmp_path).returncode == 0
    done = avc("certify", "c.json", cwd=tmp_path)
    assert done.returncode == 1
    assert text_of(done) == "avc: diverging: c.json is not deployable\n"
    assert "✗ Released       linearly unstable when released" in done.stdout.decode()


@pytest.mark.thorough
def test_the_coupling_file_holds_the_solve_document(tmp_path):
    done = avc("solve", "soft", "--out", "c.json", "--json", cwd=tmp_path)
    solved, written = strict_json(done.stdout), json.loads((tmp_path / "c.json").read_text())
    assert written["schema"] == "avc-coupling/1"
    assert written["certificate"]["levels"] == solved["certificate"]["levels"]
    assert written["certificate"]["deployable"] == solved["deployable"]
    own = {"schema", "kind", "certificate", "structure"}
    assert {key: value for key, value in solved.items() if key not in own}.items() <= written.items()


SLOW = """\
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
[environment]
damping_ns_per_m = 10.0
stiffness_n_per_m = 1e5
[frequency]
points = 20000
"""


@pytest.mark.thorough
@pytest.mark.parametrize("solver", ["sqpmethod-qrqp", "ipopt", "sqpmethod"])
@pytest.mark.parametrize("as_json", [False, True], ids=["text", "json"])
def test_interrupted(solver, as_json, tmp_path):
    """The progress line on a terminal tells when the solve has begun."""
    (tmp_path / "slow.toml").write_text(SLOW)
    terminal, slave = pty.openpty()
    arguments = ["solve", "slow.toml", "--solver", solver, *(["--json"] if as_json else [])]
    with subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "avc_casadi", *arguments],
        stdout=subprocess.PIPE,
        stderr=slave,
        cwd=tmp_path,
        env=ENVIRONMENT,
    ) as process:
        os.close(slave)
        seen = b""
        while b"..." not in seen:
            seen += os.read(terminal, 1024)
        time.sleep(1)  # past the imports, into the solver; an interrupt before it ends the same way
        process.send_signal(signal.SIGINT)
        out = process.communicate(timeout=60)[0]
    while chunk := _read(terminal):
        seen += chunk
    os.close(terminal)
    assert process.returncode == 130
    assert b"Traceback" not in seen
    if as_json:
        assert strict_json(out)["errors"][0]["message"] == "interrupted"
    else:
        assert out == b""
        assert b"avc: interrupted" in seen


def _read(terminal):
    try:
        return os.read(terminal, 1024)
    except OSError:  # how Linux reports the end of a pseudo-terminal
        return b""


@pytest.mark.thorough
def test_no_progress_in_a_pipe():
    assert avc("solve", "figure5").stderr == b""


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", [("list",), ("--help",), ("solve", "figure5", "--json")], ids=" ".join)
def test_broken_pipe(arguments):
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(  # noqa: S603
        [*AVC, *arguments], stdout=writer, stderr=subprocess.PIPE, env=ENVIRONMENT, check=False
    )
    os.close(writer)
    assert done.returncode == 141
    assert done.stderr == b""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full is Linux's")
@pytest.mark.parametrize("arguments", [("list",), ("--help",)], ids=" ".join)
def test_full_disk(arguments):
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        done = subprocess.run(  # noqa: S603
            [*AVC, *arguments], stdout=full, stderr=subprocess.PIPE, env=ENVIRONMENT, check=False
        )
    assert done.returncode == 2
    assert "No space left" in text_of(done)


def test_internal_errors_are_not_mistaken_for_a_no(monkeypatch, capsys):
    def fail(*_):
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("avc_casadi.cli.look.run_list", fail)
    assert main(["list", "--json"]) == 70
    answered = capsys.readouterr()
    assert "planted" in json.loads(answered.out)["errors"][0]["message"]
    assert "ZeroDivisionError" in answered.err


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == "avc-casadi 0.2.0\n"


@pytest.mark.thorough
@pytest.mark.parametrize(("scope", "level"), [("pointwise", ""), ("band", "L1"), ("all", "L3")])
def test_solve_says_yes_where_gains_were_found_and_tells_whether_they_are_deployable(scope, level, tmp_path):
    (tmp_path / "weak.toml").write_text(WEAK.format(scope=scope).replace("0.01", "2.0"))
    done = avc("solve", "weak.toml", "--method", "exact", cwd=tmp_path)
    assert done.returncode == 0
    (line,) = [line for line in done.stdout.decode().splitlines() if "Deployable" in line]
    assert line.split()[:4] == ["✗", "Deployable", "no:", "linearly"]
    document = strict_json(avc("solve", "weak.toml", "--method", "exact", "--json", cwd=tmp_path).stdout)
    assert None not in document["damping_ns_per_m"]
    assert document["deployable"]["pass"] is False
    for notes in (
        document["notes"],
        strict_json(avc("solve", "weak.toml", "--as-printed", "--json", cwd=tmp_path).stdout)["notes"],
    ):
        assert any(f"scope {scope}" in note for note in notes) == bool(level)


@pytest.mark.thorough
def test_what_a_command_reads_it_does_not_write_over(tmp_path, capsys):
    gains = tmp_path / "c.json"
    main(["solve", "soft", "--out", str(gains)])
    before = gains.read_text()
    for arguments in (["solve", str(gains), "--out", str(gains)], ["simulate", "soft", "--gains", str(gains)]):
        extra = [] if "--out" in arguments else ["--trace", str(tmp_path / "c.npz")]
        assert main([*arguments, *extra]) == 2
        assert "is a file that this command was given; choose another name" in capsys.readouterr().err
    assert gains.read_text() == before
    assert not (tmp_path / "c.npz").exists()
