"""Without the optional packages everything else works, and what needs one says which."""

import json
from pathlib import Path

import pytest
from avc_process import avc

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
EXTRAS = ["cloudpickle", "distributed", "elftools", "mpmath", "mujoco", "pandas", "unicorn"]
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


@pytest.mark.thorough
def test_every_module_is_imported():
    done = avc(program=EVERY_MODULE)
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout) > 300


@pytest.mark.parametrize("verb", ["accuracy", "monitor", "push", "run", "trial", "firmware"])
def test_every_verb_is_parsed(verb):
    done = avc(verb, "--help", program=HIDDEN + "from avc_casadi.cli import main\nsys.exit(main(sys.argv[1:]))\n")
    assert done.returncode == 0, done.stderr.decode()
