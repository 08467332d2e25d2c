"""Without the optional packages everything else works, and what needs one says which."""

import json

import pytest
from avc_process import avc

EXTRAS = ["adam", "cloudpickle", "clarabel", "distributed", "elftools", "mcap", "mpmath", "mujoco", "pandas", "unicorn"]
HIDDEN = f"import sys\nfor name in {EXTRAS}:\n    sys.modules[name] = None\n"
EVERY_MODULE = (
    HIDDEN
    + """
import importlib, json, pkgutil
import avc_casadi as avc
import avc_hardware
missed = {}
for package in (avc, avc_hardware):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if ".docs" not in module.name:
            try:
                importlib.import_module(module.name)
            except avc.MissingExtraError as error:
                missed[module.name] = str(error)
print(json.dumps(missed))
"""
)
REFERENCE = (
    HIDDEN
    + """
import numpy as np
import avc_casadi as avc
from avc_casadi.study.accuracy import reference_errors
print(reference_errors(avc.load_problem("soft"), np.array([1.0, 30.0])).source)
"""
)


def test_every_module_but_the_reference_is_imported():
    done = avc(program=EVERY_MODULE)
    assert done.returncode == 0, done.stderr.decode()
    missed = json.loads(done.stdout)
    assert all(name.startswith("avc_casadi.study.reference") for name in missed)
    assert missed
    assert all("pip install 'avc-casadi[accuracy]'" in why for why in missed.values())


def test_accuracy_falls_back_to_the_exact_method():
    done = avc(program=REFERENCE)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout.decode().strip() == "method exact (mpmath, the extra accuracy, is not installed)"


@pytest.mark.parametrize("verb", ["accuracy", "arm", "monitor", "push", "run", "trial", "firmware"])
def test_every_verb_is_parsed(verb):
    done = avc(verb, "--help", program=HIDDEN + "from avc_casadi.cli import main\nsys.exit(main(sys.argv[1:]))\n")
    assert done.returncode == 0, done.stderr.decode()
