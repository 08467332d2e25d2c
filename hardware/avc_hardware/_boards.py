"""The boards that firmware is built for: processor, memory, sources, and how an image gets there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from avc_hardware._firmware import ARM_INSTALL

_M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
_M3 = ("-mcpu=cortex-m3", "-mthumb", "-mfloat-abi=soft")


@dataclass(frozen=True)
class Target:
    """One board.

    Attributes:
        title: what it is, for people.
        folder: name of the one that holds board.h and the sources.
        cpu: compiler flags of the core.
        flash: origin and size, bytes.
        ram: origin and size, bytes.
        extra: further sources, relative to firmware/boards.
        defines: compiler definitions.
        estimator: method; the fused one is too slow for floats in software.
        commands: how to put an image on it, or to run it, with {name} for the file without its ending; empty for a
            board of tests alone.
        root: the folder of a board that is not in the package; None for firmware/boards/FOLDER.
        sources: in the folder.
        cortex_m: takes start, tick and linker script of the package.
        linker_script: in the folder; empty for that of the package.
        compiler: the cross compiler, a gcc.
        install: how to get it.
    """

    title: str
    folder: str
    cpu: tuple[str, ...]
    flash: tuple[int, int]
    ram: tuple[int, int]
    extra: tuple[str, ...] = ()
    defines: tuple[str, ...] = ()
    estimator: str = "fused"
    commands: tuple[str, ...] = ()
    root: Path | None = None
    sources: tuple[str, ...] = ("board.c",)
    cortex_m: bool = True
    linker_script: str = ""
    compiler: str = "arm-none-eabi-gcc"
    install: str = ARM_INSTALL


# Its last two sectors hold what is kept over a reset.
_STM32F405 = ((0x08000000, 0xC0000), (0x20000000, 0x20000))
_KEEPS = "stm32f405/flash.c"
_FLASHING = (
    "st-flash --reset write {name}.bin 0x08000000",
    "dfu-util -a 0 -s 0x08000000:leave -D {name}.bin    (BOOT0 high at reset)",
    'openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c "program {name}.elf verify reset exit"',
    "STM32_Programmer_CLI -c port=SWD -w {name}.hex -v -rst",
)
TARGETS = {
    "netduinoplus2": Target(
        "STM32F405 as emulators have it, without clocks",
        "netduinoplus2",
        _M4F,
        *_STM32F405,
        (_KEEPS,),
        commands=("qemu-system-arm -M netduinoplus2 -kernel {name}.elf -display none -serial pty",),
    ),
    "stm32f405": Target(
        "STM32F405, Cortex-M4F at 168 MHz",
        "netduinoplus2",
        _M4F,
        *_STM32F405,
        ("stm32f405/clock.c", _KEEPS),
        commands=_FLASHING,
    ),
    "mps2-an386": Target(
        "Arm MPS2 AN386 in QEMU, Cortex-M4F",
        "mps2-an386",
        _M4F,
        (0x00000000, 0x400000),
        (0x20000000, 0x20000),
        commands=("qemu-system-arm -M mps2-an386 -kernel {name}.elf -display none -serial pty",),
    ),
    "lm3s6965evb": Target(
        "TI LM3S6965 in QEMU, Cortex-M3 with floats in software",
        "lm3s6965evb",
        _M3,
        (0x00000000, 0x40000),
        (0x20000000, 0x10000),
        estimator="zero-crossing",
        commands=("qemu-system-arm -M lm3s6965evb -kernel {name}.elf -display none -serial pty",),
    ),
    # for tests in lock step with a plant outside, on the machines mps2-an386 and lm3s6965evb
    "bench-m4f": Target("bench in QEMU, Cortex-M4F", "bench", _M4F, (0x00000000, 0x400000), (0x20000000, 0x20000)),
    "bench-m3": Target(
        "bench in QEMU, Cortex-M3",
        "bench",
        _M3,
        (0x00000000, 0x40000),
        (0x20000000, 0x10000),
        defines=("-DBOARD_CLOCK_HZ=12500000u",),
        estimator="zero-crossing",
    ),
}
