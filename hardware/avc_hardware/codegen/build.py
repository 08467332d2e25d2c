"""Build the firmware: ``python -m avc_hardware.codegen.build [TARGET ...] [--out DIR]``.

Targets are the boards below, ``host`` (the portable core as a shared library for tests), ``fuzz`` (with sanitizers) and
``generate``. The C of the control tick is no file of the package: every build makes it from the scene's CasADi
expressions, in a second, and ``generate`` writes it down to be read. Builds are reproducible: the same sources and
compiler give the same bytes, on any path.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from avc_casadi import MissingExtraError, UnsupportedError
from avc_hardware.codegen.boards import TARGETS, Target
from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, BoardLimits, RuntimeFigures
from avc_hardware.codegen.firmware import FIRMWARE, IMAGE
from avc_hardware.codegen.tick_c import MADE_FOR, constants_sources, made_for, sources_for

WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-pedantic")
# One rounding an operation: without it a fused multiply-add would make boards disagree with each other and the host.
EXACT_FLOAT = ("-ffp-contract=off", "-fno-fast-math")
CORE = (
    "avc_crc32.c",
    "avc_frame.c",
    "avc_table.c",
    "avc_feedback.c",
    "avc_excite.c",
    "avc_fault.c",
    "avc_takeover.c",
    "avc_supervision.c",
    "avc_control.c",
    "avc_telemetry.c",
    "avc_answer.c",
    "avc_transfer.c",
    "avc_excitation.c",
    "avc_device.c",
)
# Generated; the constants of the figures are in sources of their own.
TICK = (
    "avc_guard_constants.c",
    "avc_couple_gated_constants.c",
    "avc_steady_gated_constants.c",
    "avc_couple_clips_constants.c",
    "avc_steady_clips_constants.c",
    "avc_estimate.c",
    "avc_estimate_constants.c",
    "avc_figures.c",
)
HOST_INSTALL = "apt-get install -y --no-install-recommends gcc"


def compiler(name: str, install: str) -> str:
    """Return the path of a compiler.

    Raises:
        MissingExtraError: it is not installed; says how to.
    """
    path = shutil.which(name)
    if path is None:
        raise MissingExtraError(f"{name} is not installed; on Debian or Ubuntu: {install}")
    return path


def _run(command: list[str]) -> None:
    """Run a compiler; what it says is the message."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own arguments
    if done.returncode != 0:
        raise UnsupportedError(f"{command[0]} failed:\n{done.stderr.strip()}")


@functools.cache
def tick_sources(estimator: str) -> dict[str, str]:
    """Return the generated C of the control tick for an estimator by file name, at the usual figures and limits."""
    return sources_for(BoardLimits(), RuntimeFigures(estimator=estimator))


def source_hash(estimator: str = "fused", *further: bytes) -> str:
    """Return the name of a build in HELLO: 8 hexadecimal digits of the SHA-256 over all its sources.

    Args:
        estimator: whose control tick is generated.
        further: sources of a custom board.
    """
    digest = hashlib.sha256(b"".join(further))
    parts = [*(FIRMWARE / "core").rglob("*"), *(FIRMWARE / "boards").rglob("*")]
    for path in sorted(path for path in parts if path.suffix in {".c", ".h", ".ld"}):
        digest.update(path.relative_to(FIRMWARE).as_posix().encode())
        digest.update(path.read_bytes().replace(b"\r\n", b"\n"))
    for name, text in sorted(tick_sources(estimator).items()):
        digest.update(name.encode() + text.encode())
    return digest.hexdigest()[:8]


def build_name(board: Target) -> str:
    """Return the name of the sources of an image, those of a custom board among them, as in HELLO."""
    own = [] if board.root is None else [(board.root / source).read_bytes() for source in board.sources]
    return source_hash(board.estimator, *own)


def _common(made: Path, build: str) -> list[str]:
    """Return the options; ``made`` is the folder of the generated sources."""
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


def _core_sources(made: Path) -> list[Path]:
    """Return the sources of the core, those generated among them."""
    return [*(FIRMWARE / "core" / name for name in CORE), *(made / name for name in TICK)]


