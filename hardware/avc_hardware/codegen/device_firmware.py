"""Firmware for a device: its sample time, encoder and force limit built in, as files to flash."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi import InputError
from avc_casadi._util.files import write_file
from avc_casadi._util.units import in_its_units
from avc_casadi.coupling import Coupling
from avc_casadi.model.problem import Problem
from avc_hardware.codegen.boards import MANIFEST, TARGETS, Target, flashing, read_board
from avc_hardware.codegen.build import build_image, build_name
from avc_hardware.codegen.figures import RuntimeFigures, board_limits
from avc_hardware.codegen.firmware_fit import check_runs_on, figures_of, wall_alone
from avc_hardware.codegen.image import as_binary, as_intel_hex, read_elf
from avc_hardware.codegen.tick_c import sources_for

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_hardware.codegen.figures import BoardLimits


BOARDS = {name: target.title for name, target in TARGETS.items()}
"""Boards of the firmware, with descriptions."""


@dataclass(frozen=True)
class BuiltFirmware:
    """Firmware for one board and one device.

    Attributes:
        board: name.
        title: description of the board.
        build: name of the sources, as in HELLO.
        files: elf, bin and hex.
        address: of the first byte of the bin file.
        size: bytes in flash.
        limits: sample time, encoder and force built in.
        figures: of its control tick.
        commands: each flashes it, or runs it, from within the folder of the files.
    """

    board: str
    title: str
    build: str
    files: tuple[Path, Path, Path]
    address: int
    size: int
    limits: BoardLimits
    figures: RuntimeFigures
    commands: tuple[str, ...]


# The divider of the packaged boards' ports has 16 bits at up to 84 MHz and takes 16 clocks a bit.
_BAUDS = (2400, 2_000_000)


@in_its_units
def build_firmware(
    of: Coupling | Problem | Device,
    board: str,
    out: Path,
    *,
    baud: int | None = None,
) -> BuiltFirmware:
    """Build the firmware of a board for a device: gains are pushed later.

    Args:
        of: a device or a problem, for sample time, encoder and force limit (by default 2 um and 50 N); or a coupling,
            for its estimator, hold, slew, passive change and guard limit too.
        board: a key of `BOARDS`, or the folder of a board of your own with its ``board.toml`` (hardware/PORTING.md).
        out: folder for ``BOARD.elf``, ``BOARD.bin`` and ``BOARD.hex``.
        baud: rate of the serial line, bits a second; None is 115200.

    Raises:
        InputError: unknown board, a rate that no port divides to, or all faults of its manifest.
        FirmwareLacksError: the coupling needs what no firmware of this release has.
        UnsupportedError: no program exists for the sample time, or the coupling has detents.
        MissingExtraError: no cross compiler; says how to install it.
    """
    if baud is not None and not _BAUDS[0] <= baud <= _BAUDS[1]:
        told = f"is {baud}; allowed: {_BAUDS[0]} to {_BAUDS[1]}, what serial ports divide to"
        raise InputError.of(told, key="baud")
    target = _target(board)
    problem = of.problem if isinstance(of, Coupling) else of
    device = problem.device if isinstance(problem, Problem) else problem
    limits, reach = board_limits(device), device.metres_per_unit
    figures = RuntimeFigures(limits.sample_time_s, limits.metres_per_count, target.estimator, hand_m_per_unit=reach)
    if isinstance(of, Coupling):
        check_runs_on(of)
        wall_alone(of)
        figures = figures_of(of)
        if of.table.constant:
            figures = replace(figures, estimator=target.estimator)
    generated = sources_for(limits, figures)
    elf = build_image(board if target.root is None else target, out, baud=baud, generated=generated)
    image = read_elf(elf)
    address, data = as_binary(image)
    binary, text = elf.with_suffix(".bin"), elf.with_suffix(".hex")
    write_file(binary, data)
    write_file(text, as_intel_hex(image))
    name = elf.stem
    commands = tuple(flashing(command, name) for command in target.commands)
    files = (elf, binary, text)
    build = build_name(target)
    return BuiltFirmware(name, target.title, build, files, address, len(data), limits, figures, commands)


def _target(board: str) -> Target:
    if board in BOARDS:
        return TARGETS[board]
    if Path(board).is_dir():
        return read_board(Path(board))
    if Path(board).name == MANIFEST:
        raise InputError.of(f"is {board!r}, a manifest; allowed: its folder, {str(Path(board).parent)!r}", key="board")
    raise InputError.of(
        f"is {board!r}; allowed: {', '.join(BOARDS)}, or the folder of a board of your own (hardware/PORTING.md)",
        key="board",
    )
