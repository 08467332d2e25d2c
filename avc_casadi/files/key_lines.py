"""Line numbers of the keys of a TOML text, which the parser of the standard library does not give."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from avc_casadi.model.table import Path

# Strings and comments first, so that brackets and line feeds inside them are skipped. Possessive quantifiers keep the
# time linear.
_TOKEN = re.compile(
    r'''"""(?:[^"\\]|\\.|"{1,2}(?!"))*+"{3,5}'''
    r"""|'''(?:[^']|'{1,2}(?!'))*+'{3,5}"""
    r"""|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+'"""
    r"""|\#[^\n]*+|(?P<open>[\[{])|(?P<close>[\]}])|(?P<feed>\n)""",
    re.DOTALL,
)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield each statement of a valid TOML text with the line at which it begins."""
    depth, begin, line, begin_line = 0, 0, 1, 1
    for token in _TOKEN.finditer(text):
        depth += (token["open"] is not None) - (token["close"] is not None)
        line += token[0].count("\n")
        if token["feed"] and depth == 0:
            yield begin_line, text[begin : token.end()].strip()
            begin, begin_line = token.end(), line
    yield begin_line, text[begin:].strip()


class KeyLines:
    """The line of every key of a valid TOML text."""

    def __init__(self, text: str) -> None:
        self._lines: dict[Path, int] = {}
        self._last: dict[Path, int] = {}
        table: Path = ()
        for line, statement in _statements(text):
            parsed = tomllib.loads(statement)
            if statement.startswith("["):
                table = self._header(parsed)
                self._lines.setdefault(table, line)
            else:
                self._record(table, parsed, line)

    def _header(self, parsed: Mapping[str, Any]) -> Path:
        """Return the path of [a.b] or [[a.b]], with the indices of the tables that it lies in."""
        path: Path = ()
        node: Any = parsed
        while node:
            ((key, node),) = node.items()
            path = (*path, key)
            if isinstance(node, list):
                self._last[path] = self._last.get(path, -1) + 1
                node = node[0]
            if path in self._last:
                path = (*path, self._last[path])
        return path

    def _record(self, path: Path, value: Any, line: int) -> None:
        self._lines.setdefault(path, line)
        inner: Any = ()
        if isinstance(value, Mapping):
            inner = value.items()
        elif isinstance(value, list):
            inner = ((index, item) for index, item in enumerate(value) if isinstance(item, Mapping))
        for key, item in inner:
            self._record((*path, key), item, line)

    def __getitem__(self, path: Path) -> int | None:
        """Return the line of a key, or of the table that lacks it; None where there is neither."""
        for length in range(len(path), 0, -1):
            if path[:length] in self._lines:
                return self._lines[path[:length]]
        return None
