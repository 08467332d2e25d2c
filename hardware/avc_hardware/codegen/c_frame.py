"""What every export as C has: precision and names, the frame of header and source."""

from __future__ import annotations

import hashlib
import re
import textwrap
from typing import TYPE_CHECKING

from avc_casadi import InputError
from avc_casadi.simulation.emit import DOUBLE, PRECISIONS, Precision

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.claims.judged_for import JudgedFor
    from avc_casadi.model.problem import Problem

NAME = "avc_coupling"
HEADER = f"{NAME}.h"
SOURCE = f"{NAME}.c"

NS_PER_S = 1e9

_DIGEST = "DIGEST_OF_BOTH"
"""Stands in both files until their digest is known."""
_DIGEST_DIGITS = 16
"""Hexadecimal digits of a digest: the 64 bits that a preprocessor of C99 compares."""

FRAME = {
    "digest": f"""\
/* Of this header and its source: a source of another coupling does not compile with it. */
#define AVC_COUPLING_DIGEST {_DIGEST}""",
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

_SAME_COUPLING = f"""\
#if AVC_COUPLING_DIGEST != {_DIGEST}
#error "header and source are of two couplings, as after an export that was cut off: export both again"
#endif

"""
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
    """Return a precision by name; InputError for another, or for a name of files that C cannot have."""
    if precision not in PRECISIONS:
        raise InputError.of(f"is {precision!r}; allowed: {', '.join(PRECISIONS)}", key="precision")
    # Lower case, since macros have its name in capitals; a linker of C99 distinguishes 31 characters.
    if not re.fullmatch(rf"(?!({_OF_C})$)[a-z]([a-z0-9_]{{0,18}}[a-z0-9])?", name):
        fault = (
            f"is {name!r}; allowed: a small letter, then small letters, digits and inner underscores, at most 20 in all"
        )
        raise InputError.of(f"{fault}, and no header or type of C such as math or size", key="name")
    return PRECISIONS[precision]


def compiler_checks(precision: Precision) -> str:
    """Return what a source asks of its compiler: its own header, no -ffast-math, doubles of 64 bits."""
    return _SAME_COUPLING + _NO_FAST_MATH + (_WIDE_ENOUGH if precision is DOUBLE else "")


def header_and_source(header: str, source: str) -> dict[str, str]:
    """Return both files by name, with the digest of both in each, which the source compares when it is compiled."""
    digest = hashlib.sha256(f"{header}\0{source}".encode()).hexdigest()[:_DIGEST_DIGITS]
    literal = f"0x{digest}ULL"
    return {HEADER: header.replace(_DIGEST, literal), SOURCE: source.replace(_DIGEST, literal)}


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


def judged_for(scope: JudgedFor) -> str:
    """Return for which hands and margin a verdict is, as lines of a comment in the units of the device."""
    return comment_lines(f"judged for {scope.sentence}")


def comment_lines(text: str) -> str:
    """Return any text as lines of a comment, each after the first behind an asterisk."""
    return "\n * ".join(textwrap.wrap(comment(text), 115))
