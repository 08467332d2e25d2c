"""Rooms that may be read alone stay so: what paper and model import, what loading one loads, what tests reach into."""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
# The ground that every room stands on: exceptions, array types.
GROUND = {"avc_casadi._errors", "avc_casadi._util"}


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
