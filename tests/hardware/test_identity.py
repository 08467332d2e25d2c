"""A build tells the name that HELLO tells, keeps exact floats whatever a board asks for, refuses what cannot work."""

import json
import re
import shutil
from pathlib import Path

import pytest
from hardware_bench import coupling, require

import avc_casadi as avc
from avc_casadi import InputError, UnsupportedError
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_hardware import build_firmware
from avc_hardware.link.faults import Reason, Refusal
from avc_hardware.link.stream import faults_on_the_way

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


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"arm-none-eabi-gcc"', '"arm-none-eabi-gccc"', r"compiler: is 'arm-none-eabi-gccc', which is no program"),
        ("estimator =", "estimater =", r"estimater: is unknown"),
        ("origin = 0x00000000", "origin = 0x10", r"flash\.origin: .*multiple of 256"),
        ("origin = 0x20000000", "origin = 0x20000002", r"memory\.origin: .*multiple of 8"),
        ("bytes = 0x4000\n", "bytes = 0x4001\n", r"memory\.bytes: .*multiple of 4"),
    ],
)
def test_a_manifest_that_cannot_work_is_refused_by_its_key(tmp_path: Path, old: str, new: str, told: str) -> None:
    require("arm-none-eabi-gcc")
    with pytest.raises(InputError, match=told) as caught:
        build_firmware(coupling(1).problem, str(board(tmp_path / "b", one=(old, new))), tmp_path)
    assert [fault.file for fault in caught.value.faults] == [str(tmp_path / "b" / "board.toml")]


def test_a_manifest_in_place_of_its_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="allowed: its folder"):
        build_firmware(coupling(1).problem, str(M0 / "board.toml"), tmp_path)


@pytest.mark.parametrize("baud", ["300", "115200000"])
def test_a_rate_that_no_port_divides_to_is_refused(
    tmp_path: Path, baud: str, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["firmware", "reference-r1", "--board", "netduinoplus2", "--out", str(tmp_path / "f"), "--baud", baud]
    assert main(asked) == 2
    assert "--baud: is " in capsys.readouterr().err


def test_a_stream_tells_refused_messages_from_lost_ones() -> None:
    stale, mode = (Refusal(reason, 0) for reason in (Reason.STALE, Reason.MODE))
    assert faults_on_the_way(10, 0, 0, [mode] * 10) == [f"10 of 10 messages were refused, the last: {mode}"]
    assert faults_on_the_way(10, 4, 6, [stale] * 6) == ["4 of 10 messages were lost, 6 late"]
    assert faults_on_the_way(10, 0, 0, []) == []


@pytest.mark.thorough
def test_the_rate_of_the_line_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require("arm-none-eabi-gcc")
    asked = ["firmware", "reference-r1", "--board", "netduinoplus2", "--out", str(tmp_path / "f"), "--baud", "921600"]
    assert main(asked) == 0
    text = capsys.readouterr().out
    assert "avc push --baud 921600" in text
    assert "Serial line  921600 baud" in text


def knob(**more: object) -> Coupling:
    problem = avc.load_problem("knob").changed(**more)
    return Coupling.constant(problem, Gains(0.0, 0.5), "static")


@pytest.mark.thorough
def test_detents_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnsupportedError, match="detent has no place in the table"):
        build_firmware(knob(), "netduinoplus2", tmp_path)


@pytest.mark.thorough
def test_a_knobs_firmware_is_told_in_its_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require("arm-none-eabi-gcc")
    asked = ["firmware", "knob", "--board", "netduinoplus2", "--out", str(tmp_path / "f")]
    assert main([*asked, "--json"]) == 0
    text = capsys.readouterr().out
    assert json.loads(text)["limits"]["radians_per_count"] == pytest.approx(2 * 3.14159265358979 / 16384)
    assert not re.search(r"metres|_m_per_s", text)
