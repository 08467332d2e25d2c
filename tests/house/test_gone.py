"""What went with 0.3 is named by no help, page or message; CHANGELOG alone says what to use instead."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
GONE = re.compile(
    r"avc (arm|study|screen|ports|limits|clear|store|commission)\b|--compare\b|commission|FOAW|Levant\b|compensator"
    r"|platformio|zephyr|\bL[89]\b|sphinx|measured bounds|\bfatrop\b|\balpaqa\b|ipqp|common_lyapunov"
    r"|felt\.strikes|checkpoint|avc_arm|adam-robotics",
    re.IGNORECASE,
)
SUFFIXES = {".py", ".md", ".toml", ".c", ".h", ".html", ".js", ".csv"}


def test_what_went_is_named_nowhere():
    rooms = [path for room in ("avc_casadi", "hardware", "problems") for path in (ROOT / room).rglob("*")]
    pages = [page for page in ROOT.glob("*.md") if page.name != "CHANGELOG.md"]
    read = [path for path in [*rooms, *pages, ROOT / "pyproject.toml"] if path.suffix in SUFFIXES]
    assert len(read) > 100
    named = {str(path.relative_to(ROOT)): found[0] for path in read if (found := GONE.search(path.read_text("utf-8")))}
    assert named == {}
