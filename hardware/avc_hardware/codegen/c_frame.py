"""What every export as C has: precision and names, the frame of header and source, what is believed of a position."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from avc_casadi import InputError
from avc_casadi.simulation.emit import DOUBLE, PRECISIONS, Precision
from avc_hardware.codegen.figures import actuator_m_per_s2, board_limits

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem

NAME = "avc_coupling"
HEADER, SOURCE = f"{NAME}.h", f"{NAME}.c"

FRAME = {
    "loop": """\
/* Define AVC_LOOP_SAMPLE_TIME_NS as your loop's own, and a coupling for another one does not compile. */
#ifdef AVC_LOOP_SAMPLE_TIME_NS
#if AVC_LOOP_SAMPLE_TIME_NS != AVC_COUPLING_SAMPLE_TIME_NS
#error "this coupling is made for another sample time than the loop that runs it"
#endif
#endif
""",
    "begin_c": """\
#ifdef __cplusplus
extern "C" {
#endif
""",
    "end_c": """\
#ifdef __cplusplus
}
#endif

#endif
""",
}
"""Frame of a header in templates of C."""

_NO_FAST_MATH = """\
#ifdef __FAST_MATH__
#error "compile without -ffast-math: a position that is not a number must be seen"
#endif
"""
_WIDE_ENOUGH = """
#include <float.h>

#if DBL_MANT_DIG < 53
#error "a double of this compiler has less than 64 bits (avr-gcc): export with --precision single"
#endif
"""


# Headers of C, which a file of the same name hides, and its types that end in _t.
_OF_C = (
    "assert|complex|ctype|errno|fenv|float|inttypes|iso646|limits|locale|math|setjmp|signal|string|tgmath|threads|time|"
    "uchar|wchar|wctype|std(align|arg|atomic|bit|bool|ckdint|def|int|io|lib|noreturn)|size|ptrdiff|"
    "u?int(ptr|max|(_least|_fast)?[0-9]+)"
)


def checked(precision: str, name: str) -> Precision:
    """Return a precision by name."""
    if precision not in PRECISIONS:
        raise InputError.of(f"is {precision!r}; allowed: {', '.join(PRECISIONS)}", key="precision")
    # Lower case, since macros have its name in capitals; a linker of C99 distinguishes 31 characters.
    if not re.fullmatch(rf"(?!({_OF_C})$)[a-z]([a-z0-9_]{{0,18}}[a-z0-9])?", name):
        told = f"is {name!r}; allowed: a small letter, then small letters and digits with low lines between, at most 20"
        raise InputError.of(f"{told}, and no header or type of C such as math or size", key="name")
    return PRECISIONS[precision]


def compiler_checks(precision: Precision) -> str:
    """Return what a source asks of its compiler: no -ffast-math, and doubles of 64 bits where it has doubles."""
    return _NO_FAST_MATH + (_WIDE_ENOUGH if precision is DOUBLE else "")


def head_words(problem: Problem) -> dict[str, str]:
    """Return what a head comment says of a problem: its name and title, and what names mean where it turns."""
    turns = "It turns: read m as rad, N as N.m, N/m as N.m/rad and N.s/m as N.m.s/rad in names and numbers."
    return {
        "problem": comment(problem.name or "a problem"),
        "title": comment(f": {problem.title}") if problem.title else "",
        "units": "" if problem.units.linear else f"\n * {turns}",
    }


def named(files: Mapping[str, str], name: str) -> dict[str, str]:
    """Return files under a given name, which stands in their text too."""

    def renamed(text: str) -> str:
        return text.replace(NAME, name).replace(NAME.upper(), name.upper())

    return {renamed(file): renamed(text) for file, text in files.items()}


def comment(text: str) -> str:
    """Return any text as one line of a comment; other characters become an underscore."""
    # Excludes *, \ and ?: no comment ends or begins there, no line continues in the next, and there is no trigraph.
    return re.sub(r"[^A-Za-z0-9 .,:;()\[\]+=<>%_'/-]", "_", " ".join(text.split()))


def comment_lines(text: str) -> str:
    """Return any text as lines of a comment, each after the first behind an asterisk."""
    return "\n * ".join(textwrap.wrap(comment(text), 115))


FARTHEST_M = 1e6
"""Larger positions count as infinite, and single precision might end."""


@dataclass(frozen=True)
class SensorBounds:
    """Bounds of a position about its prediction, in the device's own units."""

    fastest_m_per_s: float  # of the handle, by the radius of a rotary one
    jump_m: float  # farthest from the position before; the fastest and a step of the encoder at both ends
    unsure_m: float  # what steps and noise add to a change of movement
    outside_m: float  # largest change of movement outside the wall: by a hand, the last forces, steps and noise
    change_m: float  # the same inside, where actuator and hand act

    @classmethod
    def of(cls, device: Device, *, detents: bool = False) -> Self:
        """Return the bounds of a device; detents move it outside a wall too."""
        time, ranges = device.sample_time_s, device.range
        step = max((device.encoder_resolution_m or 0.0, *(ranges.encoder_resolution_m or ())))
        noise = max((device.position_noise_rms_m, *(ranges.position_noise_rms_m or ())))
        # No hand moves the handle faster: a larger step in a sample is a sensor fault.
        fastest = 10.0 / device.metres_per_unit
        most = board_limits(device).max_acceleration_m_per_s2  # above it the encoder has jumped, as firmware judges
        # No hand accelerates it more outside the wall, where nothing else does: ten times that of a fast tap.
        alone = 100.0 / device.metres_per_unit + actuator_m_per_s2(device)
        outside_m = (most if detents else min(most, alone)) * time**2
        # Two steps of rounding, two of a flickering count; six deviations of a second difference, of sqrt(1 + 4 + 1).
        unsure: float = 4 * step + 15.0 * noise
        if not step:  # at the handle, steps of an undeclared encoder are 50 um or less, and none is a fault
            unsure += max(1e-4 / device.metres_per_unit - outside_m, 0.0)
        return cls(
            fastest_m_per_s=fastest,
            jump_m=fastest * time + 2 * step,
            unsure_m=unsure,
            outside_m=outside_m + unsure,
            change_m=most * time**2 + unsure,
        )
