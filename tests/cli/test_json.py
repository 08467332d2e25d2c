"""With --json, standard output is one JSON document and not a byte more, whatever libraries print."""

import pytest
from avc_process import avc, strict_json

from avc_casadi import dump_problem, load_problem

SOLVE_KEYS = {
    "schema",
    "problem",
    "method",
    "solver",
    "structure",
    "frequency_hz",
    "damping_ns_per_m",
    "stiffness_n_per_m",
    "contact_damping_ns_per_m",
    "impedance_re",
    "impedance_im",
    "target_re",
    "target_im",
    "magnitude_error",
    "complex_error",
    "real_part",
    "status",
    "seconds",
    "certificate",
    "requested_damping_ns_per_m",
    "requested_stiffness_n_per_m",
}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "options",
    [
        ("--as-printed",),
        ("--method", "exact"),
        ("--method", "direct", "--solver", "ipopt"),
    ],
    ids=" ".join,
)
def test_solve(options, tmp_path):
    few = load_problem("figure5").changed(frequency={"points": 40})
    (tmp_path / "few.toml").write_text(dump_problem(few))
    done = avc("solve", "few.toml", *options, "--json", cwd=tmp_path)
    document = strict_json(done.stdout)
    assert set(document) >= SOLVE_KEYS
    rows = len(document["frequency_hz"])
    assert rows == 40
    assert all(len(document[key]) == rows for key in SOLVE_KEYS if isinstance(document[key], list))
    without = [b is None for b in document["damping_ns_per_m"]]
    usable = [status in {"solved", "active-bound"} for status in document["status"]]
    assert without == [not has for has in usable]
    assert done.returncode == (1 if any(without) else 0)
    assert bool(done.stderr) == any(without)


@pytest.mark.thorough
def test_certify(tmp_path):
    assert avc("solve", "figure5", "--out", "gains.json", cwd=tmp_path).returncode == 0
    done = avc("certify", "figure5", "gains.json", "--json", cwd=tmp_path)
    document = strict_json(done.stdout)
    assert done.returncode == 1
    assert document["deployable"]["pass"] is False
    assert document["claimed"] == "L0"
    assert document["levels"]["L0"]["pass"] is True
    assert set(document["levels"]["L3"]) >= {"pass", "margin_ns_per_m", "frequency_hz", "model", "claim"}
    assert document["passive_limit_n_per_m"] == pytest.approx(4000.0)
    solved = strict_json((tmp_path / "gains.json").read_bytes())["certificate"]
    # The file holds the thinned table alone: rows, and with them the worst of them, may differ.
    assert {name: one["pass"] for name, one in solved["levels"].items()} == {
        name: one["pass"] for name, one in document["levels"].items()
    }
    assert solved["deployable"]["pass"] == document["deployable"]["pass"]


NOISE = """
import ctypes, os, sys
from avc_casadi.cli.console import Console
from avc_casadi.present.row import Answer, row
console = Console(as_json="--json" in sys.argv)
os.write(1, b"straight to the descriptor ")
ctypes.CDLL(None).printf(b"left in the buffer of the C library ")
print("printed")
console.say("live")
console.answer(Answer("found", {"found": 1}, rows=(row("text"),)))
"""


def test_libraries_that_print_do_not_reach_standard_output():
    done = avc("--json", program=NOISE)
    assert done.stdout == b'{\n "schema": "avc/1",\n "kind": "found",\n "found": 1\n}\n'
    for noise in (b"straight to the descriptor", b"left in the buffer", b"printed"):
        assert noise in done.stderr
