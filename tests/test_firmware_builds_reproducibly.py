"""The firmware compiles without a warning, and the packaged image is exactly what its sources give."""

import re
import shutil
from pathlib import Path

import pytest
from hardware_bench import require, run

from avc_casadi import UnsupportedError
from avc_hardware import firmware_build
from avc_hardware._elf import read_elf
from avc_hardware._firmware import IMAGE, source_hash


def test_packaged_image_is_what_the_sources_give(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    built = firmware_build.build_image("netduinoplus2", tmp_path)
    version = run("arm-none-eabi-gcc", "--version").decode()
    if "12.2" not in version.splitlines()[0]:
        pytest.skip(f"the image was built with arm-none-eabi-gcc 12.2, here is {version.splitlines()[0]}")
    assert built.read_bytes() == IMAGE.read_bytes()


def test_image_was_built_from_these_sources() -> None:
    assert source_hash().encode() in IMAGE.read_bytes()


def test_build_does_not_depend_on_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    require("arm-none-eabi-gcc")
    here = firmware_build.build_image("netduinoplus2", tmp_path / "a").read_bytes()
    elsewhere = tmp_path / "some other place"
    shutil.copytree(firmware_build.FIRMWARE, elsewhere)
    monkeypatch.setattr(firmware_build, "FIRMWARE", elsewhere)
    assert firmware_build.build_image("netduinoplus2", tmp_path / "b").read_bytes() == here


@pytest.mark.parametrize("target", firmware_build.TARGETS)
def test_every_board_builds_without_warnings(target: str, tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    image = read_elf(firmware_build.build_image(target, tmp_path))
    board = firmware_build.TARGETS[target]
    code = sum(len(segment.data) for segment in image.segments)
    # 1.8 KB for faults, 5 for observers without loops, 0.7 telemetry, 1.4 commissioning, 1.8 what is kept, 1.3 for a
    # first tick of its own
    assert 0 < code < 35_000
    assert image.segments[0].address == board.flash[0]
    memory = max(address + size for name, (address, size) in image.symbols.items() if name == "device")
    assert memory - board.ram[0] < 48_000


@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_core_compiles_without_warnings(cc: str, tmp_path: Path) -> None:
    require(cc)
    assert firmware_build.build_host(tmp_path, cc=cc).stat().st_size > 0


def test_a_warning_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    require("gcc")
    copy = tmp_path / "firmware"
    shutil.copytree(firmware_build.FIRMWARE, copy)
    table = copy / "core" / "avc_table.c"
    table.write_text(table.read_text() + "\nint avc_narrow(long long x);\nint avc_narrow(long long x) { return x; }\n")
    monkeypatch.setattr(firmware_build, "FIRMWARE", copy)
    with pytest.raises(UnsupportedError, match="conversion"):
        firmware_build.build_host(tmp_path)


def test_unknown_board_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnsupportedError, match="allowed: netduinoplus2"):
        firmware_build.build_image("toaster", tmp_path)


def test_core_uses_no_library_but_memcpy_and_memset() -> None:
    allowed = {"stdint.h", "stddef.h", "stdbool.h", "string.h", "stdatomic.h"}
    for path in (firmware_build.FIRMWARE / "core").rglob("*.[ch]"):
        text = path.read_text()
        assert set(re.findall(r"#include <(.+)>", text)) <= allowed, path.name
        assert not re.search(r"\b(malloc|calloc|free|printf|memmove|strlen)\s*\(", text), path.name
        assert "double" not in text, path.name
