"""Shared parts of the two exports of couplings to another end: verdict and fading force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from avc_casadi import NotDeployableError
from avc_hardware.codegen.c_frame import FRAME

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import ToolGains
    from avc_casadi.simulation.emit import Precision

FADE_S = 0.05
"""Fade time of a force, down and up: long for a sample, short for a hand."""

_EASED = """\
/* What is left of a force that fades; 0 where it is no number. */
static {real} left_of({real} force_n, unsigned long faded, unsigned long fade)
{{
    if (!within(force_n, {largest})) {{
        return {zero};
    }}
    return faded == 0ul ? force_n : force_n * (({real})(fade - faded) / ({real})fade);
}}

/* A force that is no larger than another, and in no other direction. */
static {real} no_more({real} force_n, {real} than_n)
{{
    const {real} low = than_n < {zero} ? than_n : {zero}, high = than_n > {zero} ? than_n : {zero};
    return force_n < low ? low : (force_n > high ? high : force_n);
}}

/* The force to give where the law asks for one. While something is wrong it fades and never grows, although a spring
 * that has lost its damper may ask for more; then it comes back from where it was. */
static {real} eased(avc_coupling_t *coupling, {real} asked_n, int sound, unsigned long fade)
{{
    const {real} last_n = coupling->force_n;
    unsigned long faded = coupling->faded;
    asked_n = left_of(asked_n, 0ul, fade);
    if (sound) {{
        faded -= faded > 0ul ? 1ul : 0ul;
        if (coupling->fading != 0u && (asked_n < {zero} || asked_n > {zero})) {{
            const unsigned long kept =
                (unsigned long)(({real})fade * (no_more(asked_n, last_n) / asked_n) + {one_and_a_half});
            faded = kept + faded < fade ? fade - kept : faded;
        }}
    }} else {{
        faded += faded < fade ? 1ul : 0ul;
    }}
    coupling->faded = faded;
    coupling->fading = !sound;
    coupling->force_n = left_of(asked_n, faded, fade);
    if (!sound) {{
        coupling->force_n = no_more(coupling->force_n, last_n);
    }}
    return coupling->force_n;
}}
"""


class Loops(Protocol):
    """All loops of a problem."""

    def __len__(self) -> int:
        """Number of loops."""

    def stable_over_ranges(self, gains: ToolGains) -> bool:
        """Whether every loop is stable, the worst that a search of the ranges finds included."""

    def radius(self, gains: ToolGains) -> tuple[float, Any]:
        """Return the largest spectral radius and its loop."""


def verdict(problem: Problem, loops: Loops, gains: ToolGains, *, unsafe: bool, also: str = "") -> str:
    """Judge gains on the loops of their own problem, independent of any certificate; return a sentence."""
    if loops.stable_over_ranges(gains):
        return f"deployable: all {len(loops)} loops are linearly stable, with every hand of [hands] and released{also}"
    radius, case = loops.radius(gains)
    who = "with a hand" if any(case.hand.values()) else "released"
    why = f"not deployable: linearly unstable {who}, spectral radius {radius:.6g}"
    if not unsafe:
        raise NotDeployableError(f"{problem.name}: {why}. Make it again: avc recommend P --out FILE")
    return f"UNSAFE, written by request: {why}"


def eased_c(precision: Precision) -> str:
    """Return the force that fades as functions of C: ``left_of``, ``no_more`` and ``eased``; they follow ``within``."""
    literal = precision.literal
    return _EASED.format(
        **FRAME,
        real=precision.c_type,
        zero=literal(0.0),
        one_and_a_half=literal(1.5),
        largest=literal(precision.largest),
    )
