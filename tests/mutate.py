"""Break the code in small ways, drawn at random, and see how many the tests notice: `python tests/mutate.py --help`.

A mutant is one change in one place: a sign, a constant times 1.2, a clip that is dropped, < for <=, a slice off by one,
an assignment that is not made. It is tried in a copy of the tree by the test files that reach its module through their
imports, nearest first, quick tests before slow ones, for --limit s of processor time. What is not noticed by then has
survived, though it may be equivalent or only slow to show: rates compare with rates of the same time. C is not mutated:
what the firmware's tests notice is counted by tests/benchmarks/mutations.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import math
import multiprocessing
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, chain, pairwise, product, repeat, zip_longest
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything loads NumPy

ROOT = Path(__file__).resolve().parent.parent
# Everything imports these, which only hand on names.
DOORS = {ROOT / "avc_casadi" / "__init__.py", ROOT / "hardware" / "avc_hardware" / "__init__.py"}
NO_JUDGES = ("tests/house/", "cli/test_import")
LIMIT_S = 60
LOADED = ("numpy", "scipy.optimize", "scipy.signal", "scipy.stats", "casadi", "pydantic.main", "hypothesis", "pytest")
# So many files are tried at once, the nearest first.
STEPS = (0, 3, 9, 21, 45)
LATE, NO_TESTS, BY_CHANCE = 77, 5, 0.05
ONE_STANDS, FIRST_STANDS = {"abs", "fabs"}, {"max", "min", "clip", "maximum", "minimum", "fmax", "fmin"}
NO_CODE = {"__all__", "linewidth", "alpha", "figsize", "fontsize", "zorder", "width", "height", "pad", "dpi"}
FLIPPED = {ast.Add: (b"+", b"-"), ast.Sub: (b"-", b"+")}
SWAPPED = {ast.Lt: (b"<", b"<="), ast.LtE: (b"<=", b"<"), ast.Gt: (b">", b">="), ast.GtE: (b">=", b">")}

MARKS = ("not slow", "slow")
# hypothesis is loaded before pytest looks for it
OPTIONS = ("-x", "-q", "--tb=no", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning")
# Of a process: its copy of the tree, and whether tests that failed pass without a mutant.
OWN, SOUND = dict[str, Path](), dict[str, bool]()


@dataclass(frozen=True)
class Mutant:
    """One change: bytes [start, end) of a file become `new`."""

    room: str
    path: str
    line: int
    function: str
    kind: str
    start: int
    end: int
    new: bytes
    tests: tuple[str, ...] = ()  # instead of the files that reach the module

    def told(self) -> str:
        source = (ROOT / self.path).read_bytes()
        old, new = (" ".join(part.decode().split())[:50] for part in (source[self.start : self.end], self.new))
        return f"{self.path}:{self.line} {self.kind}: {old} -> {new}"


class Places:
    """Where the code of a file can be changed."""

    def __init__(self, room: str, path: Path) -> None:
        self.room, self.path, self.source = room, _told(path), path.read_bytes()
        self.starts = [0, *accumulate(map(len, self.source.splitlines(keepends=True)))]
        self.found: list[Mutant] = []
        self.visit(ast.parse(self.source), "", set())

    def at(self, node: Any) -> tuple[int, int]:
        start, end = self.starts[node.lineno - 1], self.starts[node.end_lineno - 1]
        return start + node.col_offset, end + node.end_col_offset

    def visit(self, node: Any, function: str, bound: set[str]) -> None:
        if _is_no_code(node):
            return
        for kind, (start, end), new in self.changes(node, function, bound):
            self.found.append(Mutant(self.room, self.path, node.lineno, function, kind, start, end, new))
        skipped = {"annotation", "decorator_list", "returns"}
        if isinstance(node, ast.FunctionDef):
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            function, bound = node.name, {one.arg for one in arguments}
        elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant | ast.UnaryOp):
            skipped.add("slice")  # an index
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            bound.add(node.id)
        for name, value in ast.iter_fields(node):
            for one in value if isinstance(value, list) else [value]:
                if name not in skipped and isinstance(one, ast.AST):
                    self.visit(one, function, bound)

    def changes(self, node: Any, function: str, bound: set[str]) -> Iterator[tuple[str, tuple[int, int], bytes]]:
        """Yield what can be changed in a node: kind, bytes from and to, what stands there instead."""
        if isinstance(node, ast.BinOp) and type(node.op) in FLIPPED and not _is_text(node.left, node.right):
            yield from self.token("flip", node.left, node.right, FLIPPED[type(node.op)])
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield "flip", (self.at(node)[0], self.at(node)[0] + 1), b"+"
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
            yield from self.token("swap", node.left, node.comparators[0], SWAPPED[type(node.ops[0])])
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value != 0.0:
            larger = 1.2 * node.value if isinstance(node.value, float) else max(node.value + 1, round(1.2 * node.value))
            yield "scale", self.at(node), repr(larger).encode()
        elif (
            isinstance(node, ast.Call)
            and node.args
            and _name(node.func) in (ONE_STANDS if len(node.args) == 1 else FIRST_STANDS)
        ):
            yield "drop", self.at(node), b"(" + self.source[slice(*self.at(node.args[0]))] + b")"
        elif isinstance(node, ast.Slice) and (node.lower or node.upper):
            at = self.at(node.upper or node.lower)
            yield "slice", at, b"(" + self.source[slice(*at)] + b") + 1"
        elif isinstance(node, ast.Assign | ast.AugAssign) and function and not _is_text(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            # Only what has a value already: without the others a name is undefined, which anything notices.
            if all(isinstance(one, ast.Attribute | ast.Subscript) or _name(one) in bound for one in targets):
                yield "delete", self.at(node), b"pass"

    def token(self, kind: str, left: Any, right: Any, change: tuple[bytes, bytes]) -> Iterator[tuple[str, Any, bytes]]:
        place = self.source.find(change[0], self.at(left)[1], self.at(right)[0])
        if place >= 0:
            yield kind, (place, place + len(change[0])), change[1]


def _is_no_code(node: Any) -> bool:
    """Text, messages, types and lists of names."""
    match node:
        case ast.FunctionDef(returns=told):
            return told is not None and "str" in ast.unparse(told)
        case ast.Expr(value=ast.Constant()) | ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.Raise() | ast.JoinedStr():
            return True
        case ast.Call(func=called):
            return _name(called).endswith(("Error", "Fault", "fault", "warn", "cast"))
        case ast.Assign(targets=[ast.Name(id=name)]) | ast.keyword(arg=name):
            return name in NO_CODE
    return False


def _name(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _is_text(*nodes: ast.AST) -> bool:
    """Text or lists, for which + is another thing."""
    texts = [one for one in nodes if isinstance(one, ast.Constant) and isinstance(one.value, str | bytes)]
    return bool(texts) or any(isinstance(one, ast.JoinedStr | ast.List | ast.Tuple | ast.ListComp) for one in nodes)


def rooms() -> dict[str, list[Path]]:
    """Return the Python files of each room."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in sorted((ROOT / "avc_casadi").rglob("*.py")):
        inside = path.relative_to(ROOT).parts
        found["avc_casadi" if len(inside) == 2 else f"avc_casadi/{inside[1]}"].append(path)
    for path in sorted((ROOT / "hardware").rglob("*.py")):
        found["hardware"].append(path)
    return dict(sorted(found.items()))


