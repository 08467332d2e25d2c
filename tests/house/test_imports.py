"""The rooms of the package stand on one another: every import, a late one too, points down."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# From the ground up; a room may import those before it and itself. The order is that of the data: plain numbers,
# the paper's equations, files, claims, simulation, and what stands on all of them.
ROOMS = (
    "_errors",
    "_util",
    "model",
    "paper",
    "coupling",
    "loops",
    "files",
    "claims.prove",
    "claims",
    "simulation.runtime",
    "simulation.effects",
    "simulation",
    "simulation.population",
    "identification",
    "identification.excitation",
    "diagnose",
    "design",
    "design.comparison",
    "recommendation",
    "present.words",
    "present.row",
    "present.rows",
    "present.figures",
    "present.report",
    "present.explore",
    "avc_hardware.codegen",
    "avc_hardware.emulator",
    "avc_hardware.link",
    "avc_hardware.in_the_loop",
    "avc_hardware",
    "cli",
    "_entry",
)
# What all rooms of a family share, below them.
SHARED = {
    "simulation.tick": "simulation.runtime",
    "simulation.contact": "simulation.runtime",
    "simulation.advance": "simulation",
}


def modules():
    for folder in (ROOT / "avc_casadi", ROOT / "hardware" / "avc_hardware"):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder.parent).with_suffix("").parts
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


MODULES = dict(modules())


def imported(name, path):
    """Every module that a file imports, wherever in it, with the line."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}:{node.lineno}: relative import"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield (whole if whole in MODULES else node.module), node.lineno
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno


def room(name):
    inner = name.removeprefix("avc_casadi").lstrip(".")
    for part, where in SHARED.items():
        if inner == part or inner.startswith(f"{part}."):
            return where
    found = [one for one in ROOMS if inner == one or inner.startswith(f"{one}.")]
    return max(found, key=len) if found else ""


@cache
def arrows():
    return [
        (name, target, line)
        for name, path in MODULES.items()
        for target, line in imported(name, path)
        if target.split(".")[0] in {"avc_casadi", "avc_hardware"}
    ]


def test_every_module_has_a_room():
    homeless = {name for name in MODULES if not room(name)} - {"avc_casadi", "avc_casadi.__main__"}
    assert homeless <= {"avc_casadi.present"}


@pytest.mark.slow
def test_no_arrow_points_up():
    upward = [
        f"{name}:{line} -> {target}"
        for name, target, line in arrows()
        if room(name) and room(target) and ROOMS.index(room(target)) > ROOMS.index(room(name))
    ]
    assert not upward


@pytest.mark.slow
def test_no_imports_form_a_circle():
    """Late imports and those for annotations count too; the package itself names everything at first use."""
    below = {name: {target for source, target, _ in arrows() if source == name} for name in MODULES}
    del below["avc_casadi"]
    try:
        TopologicalSorter(below).prepare()
    except CycleError as error:
        pytest.fail(f"imports form a circle: {' -> '.join(error.args[1])}")


# What went with 0.3, and names of 0.2: CHANGELOG alone says what to use instead.
GONE = re.compile(
    r"avc (arm|study|screen|ports|limits|clear|store|commission)\b|--compare\b|commission|FOAW|Levant\b|compensator"
    r"|platformio|zephyr|\bL[89]\b|sphinx|measured bounds|\bfatrop\b|\balpaqa\b|ipqp|common_lyapunov"
    r"|felt\.strikes|checkpoint|avc_arm|adam-robotics|built-in image|settling_study|interview",
    re.IGNORECASE,
)


@pytest.mark.slow
def test_help_pages_and_messages_name_nothing_that_went():
    rooms = [path for room in ("avc_casadi", "hardware", "problems") for path in (ROOT / room).rglob("*.*")]
    read = [
        path
        for path in [*rooms, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
        if path.suffix in {".py", ".md", ".toml", ".c", ".h", ".html", ".js", ".csv"}
    ]
    assert {str(path): found[0] for path in read if (found := GONE.search(path.read_text("utf-8")))} == {}
