"""`avc firmware`: sample time, encoder and force of the device in an image that takes no coupling for another."""

import dataclasses
from pathlib import Path

import pytest
from hardware_bench import coupling, export_c, push, require, run, scratch

from avc_casadi import LinkError, UnsupportedError
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


def test_an_exported_coupling_does_not_compile_for_another_loop(tmp_path: Path) -> None:
    require("gcc")
    for name, text in export_c(coupling(1, sample_time_s=2.5e-4)).items():
        (tmp_path / name).write_text(text)
    source = str(tmp_path / "avc_coupling.c")
    run("gcc", "-fsyntax-only", "-Wall", "-Werror", "-DAVC_LOOP_SAMPLE_TIME_NS=250000", source)
    with pytest.raises(AssertionError, match="another sample time than the loop that runs it"):
        run("gcc", "-fsyntax-only", "-DAVC_LOOP_SAMPLE_TIME_NS=1000000", source)
