"""Files of every kind that is read, spoiled at random: none ends in anything but an answer or a message.

python tests/benchmarks/fuzzed_files.py --count 10000 --write

Valid files of the catalogue, of couplings, gains, logs, studies and boards are mutated in their bytes, lines,
numbers and values, or made by a grammar of their own words. Each is read in a process of its own crew, with its
memory bounded; told are what was neither read nor refused, the longest message, the most processor time and memory.
With --write it overwrites fuzzed_files.json and RESULTS_fuzzed_files.md; without it the results are printed only.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import multiprocessing
import os
import random
import re
import resource
import shutil
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from studied import about, made_by, write_rows

import avc_casadi as avc
from avc_casadi._util.checkpoint import Chunked
from avc_casadi.files.coupling_file import coupling_document, read_file
from avc_casadi.files.other_end_coupling_file import (
    other_end_document,
    read_teleoperator_coupling,
    read_tool_coupling,
)
from avc_casadi.identification.read import read_columns, read_logs
from avc_casadi.model.lifted_loop import ToolGains
from avc_casadi.other_end_coupling import TeleoperatorCoupling, ToolCoupling
from avc_hardware.codegen.boards import read_board

HERE = Path(__file__).parent
OUT = HERE / "results" / "fuzzed_files.json"
PAGE = HERE / "RESULTS_fuzzed_files.md"
_BOARDS = HERE.parent / "boards"
PROBLEMS = HERE.parents[1] / "problems"
SEED = 29
MOST_CHARACTERS, MOST_S, MOST_MB = 2000, 2.0, 200.0
_HANGS_S = 60.0
HEAD = """# Files that nobody meant

{made_by}

Every file that is read is a regular one of a stated size, and whatever it holds ends in an answer or in a message.
{files} files, of the seed, by mutation of valid ones (bytes, lines, numbers, values of JSON) and by
grammar: {bad} ended in anything else, in a message above {characters} characters, above {seconds:g} s of processor time
or above {megabytes:g} MB.

| kind | files | read | refused | other | longest message | slowest, s | most memory, MB |
|---|--:|--:|--:|--:|--:|--:|--:|
"""


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        ending: of its name.
        valid: valid ones.
        read: reads one, and writes again what it made of it.
    """

    ending: str
    valid: Callable[[], list[bytes]]
    read: Callable[[Path], object]


def _log_columns(rows: int = 400) -> dict[str, np.ndarray[Any, Any]]:
    time_s = 1e-3 * np.arange(rows)
    return {
        "time_s": time_s,
        "position_m": 0.01 * np.sin(40 * time_s) + 0.002 * np.sin(170 * time_s),
        "force_n": np.cos(40 * time_s) + 0.5 * np.cos(170 * time_s),
    }


