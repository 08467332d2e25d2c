"""Firmware made for a device: its sample time, encoder and force limit built in, as files to flash."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi import InputError
from avc_casadi.coupling import Coupling
from avc_casadi.problem import Problem
from avc_hardware._bench_plant import board_limits
from avc_hardware._boards import TARGETS, Target
from avc_hardware._elf import read_elf
from avc_hardware._figures import RuntimeFigures
from avc_hardware._firmware import source_hash
from avc_hardware._image_files import as_binary, as_intel_hex
from avc_hardware._manifest import read_board
from avc_hardware._runs_on import check_runs_on, figures_of

if TYPE_CHECKING:
    from avc_casadi.problem import Device
    from avc_hardware._host import BoardLimits

BOARDS = {name: target.title for name, target in TARGETS.items() if target.commands}
"""Boards that firmware can be built for, and what each is."""


@dataclass(frozen=True)
class BuiltFirmware:
    """Firmware for one board and one device.

    Attributes:
        board: name.
        title: what the board is.
        build: name of the sources, as HELLO tells it.
        files: elf, bin and hex.
        address: of the first byte of the bin file.
        size: bytes in flash.
        limits: sample time, encoder and force built in.
        figures: what its control tick was generated for.
        commands: each of them flashes it, or runs it, from within the folder of the files.
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


def build_firmware(of: Coupling | Problem | Device, board: str, out: Path, *, baud: int | None = None) -> BuiltFirmware:
    """Build the firmware of a board for a device: no gains are in it, they are pushed.

    Args:
        of: a device or a problem, for sample time, encoder and force limit (where it says nothing 2 um and 50 N); or
            a coupling, for its estimator, hold, slew, passive change and guard limit too.
        board: a key of `BOARDS`, or the folder of a board of your own with its ``board.toml`` (hardware/PORTING.md).
        out: folder for ``BOARD.elf``, ``BOARD.bin`` and ``BOARD.hex``.
        baud: rate of the serial line; None is 115200.

    Raises:
        InputError: unknown board, or all faults of its manifest.
        FirmwareLacksError: the coupling needs what no firmware of this release has.
        UnsupportedError: a sample time that no program is made for.
        MissingExtraError: no cross compiler; says how to install it.
    """
    target = _target(board)
    problem = of.problem if isinstance(of, Coupling) else of
    limits = board_limits(problem.device if isinstance(problem, Problem) else problem)
    figures = RuntimeFigures(limits.sample_time_s, limits.metres_per_count, target.estimator)
    if isinstance(of, Coupling):
        check_runs_on(of)
        figures = figures_of(of)
        if of.table.constant:
            figures = replace(figures, estimator=target.estimator)
    # It builds expressions in CasADi, whose import is slow; and it is a program too.
    from avc_hardware._runtime_c import sources_for  # noqa: PLC0415
    from avc_hardware.firmware_build import build_image  # noqa: PLC0415

    elf = build_image(board if target.root is None else target, out, baud=baud, generated=sources_for(limits, figures))
    image = read_elf(elf)
    address, data = as_binary(image)
    binary, text = elf.with_suffix(".bin"), elf.with_suffix(".hex")
    binary.write_bytes(data)
    text.write_text(as_intel_hex(image), encoding="ascii")
    name = elf.stem
    commands = tuple(command.replace("{name}", name) for command in target.commands)
    files = (elf, binary, text)
    return BuiltFirmware(name, target.title, source_hash(), files, address, len(data), limits, figures, commands)


def _target(board: str) -> Target:
    if board in BOARDS:
        return TARGETS[board]
    if Path(board).is_dir():
        return read_board(Path(board))
    raise InputError.of(
        f"is {board!r}; allowed: {', '.join(BOARDS)}, or the folder of a board of your own (hardware/PORTING.md)",
        key="board",
    )
