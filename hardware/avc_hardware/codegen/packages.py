"""Packaging of exported C: libraries of build systems, examples in C++.

A comment and a name in generated C are made of allowed characters alone, so that no text becomes code.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import avc_casadi
from avc_casadi import InputError
from avc_casadi._util.units import FORCE, NEWTON, Wording

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


# Excludes *, \ and ?: without them no comment ends or begins, no line continues in the next, and there is no trigraph.
_FOREIGN = re.compile(r"[^A-Za-z0-9 .,:;()\[\]+=<>%_'/-]")
# Lower case, since macros have its name in capitals; a linker of C99 distinguishes 31 characters.
_NAME = re.compile(r"[a-z]([a-z0-9_]{0,18}[a-z0-9])?")
# Everything generated begins with the name, and two things of it may meet what a program includes: NAME.h a header of C
# or of a platform, and NAME_t and its functions a type of these.
_HEADERS = (
    "arduino assert avr complex ctype endian errno fenv fcntl float haply inttypes iso646 limits locale main malloc "
    "math memory poll pthread sched semaphore setjmp signal stdalign stdarg stdatomic stdbool stddef stdint stdio "
    "stdlib stdnoreturn string strings termios tgmath threads time uchar unistd wchar wctype"
)
_TYPES = (
    "blkcnt blksize clock clockid cnd dev div double fexcept fpos gid id imaxdiv ino intmax intptr key ldiv lldiv "
    "max_align mbstate mode mtx nlink nullptr off pid ptrdiff quad register rsize sem sig_atomic siginfo sigset size "
    "ssize stack suseconds thrd thrd_start timer tss tss_dtor ucontext uid uintmax uintptr useconds wctrans wint"
)
_TAKEN = re.compile(
    rf"{'|'.join(f'{_HEADERS} {_TYPES}'.split())}|u?_?int(_fast|_least)?[0-9]+|char[0-9]+|(atomic|pthread)_.*"
)
_WIDTH = 115


def comment(text: str) -> str:
    """Return any text as one line of a comment; other characters become an underscore."""
    return _FOREIGN.sub("_", " ".join(text.split()))


def comment_lines(text: str) -> str:
    """Return any text as lines of a comment, each after the first behind an asterisk."""
    return "\n * ".join(textwrap.wrap(comment(text), _WIDTH))


def checked_name(name: str) -> str:
    """Return the prefix of the names of an exported coupling.

    Raises:
        InputError: it is no valid prefix in C, or what is generated meets a header or a type of C.
    """
    if not _NAME.fullmatch(name):
        told = f"is {name!r}; allowed: a small letter, then small letters and digits with low lines between, at most 20"
        raise InputError.of(told, key="name")
    if _TAKEN.fullmatch(name):
        told = f"is {name!r}; {name}.h or {name}_t is of C or of a platform already; allowed: another, as my_{name}"
        raise InputError.of(told, key="name")
    return name


_WAY = Wording("along the handle's way", "of the handle's angle")
_FOLDER = Path(__file__).resolve().parent.parent / "packaging"
_SKETCH = {"examples/wall/wall.ino": "wall.ino"}
# Further files for a registry; the license is that of the project, whose text the C consists of.
_PUBLISHED = {"README.md": "library.md", "LICENSE": "LICENSE", **_SKETCH}
_WALL = {"examples/avc_coupling_wall.hpp": "avc_coupling_wall.hpp"}
# For each package, path and source name of its files.
_FILES = {
    "arduino": {"library.properties": "library.properties", "keywords.txt": "keywords.txt", **_PUBLISHED},
    "platformio": {"library.json": "library.json", **_PUBLISHED},
    "cmake": {"CMakeLists.txt": "CMakeLists.txt"},
    "esp-idf": {"CMakeLists.txt": "CMakeLists.txt", "idf_component.yml": "idf_component.yml"},
    "zephyr": {"zephyr/module.yml": "zephyr_module.yml", "zephyr/CMakeLists.txt": "zephyr_CMakeLists.txt"},
    "chai3d": {"examples/chai3d.cpp": "chai3d.cpp", **_WALL},
    "openhaptics": {"examples/openhaptics.cpp": "openhaptics.cpp", **_WALL},
    "haply": {"examples/haply.cpp": "haply.cpp", **_WALL},
}
PACKAGES = tuple(_FILES)
# Defaults of the sketch: encoder step and force at full duty, at the handle.
_USUAL_STEP_M, _USUAL_FORCE_N = 2e-5, 10.0
_OF_A_LINE = ("chai3d", "openhaptics", "haply")


def packaged(files: dict[str, str], coupling: Coupling, packages: Iterable[str]) -> dict[str, str]:
    """Put an exported coupling into packages.

    Args:
        files: header and source, by name.
        coupling: in these files.
        packages: of `PACKAGES`; none leaves the files as they are.

    Returns:
        All files by their path with ``/``: header and source in ``src``, the packages' own beside.

    Raises:
        InputError: an unknown package, or an example of a linear device with a rotary one.
    """
    wanted = list(packages)
    unknown = [name for name in wanted if name not in _FILES]
    if unknown:
        names = ", ".join(repr(name) for name in unknown)
        raise InputError.of(f"holds {names}; allowed: {', '.join(PACKAGES)}", key="packages")
    lines = [name for name in wanted if name in _OF_A_LINE]
    if lines and not coupling.problem.units.linear:
        allowed = ", ".join(name for name in PACKAGES if name not in _OF_A_LINE)
        message = f"holds {', '.join(lines)}, an example for a handle that moves in lines; allowed: {allowed}"
        raise InputError.of(message, key="packages")
    if not wanted:
        return files
    device, force = coupling.problem.device, coupling.max_force_n
    made = {f"src/{name}": text for name, text in files.items()}
    known = {
        "@ID@": coupling.id,
        "@PERIOD_US@": f"{1e6 * coupling.sample_time_s:.7g}",
        "@VERSION@": avc_casadi.__version__,
        "@PER_COUNT@": f"{device.encoder_resolution_m or _USUAL_STEP_M / device.metres_per_unit:.7g}",
        "@FORCE@": str(FORCE),
        "@WAY@": str(_WAY),
        "@FULL_DUTY@": f"{force or _USUAL_FORCE_N * device.metres_per_unit:.7g}",
        "@LIMITED@": "has no limit: limit it yourself" if force is None else f"limited at {force:.7g} {NEWTON}",
        "@LARGEST@": "a guess, since none is declared" if force is None else "the largest that is declared",
    }
    for package in wanted:
        for place, template in _FILES[package].items():
            text = (_FOLDER / template).read_text(encoding="utf-8")
            for mark, value in known.items():
                text = text.replace(mark, value)
            made[place] = text
    return made
