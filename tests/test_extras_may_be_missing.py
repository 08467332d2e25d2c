"""Without the optional packages everything else works, and what needs one says which."""

import json
from pathlib import Path

import pytest
from avc_process import avc

BENCHMARKS = Path(__file__).parent / "benchmarks"
EXTRAS = ["cloudpickle", "distributed", "elftools", "mcap", "mpmath", "mujoco", "pandas", "unicorn"]
HIDDEN = f"import sys\nfor name in {EXTRAS}:\n    sys.modules[name] = None\n"
EVERY_MODULE = (
    HIDDEN
    + """
import importlib, json, pkgutil
import avc_casadi as avc
import avc_hardware
count = 0
for package in (avc, avc_hardware):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
        count += 1
print(json.dumps(count))
"""
)
REFERENCE = (
    HIDDEN
    + f"""
import numpy as np
import avc_casadi as avc
sys.path.append({str(BENCHMARKS)!r})
from studies.accuracy.solvers import reference_errors
print(reference_errors(avc.load_problem("soft"), np.array([1.0, 30.0])).source)
"""
)


@pytest.mark.thorough
def test_every_module_is_imported():
    done = avc(program=EVERY_MODULE)
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout) > 300


def test_accuracy_falls_back_to_the_exact_method():
    done = avc(program=REFERENCE)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout.decode().strip() == "method exact (mpmath, the extra accuracy, is not installed)"


@pytest.mark.parametrize("verb", ["study", "monitor", "push", "run", "trial", "firmware"])
def test_every_verb_is_parsed(verb):
    done = avc(verb, "--help", program=HIDDEN + "from avc_casadi.cli import main\nsys.exit(main(sys.argv[1:]))\n")
    assert done.returncode == 0, done.stderr.decode()
