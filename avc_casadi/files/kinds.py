"""Which kind a file is: one in place of another is named, with the command that accepts it, and not written over."""

from __future__ import annotations

import re
from enum import Enum

from avc_casadi._errors import InputError

_HEADER_OF_GAINS = "frequency_hz,"
_COUPLING_SCHEMA = '"avc-coupling/'
_SOLUTION_SCHEMA = '"avc-gains/'
_COMMENTS = re.compile(r"\A(?:[ \t]*#.*\n)+")
_SVG = re.compile(r"\A<[^\0]{0,1000}<svg|\A<svg")
# A table begins with a line of two or more columns; a line of TOML has an equals sign, or is a header in brackets.
_COLUMNS = re.compile(r"[^=\[{#\n]+[,;\t][^=\n]+(?:\n|$)")
_STATEMENT = re.compile(r"^[ \t]*(?:\[\[?[\w.-]+\]\]?|[\w.-]+[ \t]*=)", re.MULTILINE)
_LAW = re.compile(r"^[ \t]*\[+law[\].]", re.MULTILINE)


class FileKind(Enum):
    """Kinds of files that commands accept, as a reader calls them."""

    PROBLEM = "a problem file (TOML)"
    DEVICE = "a device file (TOML)"
    COUPLING = "a coupling or gain file"
    SOLUTION = "gains of avc solve without a coupling (JSON)"
    LOG = "a table of numbers, such as a log"
    JSON = "JSON, but no coupling"
    PICTURE = "a picture"
    ARRAYS = "a file of arrays (npz)"
    OTHER = "neither TOML nor JSON nor a table"


_SIGNATURES = {b"\x89PNG": FileKind.PICTURE, b"%PDF": FileKind.PICTURE, b"PK": FileKind.ARRAYS}
"""First bytes of files that are no text."""


def kind_of(text: str) -> FileKind:
    """Return the kind of a file from its text; a device file is a problem file here."""
    content = text.lstrip()
    if content.startswith("{"):
        if _COUPLING_SCHEMA in content:
            return FileKind.COUPLING
        return FileKind.SOLUTION if _SOLUTION_SCHEMA in content else FileKind.JSON
    if _SVG.match(content):
        return FileKind.PICTURE
    if content.startswith(_HEADER_OF_GAINS):
        return FileKind.COUPLING
    if _STATEMENT.search(content):
        return FileKind.PROBLEM
    return FileKind.LOG if _COLUMNS.match(_COMMENTS.sub("", content)) else FileKind.OTHER


def kind_of_bytes(content: bytes) -> FileKind:
    """Return the kind of a file from its content or the beginning of it, which may be no text."""
    for signature, kind in _SIGNATURES.items():
        if content.startswith(signature):
            return kind
    return FileKind.OTHER if b"\0" in content else kind_of(content.decode("utf-8-sig", errors="replace"))


def require_problem_text(text: str, file: str) -> None:
    """Refuse the text of a coupling, a log or other JSON in place of that of a problem.

    Raises:
        InputError: it is one of these.
    """
    uses = {
        FileKind.COUPLING: "Use it with avc certify or avc export",
        FileKind.LOG: f"A log is for avc diagnose {file} or avc identify",
        **dict.fromkeys(
            (FileKind.JSON, FileKind.SOLUTION), "avc list shows the built-in problems, and avc new P.toml writes a file"
        ),
    }
    kind = kind_of(text)
    if kind in uses:
        raise InputError.of(f"is {kind.value}; allowed: {FileKind.PROBLEM.value}. {uses[kind]}", file=file)


def require_coupling_text(text: str, file: str) -> None:
    """Refuse the text of a problem in place of that of a coupling.

    Raises:
        InputError: it is a problem.
    """
    if kind_of(text) is not FileKind.PROBLEM:
        return
    own_law = f"; for its [law] export C: avc export {file} --c DIR" if _LAW.search(text) else ""
    make = f"make one: avc recommend {file} --out coupling.json"
    raise InputError.of(f"is {FileKind.PROBLEM.value}; allowed: a coupling file (JSON); {make}{own_law}", file=file)
