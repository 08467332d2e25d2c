"""The rooms of the package stand on one another: every import, a late one too, points down."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
# From the ground up; a room may import those before it and itself. The order is that of the data: plain numbers,
# the paper's equations, files, claims, simulation, and what stands on all of them.
ROOMS = (
    "_errors",
    "_resources",
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


def test_no_arrow_points_up():
    upward = [
        f"{name}:{line} -> {target}"
        for name, target, line in arrows()
        if room(name) and room(target) and ROOMS.index(room(target)) > ROOMS.index(room(name))
    ]
    assert not upward


def test_no_room_imports_what_is_private_to_another():
    """A private module belongs to the package that holds it, and to the packages inside that one."""

    def foreign(name, target):
        owner, _, last = target.rpartition(".")
        package = name if MODULES[name].name == "__init__.py" else name.rpartition(".")[0]
        return last.startswith("_") and not f"{package}.".startswith(f"{owner}.")

    assert not [f"{name}:{line} -> {target}" for name, target, line in arrows() if foreign(name, target)]
