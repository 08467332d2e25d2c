"""Blocks of pages that are written by code: `<!-- results: NAME -->` or `<!-- keys: NAME -->` up to `<!-- end -->`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from documented_keys import key_tables
from documented_results import BLOCKS
from studied import table

from avc_casadi.claims.registry import CLAIMS

ROOT = Path(__file__).parents[2]
_BLOCK = re.compile(r"(<!-- (results|keys): ([\w-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
_ROOMS = ("avc_casadi", "hardware", "joss", "problems", "tests/benchmarks")


def levels_table() -> str:
    """The levels of a certificate, as their registry says."""
    rows = [(name, claim.claims, claim.leaves) for name, claim in CLAIMS.items()]
    return table(("level", "claim, if it passes", "what it does not say"), rows)


WRITERS: Mapping[tuple[str, str], Callable[[], str]] = {
    ("keys", "problem"): key_tables,
    ("keys", "levels"): levels_table,
    **{("results", name): block.text for name, block in BLOCKS.items()},
}


def pages() -> dict[Path, list[tuple[str, str]]]:
    """The pages that hold blocks, with their names."""
    found = {}
    for path in sorted({*ROOT.glob("*.md")} | {page for room in _ROOMS for page in (ROOT / room).rglob("*.md")}):
        names = [(kind, name) for _, kind, name, *_ in _BLOCK.findall(path.read_text(encoding="utf-8"))]
        if names:
            found[path] = names
    return found


def written(path: Path) -> str:
    """The page as it should stand."""

    def block(found: re.Match[str]) -> str:
        return f"{found[1]}{WRITERS[found[2], found[3]]()}\n{found[5]}"

    return _BLOCK.sub(block, path.read_text(encoding="utf-8"))
