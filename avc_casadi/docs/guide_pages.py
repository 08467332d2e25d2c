"""The pages that stand beside what they explain, as pages of the site, linked with each other there."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")

PAGES = {
    "README.md": "readme",
    "avc_casadi/README.md": "equations-and-layout",
    "problems/README.md": "problems",
    "problems/OTHER_ENDS.md": "simulations-and-second-devices",
    "hardware/README.md": "hardware",
    "hardware/PORTING.md": "porting",
    "hardware/COMPARED.md": "compared",
    "tests/benchmarks/README.md": "measured",
    "CONTRIBUTING.md": "contributing",
    "CHANGELOG.md": "changelog",
}


def write_guide(folder: Path, root: Path) -> None:
    """Write each page of the guide, and the pictures it shows, into a folder.

    Args:
        folder: where to.
        root: of the checkout.
    """
    folder.mkdir()
    for place, name in every_page(root).items():
        page = root / place
        text = page.read_text(encoding="utf-8")
        (folder / f"{name}.md").write_text(_linked(text, page, folder, root), encoding="utf-8")


def every_page(root: Path) -> dict[str, str]:
    """Every page by its path, with its name on the site: the guide and the pages of results."""
    package = root / "avc_casadi"
    rooms = {
        path.relative_to(root).as_posix(): "-".join(path.parent.relative_to(package).parts)
        for path in package.glob("*/**/README.md")
    }
    results = sorted((root / "tests" / "benchmarks").glob("RESULTS_*.md"))
    named = {path.relative_to(root).as_posix(): path.stem.lower().replace("_", "-") for path in results}
    whole = {place: name for place, name in PAGES.items() if (root / place).is_file()}
    return whole | {place: f"room-{name}" for place, name in rooms.items()} | named


def _linked(text: str, page: Path, folder: Path, root: Path) -> str:
    names = every_page(root)

    def link(found: re.Match[str]) -> str:
        picture, label, target = found.groups()
        if re.match(r"https?:|mailto:|#", target):
            return found[0]
        place, _, anchor = target.partition("#")
        path = (page.parent / place).resolve()
        inside = path.relative_to(root).as_posix() if path.is_relative_to(root) else ""
        if picture:
            shutil.copy(path, folder / path.name)
            return f"![{label}]({path.name})"
        if inside not in names and f"{inside}/README.md" in names:
            inside += "/README.md"
        if inside in names:
            return f"[{label}]({names[inside]}.md{'#' if anchor else ''}{anchor})"
        return f"{label} (`{inside}`)"

    # A fenced block holds no links, and a comment is nothing to show.
    parts = re.split(r"(^```.*?^```$)", text, flags=re.MULTILINE | re.DOTALL)
    return "".join(part if part.startswith("```") else _LINK.sub(link, part) for part in parts)