def drawn(asked: Iterable[str], each: int, seed: str) -> Iterator[Mutant]:
    """Draw mutants, every place as likely; rooms take turns, so that a run that is stopped has some of all."""
    columns = []
    for room in asked:
        places = list(chain.from_iterable(Places(room, path).found for path in rooms()[room]))
        chance = random.Random(f"{seed} {room}")  # noqa: S311 - no secret
        columns.append(chance.sample(places, min(each, len(places))))
    yield from filter(None, chain.from_iterable(zip_longest(*columns)))


@cache
def graph() -> dict[str, set[str]]:
    """Return which files a file imports, names that a package passes on followed to where they are defined."""
    tests, known = ROOT / "tests", dict[Path, str]()
    for path in chain(tests.glob("*.py"), tests.glob("*/*.py")):
        known[path] = f"goldens.{path.stem}" if path.parent.name == "goldens" else path.stem
    for base, name in ((ROOT, "avc_casadi"), (ROOT / "hardware", "avc_hardware")):
        for path in (base / name).rglob("*.py"):
            known[path] = ".".join(path.relative_to(base).with_suffix("").parts).removesuffix(".__init__")
    modules = {module: path for path, module in known.items()}
    trees = {path: ast.parse(path.read_bytes()) for path in known}
    passed = {known[path]: _imported(trees[path]) for path in known if path.name == "__init__.py"}
    found = {}
    for path, own in known.items():
        reached = (modules[one] for one in _reached(trees[path], own, modules, passed))
        found[_told(path)] = {_told(one) for one in reached if one not in DOORS}
    return found


