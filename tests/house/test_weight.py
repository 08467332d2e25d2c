"""Each room's lines against its ceiling in weight.toml. `python tests/house/test_weight.py --lower` lowers ceilings."""

import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import pytest

HERE = Path(__file__).parent
CEILINGS = HERE / "weight.toml"
PAGE, C = {".js", ".html", ".css"}, {".c", ".h", ".cpp", ".hpp"}
HEAD = """\
# Ceilings in lines. A commit only lowers them: `python tests/house/test_weight.py --lower`, on top of main, as the
# last thing before it lands; where this file conflicts, take main's and lower again. A new room takes its lines from
# what others leave.
"""


def room(path: Path) -> str | None:
    """Return the room that a file of the repository counts for."""
    top, suffix = path.parts[0], path.suffix
    if suffix == ".md":
        return None if top == "joss" else "markdown"
    if top == "avc_casadi" and suffix in PAGE:
        return "page"
    if top == "avc_casadi" and suffix == ".py":
        return f"avc_casadi/{path.parts[1]}" if len(path.parts) > 2 else "avc_casadi"
    if top == "hardware":
        return "hardware python" if suffix == ".py" else "hardware c" if suffix in C else None
    return "tests" if top == "tests" and suffix == ".py" else None


def lines() -> Counter[str]:
    """Return the lines of each room; nothing where the tree is no clone."""
    root = HERE.parent.parent
    try:
        done = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, text=True, check=True)  # noqa: S607
    except (OSError, subprocess.CalledProcessError):
        return Counter()
    found: Counter[str] = Counter()
    for name in done.stdout.split("\0"):
        path = root / name
        if name and path.is_file() and (where := room(Path(name))):
            found[where] += path.read_bytes().count(b"\n")
    return found


def too_heavy(found: dict[str, int], ceilings: dict[str, int]) -> list[str]:
    """Say which room is above its ceiling, and what to do."""
    return [
        f"{where}: {count} lines, ceiling {ceilings.get(where, 0)}: take {count - ceilings.get(where, 0)} lines out"
        if where in ceilings
        else f"{where}: {count} lines, no ceiling: `python tests/house/test_weight.py --lower` takes them from others"
        for where, count in sorted(found.items())
        if count > ceilings.get(where, 0)
    ]


def lowered(found: dict[str, int], ceilings: dict[str, int]) -> dict[str, int]:
    """Return ceilings at today's sizes, none raised; a new room has what the others leave."""
    kept = {where: min(ceiling, found[where]) for where, ceiling in ceilings.items() if where in found}
    new = {where: count for where, count in found.items() if where not in ceilings}
    if sum(new.values()) > sum(ceilings.values()) - sum(kept.values()):
        sys.exit(f"new rooms need more lines than the others leave: {new}")
    return kept | new


def test_no_room_is_above_its_ceiling():
    found = lines()
    if not found:
        pytest.skip("not a git clone")
    assert too_heavy(found, tomllib.loads(CEILINGS.read_text(encoding="ascii"))) == []


def test_a_ceiling_only_falls():
    assert lowered({"a": 3, "b": 9}, {"a": 5, "b": 7, "gone": 4}) == {"a": 3, "b": 7}
    assert lowered({"a": 3, "new": 2}, {"a": 5}) == {"a": 3, "new": 2}
    with pytest.raises(SystemExit, match="new rooms need more"):
        lowered({"a": 3, "new": 3}, {"a": 5})
    assert [told.partition(":")[0] for told in too_heavy({"a": 6, "b": 7, "new": 1}, {"a": 5, "b": 7})] == ["a", "new"]


if __name__ == "__main__":
    if sys.argv[1:] != ["--lower"]:
        sys.exit(__doc__)
    table = lowered(lines(), tomllib.loads(CEILINGS.read_text(encoding="ascii")))
    CEILINGS.write_text(HEAD + "".join(f'"{where}" = {table[where]}\n' for where in sorted(table)), encoding="ascii")
    sys.stdout.write(CEILINGS.read_text(encoding="ascii"))
