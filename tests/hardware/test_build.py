"""The firmware compiles without a warning, and the packaged image is exactly what its sources give."""

import math
from pathlib import Path

import pytest
from hardware_bench import coupling, export_c, push, require, run, scratch
from tick_profile import tick_instructions

from avc_casadi import LinkError, UnsupportedError
from avc_casadi.model.runtime import Runtime
from avc_hardware import EmulatedBoard, build_firmware
from avc_hardware.codegen import build
from avc_hardware.codegen.boards import IMAGE
from avc_hardware.codegen.image import read_elf


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_board_builds_without_warnings_and_keeps_its_memory(tmp_path: Path) -> None:
    require("arm-none-eabi-gcc")
    image = read_elf(build.build_image(out=tmp_path))
    assert 0 < sum(map(len, image.segments.values())) < 33_000
    assert min(image.segments) == 0x08000000
    memory = max(address + size for name, (address, size) in image.symbols.items() if name == "device")
    assert memory - 0x20000000 < 49_000


# `avc firmware`: sample time, encoder and force of the device in an image that takes no coupling for another.

DEVICE = {"sample_time_s": 2.5e-4, "encoder_resolution_m": 2e-5, "max_force_n": 8.0, "damping_ns_per_m": 1.25}
RUNTIME = Runtime(guard="passivity-controller", hold_s=0.31, slew_per_s=7.0)


@pytest.mark.slow
def test_it_takes_the_coupling_of_its_device_and_no_other() -> None:
    require("arm-none-eabi-gcc", "unicorn")
    made = coupling(9, runtime=RUNTIME.model_copy(update={"estimator": "zero-crossing", "slew_per_s": None}), **DEVICE)
    with pytest.raises(UnsupportedError, match="estimator is fused"):  # another program
        push(made, "emulator")
    elf = build_firmware(made, "netduinoplus2", scratch() / "made").files[0]
    assert push(made, EmulatedBoard(elf, encoder=lambda _: 0)).device.sample_time_s == 2.5e-4
    with pytest.raises(LinkError):
        push(
            coupling(9, runtime=made.runtime, **(DEVICE | {"sample_time_s": 1e-3})),
            EmulatedBoard(elf, encoder=lambda _: 0),
        )


def test_an_exported_coupling_does_not_compile_for_another_loop(tmp_path: Path) -> None:
    require("gcc")
    for name, text in export_c(coupling(1, sample_time_s=2.5e-4)).items():
        (tmp_path / name).write_text(text)
    source = str(tmp_path / "avc_coupling.c")
    run("gcc", "-fsyntax-only", "-Wall", "-Werror", "-DAVC_LOOP_SAMPLE_TIME_NS=250000", source)
    with pytest.raises(AssertionError, match="another sample time than the loop that runs it"):
        run("gcc", "-fsyntax-only", "-DAVC_LOOP_SAMPLE_TIME_NS=1000000", source)


# Instructions of a control tick: counted one by one, the same in two emulators, and within the budget.

MADE = coupling(200, seed=3, largest=(300.0, 1e5, 50.0), runtime=Runtime(guard="passivity-controller"))
TICKS = 40
# Gains that follow the frequency, with everything but the estimator; then everything. Some 70 of each for faults.
REST_BUDGET, TICK_BUDGET = 690, 2350


def motion(tick: int) -> int:
    """Counts: taps that grow faster, from the rest in which the table was pushed."""
    time = tick * 1e-3
    return round(200 * math.sin(2 * math.pi * (10 + 40 * time) * time))


@pytest.mark.slow
def test_tick_keeps_its_budget() -> None:
    require("unicorn")
    ticks = list(tick_instructions(MADE, counts=motion, ticks=TICKS))
    assert max(tick.total - tick.functions["avc_estimate_step"] for tick in ticks) <= REST_BUDGET
    assert max(tick.total for tick in ticks) <= TICK_BUDGET
