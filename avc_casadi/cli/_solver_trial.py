"""Trial of the CasADi solvers: each on a small problem, in a process that may crash."""

from __future__ import annotations

import json
import subprocess
import sys
from tempfile import TemporaryDirectory
from typing import Any

# Minimise (x - 2)^2 + (y - 1)^2 subject to x + y <= 1 and 0 <= x, y: the optimum is (1, 0).
_OPTIMUM = (1.0, 0.0)
_TOLERANCE = 1e-4
_CRUDE = 1e-2
_SECONDS = 20

# Runs in the child: each trial announces itself before it starts, so that a crash has a name.
_TRIAL = """
import json, os, sys, time
import casadi as ca
out = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(2, 1)
x = ca.MX.sym("x", 2)
f = (x[0] - 2)**2 + (x[1] - 1)**2
g = x[0] + x[1]
needed = {"nlpsol": {"nlpsol": "ipopt"}}
for kind, name in json.loads(sys.argv[1]):
    print(json.dumps([kind, name]), file=out)
    started = time.perf_counter()
    try:
        make = ca.nlpsol if kind == "nlp" else ca.qpsol
        solver = make("s", name, {"x": x, "f": f, "g": g}, needed.get(name, {}))
        found = solver(x0=[0.3, 0.3], lbx=0, ubg=1, lbg=-ca.inf)["x"].full().ravel().tolist()
        result = {"x": found}
    except Exception as error:
        result = {"error": str(error).strip().splitlines()[-1].split(": ", 1)[-1].strip()[:200]}
    print(json.dumps(result | {"seconds": time.perf_counter() - started}), file=out)
"""


def try_solvers() -> list[dict[str, Any]]:
    """Return kind, name, outcome (solves, absent, wrong answer, crashes, ...) and seconds of every solver."""
    waiting = installed_solvers()
    trials: list[dict[str, Any]] = []
    while waiting:
        done = _run(waiting)
        trials += done
        waiting = waiting[len(done) :]
    return trials


def installed_solvers() -> list[tuple[str, str]]:
    """Return (kind, name) of every NLP and QP plugin of this CasADi."""
    import casadi as ca

    plugins = [entry.split("::") for entry in ca.CasadiMeta.plugins().split(";")]
    kinds = {"Nlpsol": "nlp", "Conic": "qp"}
    return [(kinds[entry[0]], entry[1]) for entry in plugins if entry[0] in kinds]


def _run(waiting: list[tuple[str, str]]) -> list[dict[str, Any]]:
    """Try solvers until all are done or one crashes the process; that one is the last of the answer."""
    command = [sys.executable, "-c", _TRIAL, json.dumps(waiting)]
    try:
        # Some plugins leave files where they run.
        with TemporaryDirectory() as folder:
            ended = subprocess.run(  # noqa: S603
                command, cwd=folder, capture_output=True, text=True, timeout=_SECONDS, check=False
            )
        lines, end = ended.stdout.splitlines(), f"crashes (exit {ended.returncode})"
    except subprocess.TimeoutExpired as stopped:
        text = stopped.stdout or b""
        lines = (text.decode() if isinstance(text, bytes) else text).splitlines()
        end = f"does not end within {_SECONDS} s"
    trials = []
    for start in range(0, max(len(lines), 1), 2):
        kind, name = json.loads(lines[start]) if lines else waiting[0]
        result = json.loads(lines[start + 1]) if start + 1 < len(lines) else {"error": end, "seconds": None}
        trials.append({"kind": kind, "name": name, "outcome": _outcome(result), "seconds": result["seconds"]})
    return trials


def _outcome(result: dict[str, Any]) -> str:
    if "error" in result:
        message = str(result["error"])
        if "is not found" in message or "cannot open shared object" in message:
            return "absent"
        return message if message.startswith(("crashes", "does not end")) else f"refuses: {message}"
    distance = max(abs(found - best) for found, best in zip(result["x"], _OPTIMUM, strict=True))
    if distance < _TOLERANCE:
        return "solves"
    return f"solves to {distance:.0e} only" if distance < _CRUDE else f"wrong answer {result['x']}"