def _csv_log() -> list[bytes]:
    columns = _log_columns()
    rows = [
        ",".join(columns),
        *(",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    grouped = ["record," + rows[0], *(f"{at // 200}," + row for at, row in enumerate(rows[1:]))]
    return ["\n".join(text).encode() + b"\n" for text in (rows, grouped, ["# " + rows[0], *rows[1:]])]


def _npz_log() -> list[bytes]:
    found = []
    for save in (np.savez, np.savez_compressed):
        content = io.BytesIO()
        save(content, **_log_columns())
        found.append(content.getvalue())
    return found


def _mat_log() -> list[bytes]:
    found = []
    for compressed in (False, True):
        content: Any = io.BytesIO()
        scipy.io.savemat(content, _log_columns(), do_compression=compressed)
        found.append(content.getvalue())
    return found


def _json_log() -> list[bytes]:
    columns = {name: values.tolist() for name, values in _log_columns(250).items()}
    return [
        json.dumps(columns).encode(),
        json.dumps([dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]).encode(),
    ]


def _couplings() -> list[bytes]:
    return [path.read_bytes() for path in sorted((HERE.parent / "goldens" / "couplings").glob("*.json"))]


def _other_ends() -> list[bytes]:
    tool = avc.load_problem("tool/mujoco-500hz")
    follower = avc.load_problem("soft").changed(follower={"mass_kg": 0.2, "damping_ns_per_m": 1.0})
    gains, judged = ToolGains(500.0, 2.0, 0.5), {"levels": [{"name": "L0", "passed": True}], "margin": 0.1}
    made = (ToolCoupling(tool, gains, judged), TeleoperatorCoupling(follower, gains, judged))
    return [_json(other_end_document(one)).encode() for one in made]


def _gains() -> list[bytes]:
    rows = [f"{10 * row + 1},{1.5 + row},{100.0 * row}" for row in range(30)]
    damped = [f"{row},{0.5 * at}" for at, row in enumerate(rows)]
    header = "frequency_hz,damping_ns_per_m,stiffness_n_per_m"
    return ["\n".join(one).encode() for one in ([header, *rows], [f"{header},contact_damping_ns_per_m", *damped])]


def _double(task: int) -> int:
    return 2 * task


_STUDY = Chunked({"study": "doubles"}, _double, [1, 2, 3], list)


@cache
def _study_files() -> tuple[tuple[str, bytes], ...]:
    with tempfile.TemporaryDirectory() as folder:
        _STUDY.run(folder=folder)
        return tuple((path.name, path.read_bytes()) for path in sorted(Path(folder).iterdir()))


def _merged(path: Path) -> object:
    """Read a folder of results of which one file is spoiled, each in turn."""
    failed: avc.InputError | None = None
    for name, _ in _study_files():
        folder = path.parent / "study"
        folder.mkdir(exist_ok=True)
        for other, content in _study_files():
            (folder / other).write_bytes(path.read_bytes() if other == name else content)
        try:
            _STUDY.merged(folder)
        except avc.InputError as error:
            failed = error
    if failed is not None:
        raise failed
    return path


def _board(path: Path) -> object:
    folder = path.parent / "board"
    shutil.copytree(_BOARDS / "riscv32", folder)
    (folder / "board.toml").write_bytes(path.read_bytes())
    return read_board(folder)


def _log(path: Path) -> object:
    failed: avc.InputError | None = None
    for read in (lambda: read_logs([path]), lambda: read_columns(path)):
        try:
            read()
        except avc.InputError as error:
            failed = error
    if failed is not None:
        raise failed
    return path


def _written_again(path: Path) -> object:
    found = read_file(path)
    return _json(coupling_document(found)) if isinstance(found, avc.Coupling) else found.counts()


def _either_end(path: Path) -> object:
    try:
        return _json(other_end_document(read_tool_coupling(path)))
    except avc.InputError:
        return _json(other_end_document(read_teleoperator_coupling(path)))


def _json(document: object) -> str:
    return json.dumps(document, allow_nan=False)


def _texts(pattern: str) -> Callable[[], list[bytes]]:
    return lambda: [path.read_bytes() for path in sorted(PROBLEMS.glob(pattern))]


KINDS: Mapping[str, Kind] = {
    "problem": Kind(".toml", _texts("[!ad]*/*.toml"), lambda path: avc.dump_problem(avc.load_problem(path))),
    "device": Kind(".toml", _texts("devices/*.toml"), avc.load_device),
    "coupling": Kind(".json", _couplings, _written_again),
    "coupling to another end": Kind(".json", _other_ends, _either_end),
    "gains": Kind(".csv", _gains, _written_again),
    "log, CSV": Kind(".csv", _csv_log, _log),
    "log, JSON": Kind(".json", _json_log, _log),
    "log, NPZ": Kind(".npz", _npz_log, _log),
    "log, MAT": Kind(".mat", _mat_log, _log),
    "folder of results": Kind(".json", lambda: [content for _, content in _study_files()], _merged),
    "board": Kind(".toml", lambda: [(_BOARDS / "riscv32" / "board.toml").read_bytes()], _board),
}

_SPECIAL = """0 -0.0 1 -1 nan -nan inf -inf Infinity NaN 1e308 -1e308 1e-308 5e-324 1e400 1e22 1e-12 0.05 1_0 0x10
0b1 1e 1e+ "1" --1 1,5 null true false [] {} [[]] "" 99999999999999999999 0.5 2 3 255 65536 4294967296 1e5 1e6 1e9"""
_NUMBERS = tuple(_SPECIAL.split())
_LONG = ("1" * 5000, "9" * 400, "a" * 3000, "[" * 3000, "{" * 3000, "a." * 500, '"' * 50, '{"a":' * 2000, "<a>" * 2000)
_ODD = (
    "\0",
    "\ufeff",
    "\u2028",
    "\ud7ff",
    "\x1b[2J",
    "*/",
    "'; rm",
    "%n",
    "\r",
    "\r\n",
    "\t",
    ";",
    ",",
    "#",
    "\\",
    "\\u0000",
)
_BYTES = (b"\xff\xfe", b"\x80", b"\xed\xa0\x80", b"\x00" * 8, b"\xff" * 8, b"\x7f\xff\xff\xff", b"PK\x03\x04")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def _spoiled_bytes(draw: random.Random, data: bytes) -> bytes:
    at = draw.randrange(len(data) + 1)
    to = min(len(data), at + draw.choice((1, 2, 4, 8, 100, 3000)))
    piece = draw.choice(
        (
            b"",
            draw.randbytes(draw.choice((1, 4, 64))),
            draw.choice(_BYTES),
            draw.choice((*_ODD, *_LONG)).encode("utf-8", "surrogatepass"),
            data[at:to] * draw.choice((2, 50)),
        )
    )
    return data[:at] if draw.random() < 0.15 else data[:at] + piece + data[draw.choice((at, to)) :]


def _spoiled_lines(draw: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    at, other = draw.randrange(len(lines)), draw.randrange(len(lines))
    return b"\n".join(
        draw.choice(
            (
                lines[:at] + lines[at + 1 :],
                lines[:at] + [lines[at]] * draw.choice((2, 300)) + lines[at + 1 :],
                [*lines[:at], lines[other], *lines[at + 1 :]],
                lines[: at + 1],
                lines[::-1],
            )
        )
    )


def _spoiled_numbers(draw: random.Random, data: bytes) -> bytes:
    places = list(_NUMBER.finditer(data))
    if not places:
        return _spoiled_bytes(draw, data)
    if draw.random() < 0.1:  # every one of them
        word = draw.choice(_NUMBERS).encode()
        return _NUMBER.sub(word, data)
    found = draw.choice(places)
    return data[: found.start()] + draw.choice(_NUMBERS).encode() + data[found.end() :]


def _spoiled_values(draw: random.Random, data: bytes) -> bytes:
    """Put another value into a document of JSON, or take one out."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return _spoiled_numbers(draw, data)
    places = list(_places(document))
    if not places:
        return data
    holder, key = draw.choice(places)
    odd = (None, True, -1, 0, 1e308, float("nan"), float("inf"), 10**30, "", "x", "\ud800", [], {}, [[]], {"": None})
    if draw.random() < 0.15:
        del holder[key]
    else:
        holder[key] = draw.choice((*odd, draw.choice(places)[0], [1.0] * 300, "y" * 5000))
    with contextlib.suppress(ValueError, RecursionError):  # a value that holds itself
        return json.dumps(document).encode()
    return data


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    inner = list(value.items()) if isinstance(value, dict) else list(enumerate(value))[:40]
    for key, one in inner:
        yield value, key
        if isinstance(one, dict | list):
            yield from _places(one)


def _grammar(draw: random.Random, kind: str, data: bytes) -> bytes:
    """Make a file of the words of a valid one."""
    if kind == "log, NPZ":
        return _made_npz(draw)
    if kind == "log, MAT":
        return _made_mat(draw)
    words = re.findall(rb"[A-Za-z_]\w*|[\[\]{}=,:\n\"]|-?\d[\d.e+-]*", data) or [b"x"]
    if KINDS[kind].ending == ".csv":
        names = [
            b"time_s",
            b"t_ms",
            b"position_m",
            b"angle_rad",
            b"force_n",
            b"torque_nm",
            b"record",
        ]
        width = draw.randrange(1, 6)
        header = draw.choice((b",".join(draw.choices(names, k=width)), data.split(b"\n")[0]))
        cells = [[draw.choice(_NUMBERS).encode() for _ in range(width)] for _ in range(draw.choice((0, 1, 5, 300)))]
        return b"\n".join([header, *(b",".join(row) for row in cells)])
    if KINDS[kind].ending == ".toml":
        keys = re.findall(rb"^\s*(\[+[\w.]+\]+|[\w.]+)", data, re.MULTILINE) or [b"device"]
        lines = []
        for _ in range(draw.randrange(1, 30)):
            key = draw.choice(keys)
            value = draw.choice(_NUMBERS).encode()
            pair = b"[" + value + b", " + draw.choice(_NUMBERS).encode() + b"]"
            lines.append(key if key.startswith(b"[") else key + b" = " + draw.choice((value, pair, b'"figure5"')))
        return b"\n".join(lines)
    return b" ".join(draw.choices(words, k=draw.randrange(1, 200)))


def _made_npz(draw: random.Random) -> bytes:
    content = io.BytesIO()
    kinds = ("f8", "f4", "f2", "i8", "u1", "c16", "M8[s]", "U3", "S3", "?", "O", ">f8", [("a", "f8")])
    with zipfile.ZipFile(content, "w", draw.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name in draw.sample(("time_s", "position_m", "force_n", "x", "", "../a", "record"), draw.randrange(5)):
            member = io.BytesIO()
            shape = draw.choice(((400,), (400, 1), (400, 3), (0,), (), (2, 3, 4), (1, 400)))
            values = draw.choice((np.zeros, np.ones))(shape, dtype=draw.choice(kinds))
            np.lib.format.write_array(member, values, allow_pickle=True)
            data = member.getvalue()
            if draw.random() < 0.4:
                claim = draw.choice((b"(1000000000000,)", b"(-1,)", b"(10**9,)", b"(400, 999999)", b"'x'", b"(True,)"))
                data = data.replace(str(shape).encode(), claim, 1)
            archive.writestr(name + draw.choice((".npy", ".npy", ".npy", ".txt")), data)
    return content.getvalue()


def _made_mat(draw: random.Random) -> bytes:
    content: Any = io.BytesIO()
    odd = (np.zeros(400), np.arange(400.0), np.zeros((400, 3)), np.zeros(0), 1.0, "text", {"a": 1}, np.ones(400, "c16"))
    names = ("time_s", "position_m", "force_n", "x", "record")
    held = {name: draw.choice(odd) for name in draw.sample(names, draw.randrange(1, 5))}
    held["cells"] = np.array([1, "a", None], dtype=object) if draw.random() < 0.3 else np.arange(400)
    with contextlib.suppress(TypeError):  # a None, which MATLAB has not
        scipy.io.savemat(content, held, do_compression=draw.random() < 0.5, format=draw.choice("45"))
    data: bytes = content.getvalue()
    return _spoiled_bytes(draw, data) if draw.random() < 0.7 else data


@cache
def _valid(kind: str) -> tuple[bytes, ...]:
    return tuple(KINDS[kind].valid())


def spoiled(index: int) -> tuple[str, bytes]:
    """Return the kind and the content of a file: the same for an index, whatever the count."""
    draw = random.Random(f"{SEED} {index}")  # noqa: S311 - no secret
    kind = list(KINDS)[index % len(KINDS)]
    data = draw.choice(_valid(kind))
    if draw.random() < 0.25:
        return kind, _grammar(draw, kind, data)
    ways = [_spoiled_bytes, _spoiled_lines, _spoiled_numbers]
    if KINDS[kind].ending == ".json":
        ways += [_spoiled_values] * 3
    for _ in range(draw.choice((1, 1, 2, 5))):
        data = draw.choice(ways)(draw, data)[: 2**21]
    return kind, data


def tried(kind: str, data: bytes, folder: Path) -> tuple[str, str]:
    """Read a file.

    Returns:
        read, refused or the name of what it ended in; and what was said.
    """
    folder.mkdir(exist_ok=True)
    path = folder / f"a{KINDS[kind].ending}"
    path.write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            KINDS[kind].read(path)
    except avc.AvcError as error:
        said = str(error)
        if isinstance(error, avc.InputError):
            said = max(said, "\n".join(one["message"] or "" for one in avc.fault_document(error)["errors"]), key=len)  # type: ignore[arg-type, misc]
        return "refused", said
    except Exception as error:  # noqa: BLE001 - what is looked for
        trace = error.__traceback__
        while trace is not None and trace.tb_next is not None:
            trace = trace.tb_next
        place = "" if trace is None else f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"
        return type(error).__name__, f"{place}: {error}"[:300]
    return "read", ""


def _peak_mb() -> float:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    found = re.search(r"VmHWM:\s*(\d+)", status)
    return int(found[1]) / 1024 if found else 0.0


def _crew(pipe: Connection) -> None:
    """Read files as they are asked for; tell of each how it ended, what was said, seconds and megabytes."""
    for kind in KINDS:  # what is loaded and drawn once
        with tempfile.TemporaryDirectory() as folder:
            tried(kind, _valid(kind)[0], Path(folder))
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * resource.getpagesize() + 2**30
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    while (index := pipe.recv()) >= 0:
        kind, data = spoiled(index)
        with tempfile.TemporaryDirectory() as folder:
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
            before, began = _peak_mb(), time.process_time()
            ended, said = tried(kind, data, Path(folder))
            seconds, megabytes = time.process_time() - began, _peak_mb() - before
        pipe.send({"file": index, "kind": kind, "ended": ended, "said": said, "s": seconds, "mb": megabytes})


def campaign(count: int, workers: int) -> list[dict[str, Any]]:
    """Read files in processes of their own; one that hangs or dies is told, and the others go on."""
    context = multiprocessing.get_context("fork")
    left, found = list(range(count))[::-1], []
    crews: dict[Connection, tuple[Any, int, float]] = {}

    def begin() -> None:
        ours, theirs = context.Pipe()
        process = context.Process(target=_crew, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        hand(ours, process)

    def hand(pipe: Connection, process: Any) -> None:
        index = left.pop() if left else -1
        pipe.send(index)
        if index >= 0:
            crews[pipe] = (process, index, time.monotonic())

    for _ in range(workers):
        begin()
    while crews:
        ready = wait(list(crews), timeout=5.0)
        for pipe, (process, index, began) in list(crews.items()):
            if pipe not in ready and time.monotonic() - began < _HANGS_S:
                continue
            del crews[pipe]
            try:
                found.append(pipe.recv() if pipe in ready else _ended(index, "hangs"))
                hand(pipe, process)
            except (EOFError, OSError):
                found.append(_ended(index, f"died of {process.exitcode}"))
            if pipe not in crews and left:
                begin()
            if found[-1]["ended"] == "hangs":
                process.kill()
    return sorted(found, key=lambda one: int(one["file"]))


def _ended(index: int, how: str) -> dict[str, Any]:
    return {"file": index, "kind": spoiled(index)[0], "ended": how, "said": "", "s": 0.0, "mb": 0.0}


def bad(one: Mapping[str, Any]) -> bool:
    """Whether a file ended in anything but an answer or a short message, late, or in much memory."""
    beyond = len(one["said"]) > MOST_CHARACTERS or one["s"] > MOST_S or one["mb"] > MOST_MB
    return beyond or one["ended"] not in ("read", "refused")


def rows_of(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for each kind."""
    rows = []
    for kind in KINDS:
        own = [one for one in found if one["kind"] == kind]
        ends = [one["ended"] for one in own]
        rows.append(
            {
                "kind": kind,
                "files": len(own),
                "read": ends.count("read"),
                "refused": ends.count("refused"),
                "bad": sum(map(bad, own)),
                "longest": max((len(one["said"]) for one in own if one["ended"] == "refused"), default=0),
                "slowest_s": round(max((one["s"] for one in own), default=0.0), 2),
                "most_mb": round(max((one["mb"] for one in own), default=0.0), 1),
            }
        )
    return rows


def page(about_it: Mapping[str, Any], rows: list[dict[str, Any]]) -> str:
    """Return the page of the results."""
    head = HEAD.format(
        made_by=made_by(about_it),
        files=sum(row["files"] for row in rows),
        bad=sum(row["bad"] for row in rows),
        characters=MOST_CHARACTERS,
        seconds=MOST_S,
        megabytes=MOST_MB,
    )
    return head + "".join(f"| {' | '.join(str(value) for value in row.values())} |\n" for row in rows)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="files; default 10000")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes; default: one a core")
    parser.add_argument("--write", action="store_true", help="overwrites fuzzed_files.json and its page too")
    args = parser.parse_args()
    found = campaign(args.count, args.workers)
    for one in filter(bad, found):
        print({**one, "said": one["said"][:300]})
    rows = rows_of(found)
    about_it = about(f"python tests/benchmarks/fuzzed_files.py --count {args.count} --write", SEED)
    if args.write:
        write_rows(OUT, about_it, rows)
        PAGE.write_text(page(about_it, rows), encoding="utf-8")
    print(page(about_it, rows))


if __name__ == "__main__":
    main()