def _told(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _imported(tree: ast.AST) -> dict[str, str]:
    nodes = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module)
    return {alias.asname or alias.name: f"{node.module}.{alias.name}" for node in nodes for alias in node.names}


def _reached(tree: ast.AST, own: str, modules: dict[str, Path], passed: dict[str, dict[str, str]]) -> set[str]:
    """Return the modules that a file imports, by a statement, an attribute of the package, or a name in a table."""
    names = list(_imported(tree).values())
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.Attribute):
            names += [f"{base}.{node.attr}" for base in (_name(node.value), "avc_casadi", "avc_hardware")]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isprintable():
            beside, told = own.rpartition(".")[0], node.value.replace(":", ".")
            names += [told, f"{beside}.{told}", f"{beside}._{told}", f"avc_casadi.{told}"] if beside else []
            names += ["avc_casadi.cli"] if told == "avc_casadi" and not beside else []
            # A registry names a package and takes each of its modules.
            names += [one for one in modules if told.startswith("avc_") and one.rpartition(".")[0] == told]
    found = set()
    for name in names:
        package, _, last = name.rpartition(".")
        name = passed.get(package, {}).get(last, name)  # noqa: PLW2901 - where it is defined
        found |= {one for one in (name, name.rpartition(".")[0]) if one in modules}
    return found - {own}


@cache
def judges(path: str, function: str) -> list[str]:
    """Return the test files that reach a module, nearest first; as near, those that name the function or the module."""
    far, here, steps = dict[str, int](), {path}, 0
    while here:
        far, steps = far | dict.fromkeys(here, steps), steps + 1
        here = {importer for importer, imported in graph().items() if imported & here} - set(far)
    found = []
    for one, away in far.items():
        if "test_" in one and not any(word in one for word in NO_JUDGES):
            text = (ROOT / one).read_text(encoding="utf-8")
            said = 2 * (function in text if function else False) + (Path(path).stem.lstrip("_") in text)
            found.append((away, -said, one))
    return [one for *_, one in sorted(found)]


class Told:
    """Plug-in of pytest: what fails first, and an end where the time is over."""

    def __init__(self, pipe: int, limit_s: float) -> None:
        self.pipe, self.limit_s = pipe, limit_s

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.pytest_collectreport(report)
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        if sum(one.ru_utime + one.ru_stime for one in used) > self.limit_s:
            os._exit(LATE)

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            os.write(self.pipe, f"{report.nodeid}\n".encode())


def tested(root: Path, tests: list[str], limit_s: float, *more: str) -> tuple[str, float]:
    """Run tests in a copy until one fails or the time is over; return what failed, or "", and the processor time."""
    reads, writes = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.setsid()
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        os.chdir(root)
        # A virtual environment may stand in the tree.
        sys.path[:] = [one for one in sys.path if sys.prefix in one or ROOT not in (Path(one), *Path(one).parents)]
        os.environ["PYTHONPATH"] = os.pathsep.join((str(root), str(root / "hardware")))
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s), math.ceil(limit_s) + 1))
        options = [*OPTIONS, f"--basetemp={root.parent / 'pytest'}", *more]
        os._exit(sys.modules["pytest"].main([*options, *tests], plugins=[Told(writes, limit_s)]))
    os.close(writes)
    hangs = time.monotonic() + 6 * limit_s + 60  # others work on the machine too
    ended, status, usage = os.wait4(pid, os.WNOHANG)
    while not ended and time.monotonic() < hangs:
        time.sleep(0.02)
        ended, status, usage = os.wait4(pid, os.WNOHANG)
    if not ended:
        os.killpg(pid, signal.SIGKILL)
        _, status, usage = os.wait4(pid, 0)
    cpu_s, code = usage.ru_utime + usage.ru_stime, os.waitstatus_to_exitcode(status)
    if code in (LATE, -signal.SIGXCPU, -signal.SIGKILL):
        os.close(reads)
        return "", max(cpu_s, limit_s)
    with os.fdopen(reads, "rb") as pipe:
        said = pipe.read().decode().splitlines()
    if code > 0 and code != NO_TESTS and not said:
        raise RuntimeError(f"pytest did not run {tests}: exit code {code}")
    return said[0] if said else f"signal {-code}" if code < 0 else "", cpu_s


