"""One version: that of the package, of its citation, and of the Arduino library of exported C."""

import re
from pathlib import Path

import pytest

import avc_casadi as avc

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("CITATION.cff", r"^version: (.+)$"),
        ("hardware/avc_hardware/packaging/library.properties", r"^version=(.+)$"),
        ("CHANGELOG.md", r"^## (\d+\.\d+\.\d+)\b"),
    ],
)
def test_every_file_of_a_release_has_the_version_of_the_package(file, line):
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.findall(line, text, re.MULTILINE)[0] == avc.__version__
