"""The pages that users and maintainers read, and their parts: links, headings, code blocks."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_ROOMS = ("avc_casadi", "hardware", "joss", "problems", "tests/benchmarks")
PAGES = sorted(
    {*ROOT.glob("*.md")}
    | {path for room in _ROOMS for path in (ROOT / room).rglob("*.md") if "packaging" not in path.parts},
)
_FENCE = re.compile(
    r"(?:^<!-- (?P<mark>[^\n]*?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page, with the line of its fence and the comment (mark) above it."""

    page: str
    line: int
    language: str
    text: str
    mark: str


def shown(path: Path) -> str:
    """Path from the root, for messages."""
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path) -> list[Block]:
    """Every fenced block of a page."""
    page = path.read_text(encoding="utf-8")
    return [
        Block(shown(path), page.count("\n", 0, found.start("text")), language, text, mark or "")
        for found in _FENCE.finditer(page)
        for mark, language, text in [found.group("mark", "language", "text")]
    ]


def prose(path: Path) -> str:
    """A page without its fenced blocks."""
    return _FENCE.sub("", path.read_text(encoding="utf-8"))


def anchors(path: Path) -> set[str]:
    """What may stand behind # in a link to the page, as GitHub makes it from headings."""
    found: dict[str, int] = {}
    names = set()
    for title in re.findall(r"^#+ (.*)$", prose(path), re.MULTILINE):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).lower()
        slug = re.sub(r"[^\w\- ]", "", text).replace(" ", "-")
        names.add(f"{slug}-{found[slug]}" if slug in found else slug)
        found[slug] = found.get(slug, 0) + 1
    return names


def links(path: Path) -> list[str]:
    """Targets of the links and pictures of a page."""
    plain = re.sub(r"`[^`\n]*`", "", prose(path))
    return re.findall(r"\]\(([^)\s]+)\)", plain)
