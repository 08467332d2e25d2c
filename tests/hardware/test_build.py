"""The firmware compiles without a warning, and the packaged image is exactly what its sources give."""

import re
from pathlib import Path

import pytest
from hardware_bench import require, run

from avc_hardware.codegen import build
from avc_hardware.codegen.boards import IMAGE, TARGETS
from avc_hardware.codegen.figures import RuntimeFigures
from avc_hardware.codegen.image import read_elf


@pytest.mark.thorough
def test_packaged_image_is_what_the_sources_give(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    made = build.build_image(out=tmp_path)
    version = run("arm-none-eabi-gcc", "--version").decode()
    if "12.2" not in version.splitlines()[0]:
        pytest.skip(f"the image was built with arm-none-eabi-gcc 12.2, here is {version.splitlines()[0]}")
    assert made.read_bytes() == IMAGE.read_bytes()


def test_image_was_built_from_these_sources() -> None:
    """Those that the scene's expressions give today are among them."""
    assert build.source_hash().encode() in IMAGE.read_bytes()


@pytest.mark.thorough
def test_the_board_builds_without_warnings_and_keeps_its_memory(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    image = read_elf(build.build_image(out=tmp_path))
    board = TARGETS["netduinoplus2"]
    assert 0 < sum(len(segment.data) for segment in image.segments) < 33_000
    assert image.segments[0].address == board.flash[0]
    memory = max(address + size for name, (address, size) in image.symbols.items() if name == "device")
    assert memory - board.ram[0] < 49_000


@pytest.mark.thorough
@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_core_compiles_without_warnings(cc: str, tmp_path: Path) -> None:
    require(cc)
    assert build.build_host(tmp_path, cc=cc).stat().st_size > 0


def test_core_uses_no_library_but_memcpy_and_memset() -> None:
    allowed = {"stdint.h", "stddef.h", "stdbool.h", "string.h", "stdatomic.h"}
    texts = {path.name: path.read_text() for path in (build.FIRMWARE / "core").rglob("*.[ch]")}
    for name, text in (texts | build.tick_sources(RuntimeFigures())).items():
        assert set(re.findall(r"#include <(.+)>", text)) <= allowed, name
        assert not re.search(r"\b(malloc|calloc|free|printf|memmove|strlen)\s*\(", text), name
        assert "double" not in text, name
