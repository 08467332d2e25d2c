"""Weight of the project before and after a redesign: python tests/benchmarks/house.py [--before COMMIT]

Overwrites RESULTS_house.md beside this file. Counts both sides from git's own copies, so that it can be repeated.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RELEASE_0_2_0 = "94998ba"
PACKAGES = ("avc_casadi", "hardware/avc_hardware")
POINTWISE = ("avc_casadi.paper.direct", "avc_casadi.design.pointwise")
"""The module of the pointwise design now, and in release 0.2.0."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", default=RELEASE_0_2_0, help="commit to compare with")
    before = parser.parse_args().before
    sides = [counts(before), counts("HEAD")]
    commit = git("rev-parse", "--short", "HEAD").decode().strip()
    lines = [
        "# Weight of the project",
        "",
        f"Made by `python tests/benchmarks/house.py --before {before}` at {commit}. Python only, without the site's",
        "scripts; a constant is a module-level name in capitals that is a number, or numbers; loaded modules are the",
        "project's own.",
        "",
        f"| | {before} | {commit} |",
        "|---|--:|--:|",
        *(f"| {name} | {old:,} | {new:,} |".replace(",", " ") for name, old, new in rows(*sides)),
    ]
    (HERE / "RESULTS_house.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines[5:]))


def rows(old: dict[str, int], new: dict[str, int]) -> list[tuple[str, int, int]]:
    return [(name, old[name], new[name]) for name in new]


def git(*words: str) -> bytes:
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True).stdout  # noqa: S603, S607


def counts(commit: str) -> dict[str, int]:
    """Return the figures of one commit."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        with tarfile.open(fileobj=io.BytesIO(git("archive", commit))) as archive:
            archive.extractall(root, filter="data")
        code = [path for package in PACKAGES for path in (root / package).rglob("*.py") if "docs" not in path.parts]
        tests = list((root / "tests").rglob("*.py"))
        trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in code}
        return {
            "lines of avc_casadi and avc_hardware": sum(map(lines_of, code)),
            "files of avc_casadi and avc_hardware": len(code),
            "files below 80 lines": sum(lines_of(path) < 80 for path in code),
            "lines of tests": sum(map(lines_of, tests)),
            "files of tests": len(tests),
            "names re-exported between rooms": sum(map(re_exported, trees.items())),
            "named numeric constants": sum(map(constants, trees.values())),
            "modules loaded by the pointwise design": loaded(root),
            "imports of private modules and names in tests": sum(map(private_imports, tests)),
            "monkeypatched lines in tests": sum(path.read_text(encoding="utf-8").count("setattr(") for path in tests),
            "lines of C in git": sum(map(lines_of, (root / "hardware").rglob("*.[ch]"))),
        }


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def re_exported(file: tuple[Path, ast.Module]) -> int:
    """Count names that a package takes from its modules to give them out."""
    path, tree = file
    if path.name != "__init__.py" or path.parent.name in {"avc_casadi", "avc_hardware"}:
        return 0
    taken = (node for node in tree.body if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("avc_"))
    return sum(len(node.names) for node in taken)


def constants(tree: ast.Module) -> int:
    """Count module-level names in capitals whose value is a number, or holds nothing but numbers."""
    found = 0
    for node in tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        if targets and node.value is not None and numeric(node.value):
            names = [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
            found += sum(re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name) is not None for name in names)
    return found


def numeric(value: ast.expr) -> bool:
    leaves = [node for node in ast.walk(value) if isinstance(node, ast.Constant)]
    return bool(leaves) and all(isinstance(leaf.value, int | float) for leaf in leaves)


def loaded(root: Path) -> int:
    """Count the project's modules that the pointwise design loads."""
    for module in POINTWISE:
        code = f"import sys, {module}; print(sum(name.startswith('avc_') for name in sys.modules))"
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-c", code],
            cwd=root,
            env={"PYTHONPATH": str(root)},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode == 0:
            return int(done.stdout)
    raise RuntimeError(done.stderr)


def private_imports(path: Path) -> int:
    """Count the names that a test takes from a private module, and the private names that it takes."""
    found = 0
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("avc_casadi", "avc_hardware")):
            private_module = any(part.startswith("_") for part in (node.module or "").split("."))
            found += sum(private_module or alias.name.startswith("_") for alias in node.names)
    return found


if __name__ == "__main__":
    main()
