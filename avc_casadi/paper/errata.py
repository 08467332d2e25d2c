"""Errata and open assumptions of the printed paper, as data for the command line and the report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperError:
    """An error of the printed paper: where it stands, as printed and corrected, and what it does."""

    equation: str
    as_printed: str
    correct: str
    effect: str


PAPER_ERRORS: tuple[PaperError, ...] = tuple(
    PaperError(equation, printed, correct, effect)
    for equation, printed, correct, effect in (
        (
            "(2), (7)",
            "s = (z-1)/T_z",
            "s = (z-1)/(T z), the backward difference",
            "no T_z is defined; read as T it is the forward difference: the spring adds -k T/2 to Re, not +k T/2",
        ),
        (
            "(10), (17)",
            "s = T(z-1)/(2(z+1))",
            "s = 2(z-1)/(T(z+1)), Tustin",
            "s is T^2/4 times the right one: the desired wall of (10) comes out 4/T^2 times too stiff",
        ),
        (
            "(17)",
            "Tustin",
            "the backward difference that defines the coupling in (7)",
            "b comes out k T/2 too large",
        ),
        ("(17)", "no formula for k", "k = -Im(Z_avc) |s|^2/Im(s)", "the stiffness cannot be computed"),
        (
            "(13)",
            "second denominator without max",
            "Re Z = max(Re Z_h_ds, 0), Im Z = Im Z_h_ds",
            "the term is identically 1 and leaves Im Z undetermined",
        ),
        (
            "(13)",
            "the case does not name the real part that it tests",
            "case 1: Re Z_h_ds >= 0; case 2: Re Z_h_ds < 0",
            "the wrong case is taken where Re Z_h and Re Z_h_ds differ in sign",
        ),
        ("text", "equation (25)", "equation (12), the passivity constraint", "there is no (25)"),
    )
)
"""Errors of the printed paper."""

ASSUMPTIONS = (
    (
        "hold H",
        "(z+1)/(2z) in the model 'paper', 1/z (the force held for T) in 'sampled-data'; both times z^-delay",
    ),
    ("device Z_d", "m s + b_d with Tustin's s, so that Re Z_d = b_d"),
    (
        "environment Z_e and bounds U, L",
        "b + k/s with Tustin's s in the model 'paper', the backward difference in the model 'sampled-data'",
    ),
    ("device values", "mass, damping, sample time, delay: those of the problem file"),
    ("realistic bounds U, L", "those of the problem file; the desired impedance is their mean"),
    ("gain box", "the admissible b and k of the problem file; the paper sets no limits"),
)
"""Assumptions on which results depend and that the paper does not state, with what is assumed."""
