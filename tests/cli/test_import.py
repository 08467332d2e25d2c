"""`import avc_casadi` and `import avc_hardware` load nothing heavy, and every public name is there at first use."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from avc_process import command
from quick import first

import avc_casadi as avc
import avc_hardware

PACKAGES = (avc, avc_hardware)


def exported(package):
    """Return the names that a type checker sees."""
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    branches = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    imports = [node for branch in branches for node in branch.body if isinstance(node, ast.ImportFrom)]
    return sorted(alias.asname or alias.name for node in imports for alias in node.names)


def test_no_heavy_library_is_loaded():
    program = (
        f"import sys; sys.path.insert(0, {str(Path(avc.__file__).parent.parent)!r}); import avc_casadi; "
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)  # noqa: S603
    loaded = set(done.stdout.split())
    assert "avc_casadi" in loaded
    assert not loaded & {"casadi", "matplotlib", "numpy", "pydantic", "serial", "unicorn"}


def test_the_hardware_side_loads_its_own_package_alone():
    """Neither proofs nor simulation nor CasADi: of both packages one module, and little of the library."""
    root = str(Path(avc_hardware.__file__).parent.parent)
    program = f"import sys; before = set(sys.modules); sys.path.insert(0, {root!r}); import avc_hardware; "
    program += "print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-S", "-c", program], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.split() == ["avc_hardware"]


@pytest.mark.parametrize(("package", "name"), [(package, name) for package in PACKAGES for name in exported(package)])
def test_every_typed_name_is_there(package, name):
    assert getattr(package, name) is not None
    assert name in dir(package)


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


@pytest.mark.slow
def test_every_module_is_imported():
    done = command(program=EVERY_MODULE)
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout) > 100


@pytest.mark.parametrize("verb", first(["accuracy", "monitor", "push", "run", "trial", "firmware"]))
def test_every_verb_is_parsed(verb):
    done = command(verb, "--help", program=HIDDEN + "from avc_casadi.cli import main\nsys.exit(main(sys.argv[1:]))\n")
    assert done.returncode == 0, done.stderr.decode()
