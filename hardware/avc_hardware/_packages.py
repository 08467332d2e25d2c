"""What stands round an exported coupling: libraries for Arduino, PlatformIO and CMake, and examples in C++."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import avc_casadi
from avc_casadi import InputError

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

_FOLDER = Path(__file__).resolve().parent / "packaging"
_SKETCH = {"examples/wall/wall.ino": "wall.ino"}
_WALL = {"examples/avc_wall.hpp": "avc_wall.hpp"}
# Of each package, where a file goes and what it is called in the folder above.
_FILES = {
    "arduino": {"library.properties": "library.properties", **_SKETCH},
    "platformio": {"library.json": "library.json", **_SKETCH},
    "cmake": {"CMakeLists.txt": "CMakeLists.txt"},
    "chai3d": {"examples/chai3d.cpp": "chai3d.cpp", **_WALL},
    "openhaptics": {"examples/openhaptics.cpp": "openhaptics.cpp", **_WALL},
    "haply": {"examples/haply.cpp": "haply.cpp", **_WALL},
}
PACKAGES = tuple(_FILES)
# Of the sketch, where the device says nothing: the encoder's step and the force at full duty, at the handle.
_USUAL_STEP_M, _USUAL_FORCE_N = 2e-5, 10.0
_OF_A_LINE = ("chai3d", "openhaptics", "haply")


def packaged(files: dict[str, str], coupling: Coupling, packages: Iterable[str]) -> dict[str, str]:
    """Put an exported coupling into packages.

    Args:
        files: header and source, by name.
        coupling: what they hold.
        packages: of `PACKAGES`; none leaves the files as they are.

    Returns:
        All files by their path with ``/``: header and source in ``src``, the packages' own beside.

    Raises:
        InputError: an unknown package, or an example for an arm of a device that turns.
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
    device = coupling.problem.device
    made = {f"src/{name}": text for name, text in files.items()}
    known = {
        "@ID@": coupling.id,
        "@PERIOD_US@": f"{1e6 * coupling.sample_time_s:.7g}",
        "@VERSION@": avc_casadi.__version__,
        "@PER_COUNT@": f"{device.encoder_resolution_m or _USUAL_STEP_M / device.metres_per_unit:.7g}",
        "@FULL_DUTY@": f"{coupling.max_force_n or _USUAL_FORCE_N * device.metres_per_unit:.7g}",
    }
    for package in wanted:
        for place, template in _FILES[package].items():
            text = (_FOLDER / template).read_text(encoding="utf-8")
            for mark, value in known.items():
                text = text.replace(mark, value)
            made[place] = text
    return made
