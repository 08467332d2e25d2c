"""Packaging of exported C: libraries of build systems, examples in C++, gains of several axes.

A comment and a name in generated C are made of allowed characters alone, so that no text becomes code.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
        InputError: an unknown package, or an example of an arm with a rotary device.
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


def arm_gains_c(document: Mapping[str, Any]) -> dict[str, str]:
    """Return header and example by name.

    Args:
        document: JSON values of ``avc_casadi.arm.design.gains_document``.

    Returns:
        ``avc_arm_gains.h``, C99 and C++11, and for a device in space ``chai3d_arm.cpp``.
    """
    files = {"avc_arm_gains.h": _header(document)}
    if len(document["axes"]) == 3:
        files["chai3d_arm.cpp"] = (_FOLDER / "chai3d_arm.cpp").read_text(encoding="utf-8")
    return files


def _header(document: Mapping[str, Any]) -> str:
    regions, directions = document["regions"], document["directions"]
    claim = document["claim"]
    arm, axes, limit = comment(document["arm"]), comment(", ".join(document["axes"])), document["max_force_n"]
    tables = {
        "stiffness_n_per_m": [region["stiffness_n_per_m"] for region in regions],
        "damping_ns_per_m": [region["damping_ns_per_m"] for region in regions],
    }
    along = {
        key: [region[key] for region in regions] for key in ("tangent_stiffness_n_per_m", "tangent_damping_ns_per_m")
    }
    size = "[AVC_ARM_REGIONS][AVC_ARM_DIRECTIONS]"
    return "\n".join(
        [
            f"/* Spring and damper of {arm} by place of the tip and contact normal; axes {axes}.",
            " *",
            " * Force on the device along the normal: -K (x - proxy) - D (x - x_before)/T, once every sample time T;",
            " * along the surface, while a proxy holds the tip there, the same with the tangent's gains.",
            f" * Frozen loop in space: stable up to {claim['factor']:.4g} times these gains with all that a search",
            " * looked at; no proof. Within a contact keep the gains of the first touch: changes were not looked at.",
            " */",
            "#ifndef AVC_ARM_GAINS_H",
            "#define AVC_ARM_GAINS_H",
            "",
            f"#define AVC_ARM_AXES {len(document['axes'])}",
            f"#define AVC_ARM_REGIONS {len(regions)}",
            f"#define AVC_ARM_DIRECTIONS {len(directions)}",
            f"#define AVC_ARM_SAMPLE_TIME_S {document['sample_time_s']!r}",
            f"#define AVC_ARM_HOME_TIP_M {_values(document['home_tip_m'])}",
            *([] if limit is None else [f"#define AVC_ARM_MAX_FORCE_N {limit!r}"]),
            "",
            f"static const double avc_arm_low_m[AVC_ARM_AXES] = {_values(document['low_m'])};",
            f"static const double avc_arm_high_m[AVC_ARM_AXES] = {_values(document['high_m'])};",
            f"static const int avc_arm_region_counts[AVC_ARM_AXES] = {_values(document['region_counts'])};",
            f"static const double avc_arm_directions[AVC_ARM_DIRECTIONS][AVC_ARM_AXES] = {_values(directions)};",
            *(f"static const double avc_arm_{key}{size} = {_values(rows)};" for key, rows in tables.items()),
            *(f"static const double avc_arm_{key}[AVC_ARM_REGIONS] = {_values(row)};" for key, row in along.items()),
            "",
            _LOOK_UP,
        ]
    )


def _values(value: Any) -> str:
    if isinstance(value, list):
        return f"{{{', '.join(map(_values, value))}}}"
    return repr(value)


_LOOK_UP = """\
typedef struct {
    double stiffness_n_per_m, damping_ns_per_m, tangent_stiffness_n_per_m, tangent_damping_ns_per_m;
} avc_arm_gains_t;

/* tip_m: place of the tip in the arm's coordinates. normal: of the surface, of either sign. */
static inline avc_arm_gains_t avc_arm_gains(const double *tip_m, const double *normal)
{
    avc_arm_gains_t gains;
    int region = 0, nearest = 0, axis, direction;
    double most = -1.0;
    for (axis = 0; axis < AVC_ARM_AXES; axis++) {
        const double share = (tip_m[axis] - avc_arm_low_m[axis]) / (avc_arm_high_m[axis] - avc_arm_low_m[axis]);
        const int count = avc_arm_region_counts[axis];
        int cell = 0;
        while (cell < count - 1 && share * count >= cell + 1) {
            cell++;
        }
        region = region * count + cell;
    }
    for (direction = 0; direction < AVC_ARM_DIRECTIONS; direction++) {
        double along = 0.0;
        for (axis = 0; axis < AVC_ARM_AXES; axis++) {
            along += avc_arm_directions[direction][axis] * normal[axis];
        }
        along = along < 0.0 ? -along : along;
        if (along > most) {
            most = along;
            nearest = direction;
        }
    }
    gains.stiffness_n_per_m = avc_arm_stiffness_n_per_m[region][nearest];
    gains.damping_ns_per_m = avc_arm_damping_ns_per_m[region][nearest];
    gains.tangent_stiffness_n_per_m = avc_arm_tangent_stiffness_n_per_m[region];
    gains.tangent_damping_ns_per_m = avc_arm_tangent_damping_ns_per_m[region];
    return gains;
}

#endif
"""
