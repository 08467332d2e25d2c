"""`import avc_casadi` loads none of the heavy libraries, and every public name is there at first use."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import avc_casadi as avc

SOURCE = ast.parse(Path(avc.__file__).read_text(encoding="utf-8"))


def exported():
    """Return the names that a type checker sees."""
    imports = [node for node in ast.walk(SOURCE) if isinstance(node, ast.ImportFrom)]
    return sorted(alias.asname for node in imports for alias in node.names if alias.asname)


def test_no_heavy_library_is_loaded():
    program = (
        f"import sys; sys.path.insert(0, {str(Path(avc.__file__).parent.parent)!r}); import avc_casadi; "
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)  # noqa: S603
    loaded = set(done.stdout.split())
    assert "avc_casadi" in loaded
    assert not loaded & {"casadi", "matplotlib", "numpy", "pydantic", "serial", "unicorn"}


def test_before_ctrl_c_is_handled_next_to_nothing_is_loaded():
    """Ctrl-C while the entry of `avc` is loaded is a traceback: what takes long comes after."""
    root = str(Path(avc.__file__).parent.parent)
    program = f"import sys; before = set(sys.modules); sys.path.insert(0, {root!r}); import avc_casadi._entry; "
    program += "print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-S", "-c", program], capture_output=True, text=True, check=True)  # noqa: S603
    ours = {"avc_casadi", "avc_casadi._entry", "avc_casadi._interrupted"}
    assert ours <= set(done.stdout.split())
    assert not {"typing", "dataclasses", "inspect", "pathlib", "avc_casadi._errors"} & set(done.stdout.split())


@pytest.mark.parametrize("name", exported())
def test_every_typed_name_is_there(name):
    assert getattr(avc, name) is not None
    assert name in dir(avc)


def test_no_name_is_there_that_is_not_typed():
    assert set(avc._LAZY) <= set(exported())
    with pytest.raises(AttributeError, match="no attribute 'lode_problem'"):
        avc.lode_problem  # noqa: B018
