"""Rooms that may be read alone stay so: what paper and model import, what loading one loads, what tests reach into."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# The ground that every room stands on: exceptions, array types.
GROUND = {"avc_casadi._errors", "avc_casadi._util"}
# Imports of private modules and names in tests: fewer with every change, never more.
PRIVATE_IMPORTS_IN_TESTS = 114


def imports(folder):
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                yield path, node.module, [alias.name for alias in node.names]
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    yield path, alias.name, []


def own(room, others):
    """Modules of the project that a room imports and may not."""
    allowed = {*GROUND, *others, f"avc_casadi.{room}"}
    return [
        f"{path.name}: {module}"
        for path, module, _ in imports(ROOT / "avc_casadi" / room)
        if module.startswith("avc_") and not any(f"{module}.".startswith(f"{one}.") for one in allowed)
    ]


def foreign(room):
    """Packages of others that a room imports."""
    return {
        module.partition(".")[0]
        for _, module, _ in imports(ROOT / "avc_casadi" / room)
        if module.partition(".")[0] not in sys.stdlib_module_names and not module.startswith("avc_")
    }


def test_paper_stands_on_the_model_alone():
    assert own("paper", {"avc_casadi.model"}) == []
    assert foreign("paper") <= {"numpy", "casadi", "mpmath"}


def test_model_stands_on_nothing_of_ours():
    assert own("model", set()) == []
    assert foreign("model") <= {
        "numpy",
        "pydantic",
        "pydantic_core",
        "casadi",
    }  # one look-up for arrays and expressions


def loaded_by(module):
    program = f"import sys, {module}; print(*[name for name in sys.modules if name.startswith('avc_')])"
    environment = {"PYTHONPATH": f"{ROOT}:{ROOT / 'hardware'}"}
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment
    )
    return done.stdout.split()


@pytest.mark.parametrize("module", ["paper.direct", "paper.exact", "paper.closed_form"])
def test_a_method_of_the_paper_loads_fewer_than_forty_modules(module):
    assert 5 < len(loaded_by(f"avc_casadi.{module}")) < 40


def test_hardware_loads_neither_proofs_nor_simulation():
    found = loaded_by("avc_hardware")
    assert not [name for name in found if ".prove" in name or ".simulation" in name]


@pytest.mark.thorough
@pytest.mark.parametrize(
    "module",
    [
        "avc_casadi.claims.certify",
        "avc_casadi.claims.deployable",
        "avc_hardware.codegen.export",
        "avc_hardware.link.push",
    ],
)
def test_proofs_are_loaded_when_one_is_asked_for(module):
    found = loaded_by(module)
    assert module in found
    assert not [name for name in found if ".prove" in name]


@pytest.mark.thorough
def test_tests_reach_into_private_modules_less_and_less():
    reached = [
        (path.name, module, name)
        for path, module, names in imports(ROOT / "tests")
        if module.startswith(("avc_casadi", "avc_hardware"))
        for name in names
        if name.startswith("_") or any(part.startswith("_") for part in module.split("."))
    ]
    assert len(reached) <= PRIVATE_IMPORTS_IN_TESTS
