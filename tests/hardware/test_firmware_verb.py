"""`avc firmware`: sample time, encoder and force of the device in an image that takes no coupling for another."""

import dataclasses
import json
from pathlib import Path

import pytest
from hardware_bench import coupling, export_c, push, require, run, scratch

from avc_casadi import LinkError, UnsupportedError, load_problem
from avc_casadi.cli import main
from avc_casadi.model.runtime import Runtime
from avc_hardware import EmulatedBoard, build_firmware

DEVICE = {"sample_time_s": 2.5e-4, "encoder_resolution_m": 2e-5, "max_force_n": 8.0, "damping_ns_per_m": 1.25}
RUNTIME = Runtime(guard="passivity-controller", hold_s=0.31, slew_per_s=7.0)


@pytest.mark.thorough
def test_it_takes_the_coupling_of_its_device_and_no_other() -> None:
    require("arm-none-eabi-gcc", "unicorn")
    made = coupling(9, runtime=dataclasses.replace(RUNTIME, estimator="zero-crossing", slew_per_s=None), **DEVICE)
    with pytest.raises(UnsupportedError, match="estimator is fused"):  # another program
        push(made, "emulator")
    elf = build_firmware(made, "netduinoplus2", scratch() / "made").files[0]
    result = push(made, plain_board(elf))
    assert result.readback_equal
    assert result.device.sample_time_s == 2.5e-4
    with pytest.raises(LinkError, match=r"sample time of 0\.001 s, the device runs at 0\.00025 s.*avc firmware"):
        push(coupling(9, runtime=made.runtime, **(DEVICE | {"sample_time_s": 1e-3})), plain_board(elf))


def plain_board(elf: Path) -> EmulatedBoard:
    return EmulatedBoard(elf, encoder=lambda _: 0)


@pytest.mark.thorough
def test_flash_files_hold_what_the_linker_made(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    built = build_firmware(load_problem("reference-r1"), "netduinoplus2", tmp_path)
    assert (built.address, built.limits.metres_per_count, built.limits.max_force_n) == (0x08000000, 2e-5, 8.0)
    elf, binary, text = built.files
    assert built.size == binary.stat().st_size
    for form, file in (("binary", binary), ("ihex", text)):
        run("arm-none-eabi-objcopy", "-I", "elf32-littlearm", "-O", form, str(elf), str(tmp_path / form))
        theirs = (tmp_path / form).read_bytes()
        if form == "ihex":  # of their records, those that hold data; they add where to start
            run("arm-none-eabi-objcopy", "-I", form, "-O", "binary", str(file), str(tmp_path / "back"))
            assert (tmp_path / "back").read_bytes() == binary.read_bytes()
        else:
            assert file.read_bytes() == theirs


def test_an_exported_coupling_does_not_compile_for_another_loop(tmp_path: Path) -> None:
    require("gcc")
    for name, text in export_c(coupling(1, sample_time_s=2.5e-4)).items():
        (tmp_path / name).write_text(text)
    source = str(tmp_path / "avc_coupling.c")
    run("gcc", "-fsyntax-only", "-Wall", "-Werror", "-DAVC_LOOP_SAMPLE_TIME_NS=250000", source)
    with pytest.raises(AssertionError, match="another sample time than the loop that runs it"):
        run("gcc", "-fsyntax-only", "-DAVC_LOOP_SAMPLE_TIME_NS=1000000", source)


@pytest.mark.thorough
def test_the_command_tells_what_it_made_and_how_to_flash_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require("arm-none-eabi-gcc")
    out = str(tmp_path / "made")
    assert main(["firmware", "reference-r2", "--board", "netduinoplus2", "--out", out, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [Path(file).suffix for file in document["files"]] == [".elf", ".bin", ".hex"]
    assert all(Path(file).stat().st_size > 10_000 for file in document["files"])
    assert any("st-flash" in command for command in document["commands"])
    assert main(["firmware", "reference-r2", "--board", "toaster", "--out", out]) == 2
    assert "allowed: netduinoplus2, or the folder" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_device_is_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require("arm-none-eabi-gcc")
    device = tmp_path / "mine.toml"
    device.write_text("[device]\nmass_kg = 0.1\ndamping_ns_per_m = 1.0\nsample_time_s = 5e-4\nmax_force_n = 7.0\n")
    asked = ["firmware", str(device), "--board", "netduinoplus2", "--out", str(tmp_path / "fw"), "--json"]
    assert main(asked) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["limits"]["sample_time_s"], document["limits"]["max_force_n"]) == (5e-4, 7.0)
    (note,) = document["notes"]
    assert note.startswith("the file has no device.encoder_resolution_m: 2e-06 is the board's own")
