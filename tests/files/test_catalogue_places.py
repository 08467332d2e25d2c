"""The catalogue is found in a wheel's layout and in a checkout, from any working directory."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import avc_casadi as avc

PACKAGE = Path(avc.__file__).parent
PROGRAM = """
import avc_casadi as avc
print(avc.__file__, len(avc.catalogue()), avc.load_problem("hard/rigid").name, sep="\\n")
"""


def run_in(folder, import_path):
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(import_path)!r})\n{PROGRAM}"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:3]


@pytest.mark.thorough
@pytest.mark.parametrize("data", ["avc_casadi/_problems", "problems"], ids=["wheel", "checkout"])
def test_the_catalogue_is_found(tmp_path, data):
    root, elsewhere = tmp_path / "root", tmp_path / "elsewhere"
    shutil.copytree(PACKAGE, root / "avc_casadi", ignore=shutil.ignore_patterns("_problems", "__pycache__"))
    shutil.copytree(avc.catalogue_path("figure5").parent, root / data)
    elsewhere.mkdir()
    file, count, name = run_in(elsewhere, root)
    assert Path(file).is_relative_to(root)
    assert int(count) == len(avc.catalogue())
    assert name == "hard/rigid"
