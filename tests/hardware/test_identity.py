"""A build tells the name that HELLO tells, keeps exact floats whatever a board asks for, refuses what cannot work."""

import shutil
from pathlib import Path

import pytest
from hardware_bench import coupling, require

from avc_hardware import build_firmware

M0 = Path(__file__).parents[1] / "boards" / "cortex-m0"


def board(folder: Path, **changes: tuple[str, str]) -> Path:
    """Copy a board, with texts of its manifest changed."""
    shutil.copytree(M0, folder)
    manifest = (folder / "board.toml").read_text()
    for old, new in changes.values():
        assert old in manifest
        manifest = manifest.replace(old, new)
    (folder / "board.toml").write_text(manifest)
    return folder


@pytest.mark.thorough
def test_the_build_that_is_told_stands_in_the_image(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    made = coupling(1)
    own = board(tmp_path / "own")
    (own / "board.c").write_text((own / "board.c").read_text() + "\n/* mine */\n")
    names = set()
    for target in ("netduinoplus2", str(own)):
        built = build_firmware(made.problem, target, tmp_path / target[-3:])
        assert built.build.encode() in built.files[0].read_bytes()
        names.add(built.build)
    assert len(names) == 2


@pytest.mark.thorough
def test_flags_of_a_board_do_not_undo_exact_floats(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    hard = (
        '"-mcpu=cortex-m0", "-mthumb", "-mfloat-abi=soft", "-Os"',
        '"-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"{}',
    )
    images = []
    for name, more in (("plain", ""), ("fast", ', "-ffast-math", "-ffp-contract=fast"')):
        target = board(tmp_path / name / "same", flags=(hard[0], hard[1].format(more)))
        images.append(build_firmware(coupling(1).problem, str(target), tmp_path / name).files[1].read_bytes())
    assert images[0] == images[1]