def _write(folder: Path, files: Mapping[str, str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def build_image(
    target: str | Target,
    out: Path,
    *,
    baud: int | None = None,
    generated: Mapping[str, str] | None = None,
) -> Path:
    """Build the ELF image of a board.

    Args:
        target: a key of ``TARGETS``, or a board that is not in the package (`boards.read_board`).
        out: folder for ``<target>.elf``.
        baud: another rate than the board's 115200.
        generated: sources by file name in place of the usual ones (`tick_c.sources_for`).

    Raises:
        UnsupportedError: unknown target, or the compiler refused the sources.
        MissingExtraError: no cross compiler.
    """
    if isinstance(target, str) and target not in TARGETS:
        raise UnsupportedError(f"unknown board {target!r}; allowed: {', '.join(TARGETS)}")
    board = TARGETS[target] if isinstance(target, str) else target
    name = target if isinstance(target, str) else board.folder
    boards = FIRMWARE / "boards"
    root = board.root or boards / board.folder
    common = ("memory.c", "main.c", "limits.c", "defaults.c", "start.c", "systick.c")
    sources = [*(boards / source for source in common), *(root / source for source in board.sources)]
    image = out / f"{name}.elf"
    out.mkdir(parents=True, exist_ok=True)
    places = {
        "FLASH_ORIGIN": board.flash[0],
        "FLASH_SIZE": board.flash[1],
        "RAM_ORIGIN": board.ram[0],
        "RAM_SIZE": board.ram[1],
    }
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        _write(made, tick_sources(board.estimator) | dict(generated or {}))
        sources += [boards / file for file in board.extra] + _core_sources(made)
        _run(
            [
                compiler(board.compiler, board.install),
                *_common(made, build_name(board)),
                *board.cpu,
                *EXACT_FLOAT,  # whatever the flags of a custom board
                *board.defines,
                *([f"-DBOARD_BAUD={baud}u"] if baud else []),
                f"-I{boards}",
                f"-I{root}",
                *("-idirafter", str(boards / "library")),
                *([f"-ffile-prefix-map={root}=board"] if board.root else []),
                "-fno-tree-loop-distribute-patterns",
                "-ffunction-sections",
                "-fdata-sections",
                "-fno-common",
                "-g0",
                "-nostdlib",
                "-Wl,--gc-sections,--build-id=none,--no-warn-rwx-segments",
                *(f"-Wl,--defsym={place}={value:#x}" for place, value in places.items()),
                f"-T{boards / 'link.ld'}",
                *map(str, sources),
                "-lgcc",
                "-o",
                str(image),
            ]
        )
    return image


def build_host(
    out: Path,
    *,
    cc: str = "gcc",
    flags: tuple[str, ...] = (),
    estimator: str = "fused",
    figures: RuntimeFigures | None = None,
) -> Path:
    """Build the portable core as a shared library (``libavc.so``) for tests.

    Args:
        out: folder of the library.
        cc: the compiler.
        flags: further ones, for sanitizers.
        estimator: method.
        figures: in place of the generated ones, for the same estimator.

    Raises:
        MissingExtraError: no compiler.
    """
    out.mkdir(parents=True, exist_ok=True)
    library = out / "libavc.so"
    made = out / "generated"
    _write(made, tick_sources(estimator))
    if figures is not None:
        limits = BoardLimits(figures.sample_time_s, figures.metres_per_count)
        _write(made, constants_sources(figures) | {MADE_FOR: made_for(limits)})
    sources = [*_core_sources(made), FIRMWARE / "boards" / "host" / "board.c"]
    _run(
        [
            compiler(cc, HOST_INSTALL),
            *_common(made, source_hash(estimator)),
            *flags,
            "-fPIC",
            "-shared",
            *map(str, sources),
            "-o",
            str(library),
        ]
    )
    return library


def build_fuzzer(
    out: Path,
    *,
    cc: str = "clang",
    replay: bool = False,
    estimator: str = "zero-crossing",
    defines: tuple[str, ...] = (),
) -> Path:
    """Build the fuzzer of the link with address and undefined-behaviour sanitizers.

    Args:
        out: folder of the program.
        cc: clang; for ``replay`` gcc will do.
        replay: a program that runs the files named as arguments instead of searching.
        estimator: method.
        defines: compiler definitions, for another capacity.
    """
    out.mkdir(parents=True, exist_ok=True)
    program = out / ("replay" if replay else "fuzz")
    sanitize = "-fsanitize=address,undefined" if replay else "-fsanitize=fuzzer,address,undefined"
    extra = ["-DAVC_FUZZ_REPLAY"] if replay else []
    made = out / "generated"
    _write(made, tick_sources(estimator))
    sources = [*_core_sources(made), FIRMWARE / "fuzz" / "fuzz.c"]
    _run(
        [
            compiler(cc, HOST_INSTALL),
            *_common(made, source_hash(estimator)),
            *defines,
            *("-g", sanitize, "-fno-sanitize-recover=all"),
            *extra,
            *map(str, sources),
            *("-o", str(program)),
        ]
    )
    return program


def main(argv: list[str] | None = None) -> int:
    """Build the named targets."""
    parser = argparse.ArgumentParser(prog="python -m avc_hardware.codegen.build", description=main.__doc__)
    parser.add_argument(
        "targets",
        nargs="*",
        default=[],
        help=f"host, fuzz, generate (the tick's C, to be read), {', '.join(TARGETS)}; default: the packaged image",
    )
    parser.add_argument("--out", type=Path, help="folder of what is made; default: that of the packaged image")
    arguments = parser.parse_args(argv)
    for target in arguments.targets or [IMAGE.stem]:
        out = arguments.out or IMAGE.parent
        if target == "generate":
            if arguments.out is None:
                parser.error("generate needs --out DIR, for a folder for each estimator")
            for estimator in ESTIMATOR_NUMBERS:
                _write(out / estimator, tick_sources(estimator))
            continue
        if target == "host":
            image = build_host(out)
        elif target == "fuzz":
            image = build_fuzzer(out)
        else:
            image = build_image(target, out)
        digest = hashlib.sha256(image.read_bytes()).hexdigest()
        sys.stdout.write(f"{image} {image.stat().st_size} bytes sha256 {digest}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
