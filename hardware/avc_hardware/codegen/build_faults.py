"""Errors of compiler and linker on a custom board, by the keys of its manifest."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from avc_casadi import Fault
from avc_hardware.codegen.boards import MANIFEST, Target

_GUIDE = "hardware/PORTING.md"
_ROOM = (
    "a table takes 80 bytes a row, an excitation 6 a record, the stack 2048: give more memory, or less "
    "capacity.rows and capacity.records"
)
# Sources of the package itself.
_OURS = {"main", "memcpy", "memset", "hal_limits", "avc_on_tick", "avc_on_byte", "avc_on_byte_lost"}


def build_faults(said: str, board: Target) -> list[Fault]:
    """Return the faults of a board that can be attributed.

    Args:
        said: standard error of the compiler, in the C locale.
        board: of a folder of its own.

    Returns:
        A fault for each key of the manifest, symbol or line of a source; empty where none is attributed.
    """
    root = board.root or Path()
    manifest = str(root / MANIFEST)
    found: dict[Fault, None] = {}
    for line in said.splitlines():
        for pattern, told in _PATTERNS:
            if match := re.search(pattern, line):
                key, message = told(match, board)
                found[Fault(manifest, None, key, message)] = None
                break
        else:
            found |= dict.fromkeys(_of_source(line, root))
    return list(found)


def _of_source(line: str, root: Path) -> Iterator[Fault]:
    """Yield the fault of a line that names a file of the folder."""
    if match := re.match(r"(.+?):(\d+):(?:\d+:)? (?:fatal )?error: (.*)", line):
        file = Path(match[1])
        if file.is_relative_to(root):
            yield Fault(str(file), int(match[2]), "", match[3])


def _lacking(match: re.Match[str], board: Target) -> tuple[str, str]:
    name = match[1]
    among = ", ".join(board.sources)
    if name.startswith("hal_") or name == "serial_handler":
        return "sources", f"{among}: no {name}(), which every board has; write it: {_GUIDE}"
    return (
        "sources",
        f"{among}: nothing defines {name}; add the file, the library (-l... in flags) or the symbol's script",
    )


def _twice(match: re.Match[str], _: Target) -> tuple[str, str]:
    name, first = match[1], Path(match[2]).name
    who = "the package has it" if name in _OURS else f"the first one is in {first}"
    return "sources", f"{name} is defined twice, {who}; leave one out"


def _region(match: re.Match[str], _: Target) -> tuple[str, str]:
    name, most = match[1], match[2]
    message = f"region {name} overflows by {most} bytes"
    if any(word in name.lower() for word in ("ram", "mem", "data")):
        return "memory.bytes", f"{message}; {_ROOM}"
    return "flash.bytes", f"{message}; compile for size (-Os in flags), or give more"


def _said(key: str, then: str) -> Callable[[re.Match[str], Target], tuple[str, str]]:
    return lambda match, _: (key, f"{match[1]}; {then}")


def _flash(_: re.Match[str], board: Target) -> tuple[str, str]:
    return (
        "flash.bytes",
        f"{board.flash[1]} is too little for this program; compile for size (-Os in flags), or give more",
    )


def _memory(_: re.Match[str], board: Target) -> tuple[str, str]:
    return "memory.bytes", f"{board.ram[1]} is too little; {_ROOM}"


_PATTERNS: tuple[tuple[str, Callable[[re.Match[str], Target], tuple[str, str]]], ...] = (
    (r"undefined reference to [`'](\w+)'", _lacking),
    (r"multiple definition of [`'](\w+)'; (?:.*:)?([^:\s]+):\(.*first defined here", _twice),
    (r"region [`'](\w+)' overflowed by (\d+) bytes", _region),
    (r"ld: flash is full", _flash),
    (r"ld: less than 2 KiB of stack", _memory),
    (r"fatal error: (board\.h: No such file or directory)", _said("sources", f"write it beside them: {_GUIDE}")),
    (
        r"error: '(BOARD_\w+)' undeclared",
        lambda match, _: ("sources", f"board.h does not define {match[1]}; {_GUIDE} says what it is"),
    ),
    (r"^[\w.-]*(?:gcc|g\+\+|cc)[\w.-]*: (?:fatal )?error: (.*)", _said("flags", "see what the compiler takes")),
    (
        r"ld: (?:error: )?(?:.*/)?(\S+ (?:uses VFP register arguments|uses .*-bit enums|has EABI version).*)",
        _said("flags", "all sources are to have the same processor and float-abi"),
    ),
    (r"ld: cannot find (-l[\w.+-]+)", _said("flags", "install that library, or leave it out")),
    (r"ld:\s*\S*?([\w.-]+:\d+: (?:syntax error|.*undefined symbol).*)", _said("linker_script", "mend it there")),
    (
        r"(?:symbol [`']|undefined symbol [`'])(\w+)' (?:not defined|referenced in expression)",
        _said("linker_script", "it is defined nowhere"),
    ),
)
