"""A solver that crashes, hangs or lies is told as such, and the others are tried all the same."""

import pytest
from avc_process import avc, strict_json

from avc_casadi.cli import _solver_trial

TRIAL = """
import json, os, sys, time
out = os.fdopen(os.dup(1), "w", buffering=1)
for kind, name in json.loads(sys.argv[1]):
    print(json.dumps([kind, name]), file=out)
    if name == "crashes":
        os.abort()
    if name == "hangs":
        time.sleep(600)
    result = {"x": [1.0, 0.0]}
    if name == "lies":
        result = {"x": [2.0, 1.0]}
    if name == "crude":
        result = {"x": [1.001, 0.0]}
    if name == "missing":
        result = {"error": "Plugin 'missing' is not found."}
    print(json.dumps(result | {"seconds": 0.0}), file=out)
"""


def test_each_outcome_is_told(monkeypatch):
    names = ["well", "crashes", "hangs", "lies", "crude", "missing", "crashes", "well"]
    monkeypatch.setattr(_solver_trial, "_TRIAL", TRIAL)
    run = _solver_trial._run

    def impatient_with_the_one_that_hangs(waiting):
        monkeypatch.setattr(_solver_trial, "_SECONDS", 1 if waiting[0][1] == "hangs" else 600)
        return run(waiting)

    monkeypatch.setattr(_solver_trial, "_run", impatient_with_the_one_that_hangs)
    monkeypatch.setattr(_solver_trial, "installed_solvers", lambda: [("nlp", name) for name in names])
    trials = _solver_trial.try_solvers()
    assert [trial["name"] for trial in trials] == names
    assert [trial["outcome"] for trial in trials] == [
        "solves",
        "crashes (exit -6)",
        "does not end within 1 s",
        "wrong answer [2.0, 1.0]",
        "solves to 1e-03 only",
        "absent",
        "crashes (exit -6)",
        "solves",
    ]


@pytest.mark.thorough
def test_the_installed_casadi_solves(tmp_path):
    done = avc("doctor", "--json", cwd=tmp_path)
    outcomes = {(trial["kind"], trial["name"]): trial["outcome"] for trial in strict_json(done.stdout)["solvers"]}
    assert done.returncode == 0
    for solver in (("nlp", "ipopt"), ("nlp", "sqpmethod"), ("qp", "qrqp"), ("qp", "daqp")):
        assert outcomes[solver] == "solves"
    assert list(tmp_path.iterdir()) == []
