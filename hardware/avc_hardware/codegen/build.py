"""Build the firmware: ``python -m avc_hardware.codegen.build`` makes the packaged image anew."""

from __future__ import annotations

import argparse
import functools
import hashlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi import InputError, MissingExtraError, UnsupportedError
from avc_casadi.coupling import Coupling
from avc_casadi.model.problem import Problem
from avc_hardware.codegen.boards import FIRMWARE, IMAGE, PACKAGED, Board, read_board
from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, BoardLimits, Config, RuntimeFigures, device_config
from avc_hardware.codegen.firmware_fit import check_runs_on, figures_of
from avc_hardware.codegen.tick_program import CONFIG, config_source, tick_sources

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-pedantic")
# One rounding an operation: without it a fused multiply-add would make boards disagree with each other and the host.
EXACT_FLOAT = ("-ffp-contract=off", "-fno-fast-math")
# The divider of the packaged boards' ports has 16 bits at up to 84 MHz and takes 16 clocks a bit.
_BAUDS = (2400, 2_000_000)


def compiler(name: str, install: str) -> str:
    """Return the path of a compiler."""
    path = shutil.which(name)
    if path is None:
        raise MissingExtraError(f"{name} is not installed; on Debian or Ubuntu: {install}")
    return path


def compile_with(command: list[str]) -> None:
    """Run a compiler; what it says is the message."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own arguments
    if done.returncode != 0:
        raise UnsupportedError(f"{command[0]} failed:\n{done.stderr.strip()}")


@functools.cache
def source_hash(estimator: str = "fused", passive: bool = True, *further: bytes) -> str:
    """Return the name of a build in HELLO: 8 hexadecimal digits of the SHA-256 over all its sources."""
    digest = hashlib.sha256(b"".join(further))
    parts = [*(FIRMWARE / "core").rglob("*"), *(FIRMWARE / "boards").rglob("*")]
    for path in sorted(path for path in parts if path.suffix in {".c", ".h", ".ld"}):
        digest.update(path.relative_to(FIRMWARE).as_posix().encode())
        digest.update(path.read_bytes().replace(b"\r\n", b"\n"))
    for name, text in sorted(tick_sources(RuntimeFigures(estimator=estimator, passive=passive)).items()):
        digest.update(name.encode() + text.encode())
    return digest.hexdigest()[:8]


def _build_name(board: Board, figures: RuntimeFigures) -> str:
    """Return the name of the sources of an image, those of a custom board among them, as in HELLO."""
    board_sources = [(board.root / source).read_bytes() for source in board.sources] if board.own else []
    return source_hash(figures.estimator, figures.passive, *board_sources)


def options_of(made: Path, build: str) -> list[str]:
    """Return the options of the C compiler of a firmware; ``made`` is the folder of the generated sources."""
    return [
        "-std=c11",
        "-O2",
        *WARNINGS,
        *EXACT_FLOAT,
        f"-ffile-prefix-map={FIRMWARE}=firmware",
        f'-DAVC_BUILD="{build}"',
        f"-I{made}",
        f"-I{FIRMWARE / 'core'}",
    ]


def generate(made: Path, config: Config, *, bound: bool) -> list[Path]:
    """Write the generated sources; return all sources of the core, these among them."""
    made.mkdir(parents=True, exist_ok=True)
    files: Mapping[str, str] = tick_sources(config.figures) | config_source(config, bound=bound)
    for name, text in files.items():
        (made / name).write_text(text, encoding="utf-8")
    return [*sorted((FIRMWARE / "core").glob("*.c")), *(made / name for name in ("avc_estimate.c", CONFIG))]


def build_image(
    board: Board | None = None,
    out: Path = IMAGE.parent,
    *,
    baud: int | None = None,
    config: Config | None = None,
    bound: bool = False,
) -> Path:
    """Build the ELF image of a board, whose configuration is its own for ever where it is bound."""
    boards = FIRMWARE / "boards"
    board = board or read_board(boards / PACKAGED)
    # Any motion is plausible to an image that waits for the configuration of its device.
    config = config or Config(BoardLimits().unwatched, RuntimeFigures())
    common = ("memory.c", "main.c", "defaults.c", "start.c")
    image = out / f"{board.name}.elf"
    out.mkdir(parents=True, exist_ok=True)
    places = {"FLASH_ORIGIN": board.flash.origin, "FLASH_SIZE": board.flash.bytes}
    places |= {"RAM_ORIGIN": board.memory.origin, "RAM_SIZE": board.memory.bytes}
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        sources = [*(boards / source for source in common), *(board.root / source for source in board.sources)]
        sources += generate(made, config, bound=bound)
        command = [
            compiler(board.compiler, board.install),
            *options_of(made, _build_name(board, config.figures)),
            *board.flags,
            *EXACT_FLOAT,  # whatever the flags of a custom board
            f"-DAVC_CAPACITY_ROWS={board.capacity.rows}",
            f"-DAVC_CAPACITY_RECORDS={board.capacity.records}",
            *([f"-DBOARD_BAUD={baud}u"] if baud else []),
            f"-I{boards}",
            f"-I{board.root}",
            *("-idirafter", str(boards / "library")),
            *([f"-ffile-prefix-map={board.root}=board"] if board.own else []),
            *("-fno-tree-loop-distribute-patterns", "-ffunction-sections", "-fdata-sections", "-fno-common", "-g0"),
            *("-nostdlib", "-Wl,--gc-sections,--build-id=none,--no-warn-rwx-segments"),
            *(f"-Wl,--defsym={place}={value:#x}" for place, value in places.items()),
            f"-T{boards / 'link.ld'}",
            *map(str, sources),
            *("-lgcc", "-o", str(image)),
        ]
        compile_with(command)
    return image


@dataclass(frozen=True)
class BuiltFirmware:
    """Firmware for one board and one device."""

    board: str
    title: str
    build: str  # name of the sources, as in HELLO
    files: tuple[Path, Path, Path]  # elf, bin and hex
    address: int  # of the first byte of the bin file
    size: int  # bytes in flash
    limits: BoardLimits
    figures: RuntimeFigures
    commands: tuple[str, ...]  # each flashes it, or runs it, from within the folder of the files


def build_firmware(of: Coupling | Problem | Device, board: str, out: Path, *, baud: int | None = None) -> BuiltFirmware:
    """Build the firmware of a board for a device, whose sample time, encoder and force limit it keeps.

    No gains are in it. Of a coupling it takes estimator, hold, slew, passive change and guard limit too.
    """
    if baud is not None and not _BAUDS[0] <= baud <= _BAUDS[1]:
        fault = f"is {baud}; allowed: {_BAUDS[0]} to {_BAUDS[1]}, the rates of serial ports"
        raise InputError.of(fault, key="baud")
    target = _board(board)
    problem = of.problem if isinstance(of, Coupling) else of
    config = device_config(problem.device if isinstance(problem, Problem) else problem)
    if isinstance(of, Coupling):
        check_runs_on(of)
        config = replace(config, figures=figures_of(of))
    if not isinstance(of, Coupling) or of.table.constant:
        config = replace(config, figures=replace(config.figures, estimator=target.estimator))
    elf = build_image(target, out, baud=baud, config=config, bound=True)
    files = (elf, elf.with_suffix(".bin"), elf.with_suffix(".hex"))
    objcopy = compiler(f"{target.compiler.removesuffix('gcc')}objcopy", target.install)
    for kind, file in zip(("binary", "ihex"), files[1:], strict=True):
        compile_with([objcopy, f"--output-target={kind}", str(elf), str(file)])
    commands = tuple(command.replace("{name}", target.name) for command in target.commands)
    build = _build_name(target, config.figures)
    address, size = target.flash.origin, files[1].stat().st_size
    return BuiltFirmware(
        target.name, target.title, build, files, address, size, config.limits, config.figures, commands
    )


def _board(name: str) -> Board:
    folder = FIRMWARE / "boards" / PACKAGED if name == PACKAGED else Path(name)
    if folder.is_dir():
        return read_board(folder)
    allowed = f"{PACKAGED}, or the folder of a board of your own (hardware/PORTING.md)"
    raise InputError.of(f"is {name!r}; allowed: {allowed}", key="board")


def main(argv: list[str] | None = None) -> int:
    """Build the packaged image, or write the generated C."""
    parser = argparse.ArgumentParser(prog="python -m avc_hardware.codegen.build", description=main.__doc__)
    parser.add_argument("--generate", type=Path, metavar="DIR", help="write the C of the tick, a folder an estimator")
    arguments = parser.parse_args(argv)
    if arguments.generate is not None:
        for estimator in ESTIMATOR_NUMBERS:
            figures = RuntimeFigures(estimator=estimator)
            generate(arguments.generate / estimator, Config(BoardLimits(), figures), bound=True)
        return 0
    image = build_image()
    sys.stdout.write(f"{image} {image.stat().st_size} bytes sha256 {hashlib.sha256(image.read_bytes()).hexdigest()}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