def tried(mutant: Mutant, limit_s: float) -> tuple[Mutant, str, float]:
    """Make one change, run its tests, undo it; return what noticed it, or "". What fails without it does not count."""
    root, path, files = OWN["root"], OWN["root"] / mutant.path, [*mutant.tests] or judges(mutant.path, mutant.function)
    whole, spent = path.read_bytes(), 0.0
    for mark, (first, last) in product(MARKS, pairwise(STEPS)):
        by = "some" if files[first:last] else ""
        while by and spent < limit_s:
            path.write_bytes(whole[: mutant.start] + mutant.new + whole[mutant.end :])
            out = [f"--deselect={test}" for test, held in SOUND.items() if not held]
            by, cpu_s = tested(root, files[first:last], limit_s - spent, "-m", mark, *out)
            path.write_bytes(whole)
            spent += cpu_s
            if by and by not in SOUND:
                SOUND[by] = by.startswith("signal") or not tested(root, [by], 4 * limit_s, "-m", mark)[0]
            if by and SOUND[by]:
                return mutant, by, spent
    return mutant, "", spent


def prepare(folder: str) -> None:
    """Make a copy of the tree for this process."""
    root = OWN["root"] = Path(tempfile.mkdtemp(dir=folder)) / "tree"
    shutil.copytree(ROOT, root, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    # Two changes of the same length within a second have the same size and time: byte code must not go by those.
    hashed = ["-m", "compileall", "-q", "--invalidation-mode", "checked-hash", "avc_casadi", "hardware"]
    subprocess.run([sys.executable, *hashed], cwd=root, check=True)  # noqa: S603 - ours


def run(mutants: list[Mutant], workers: int, limit_s: float) -> Iterator[tuple[Mutant, str, float]]:
    """Try mutants on so many processes."""
    for name in LOADED:
        importlib.import_module(name)
    graph()
    forked = multiprocessing.get_context("fork")  # what is loaded need not be loaded again
    at = tempfile.TemporaryDirectory(prefix="avc-mutate-")
    with at as folder, ProcessPoolExecutor(workers, forked, prepare, (folder,)) as crew:
        yield from crew.map(tried, mutants, repeat(limit_s))


def faults(counts: dict[str, list[int]], goal: float) -> Iterator[str]:
    """Say where fewer are killed than the goal beyond chance, 5 % for all rooms: of a few mutants nobody can tell."""
    pairs = {**counts, "all rooms": [sum(column) for column in zip(*counts.values(), strict=True)]}
    for name, (killed, count) in pairs.items():
        print(f"{name}: {killed} of {count} killed")
        if count and binomtest(killed, count, goal, "less").pvalue < BY_CHANCE / len(pairs):
            yield f"{name}: {killed} of {count} killed, fewer than {goal:.0%}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int, default=60, help="mutants in all, as many of each room; default 60")
    parser.add_argument("--rooms", nargs="+", choices=rooms(), default=[*rooms()], metavar="ROOM", help="default all")
    parser.add_argument("--seed", default="0", help="text that draws them; default 0")
    parser.add_argument("--workers", type=int, default=2, help="processes; default 2")
    parser.add_argument("--limit", type=float, default=LIMIT_S, help=f"s of processor time each; default {LIMIT_S}")
    parser.add_argument("--goal", type=float, default=0.0, help="share below which the run ends with 1; default none")
    asked = parser.parse_args()
    mutants = list(drawn(asked.rooms, math.ceil(asked.sample / len(asked.rooms)), asked.seed))[: asked.sample]
    counts = {room: [0, 0] for room in asked.rooms}
    for mutant, by, cpu_s in run(mutants, asked.workers, asked.limit):
        killed, count = counts[mutant.room]
        counts[mutant.room] = [killed + bool(by), count + 1]
        print(f"{'killed' if by else 'SURVIVED'} {cpu_s:.0f} s {mutant.told()} {by}", flush=True)
    said = list(faults(counts, asked.goal))
    print(*said, sep="\n", end="\n" if said else "")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
