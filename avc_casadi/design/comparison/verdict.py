"""The verdict at each frequency: the better method, and why they differ."""

from __future__ import annotations

from enum import StrEnum

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.schedule import GainSchedule, Status

# Two methods agree when their magnitude errors differ by less than this share of |Z_d| + |H Z_ds|: the NLP stays
# strictly inside (12) while the projection stands on it, and the error moves much faster than Re Z_h along it.
AGREEMENT = 1e-8


class Verdict(StrEnum):
    """The verdict at one frequency; the first of this list that applies.

    The optimiser cannot be compared where it has no gains, nor the closed form where it is not realisable; a difference
    in error precedes a gain at its limit.
    """

    INFEASIBLE = "infeasible"
    CLOSED_FORM_NOT_REALISABLE = "closed-form-not-realisable"
    DIRECT_BETTER = "direct-better"
    BOUND_ACTIVE = "bound-active"
    AGREE = "agree"


def judge(
    closed_form: GainSchedule, optimum: GainSchedule, scale: FloatArray
) -> tuple[tuple[Verdict, ...], tuple[str, ...]]:
    """Judge every frequency.

    Args:
        closed_form: the paper's projection.
        optimum: the solution of (11)-(12), by `direct` or `exact`.
        scale: |Z_d| + |H Z_ds|, N.s/m, shape (n,): reference of the relative tolerance of agreement.

    Returns:
        Verdicts and reasons, each of length n.
    """
    rows = range(optimum.rows)
    better = closed_form.magnitude_error > optimum.magnitude_error + AGREEMENT * scale
    verdicts = tuple(_verdict(closed_form.status[row], optimum.status[row], bool(better[row])) for row in rows)
    reasons = tuple(_reason(verdicts[row], closed_form, optimum, row) for row in rows)
    return verdicts, reasons


def _verdict(closed_form: Status, optimum: Status, better: bool) -> Verdict:
    if not optimum.has_gains:
        return Verdict.INFEASIBLE
    if not closed_form.has_gains:
        return Verdict.CLOSED_FORM_NOT_REALISABLE
    if better:
        return Verdict.DIRECT_BETTER
    return Verdict.BOUND_ACTIVE if optimum is Status.ACTIVE_BOUND else Verdict.AGREE


def _reason(verdict: Verdict, closed_form: GainSchedule, optimum: GainSchedule, row: int) -> str:
    method, error = optimum.method, f"{optimum.magnitude_error[row]:.3g}"
    if verdict is Verdict.INFEASIBLE:
        return optimum.reason[row] or f"{method} found no gains"
    if verdict is Verdict.CLOSED_FORM_NOT_REALISABLE:
        return f"the closed form {closed_form.reason[row]}; {method} reaches a magnitude error of {error}"
    if verdict is Verdict.DIRECT_BETTER:
        left = f"{closed_form.magnitude_error[row]:.3g}"
        if optimum.structure == "damped":
            return f"the contact damper leaves out the virtual mass: an error of {left}; {method} reaches {error}"
        return f"the projection keeps Im Z_h_ds and leaves a magnitude error of {left}; {method} reaches {error}"
    if verdict is Verdict.BOUND_ACTIVE:
        return f"same error; {optimum.reason[row] or f'{method} stands on a bound of the gain box'}"
    return f"both reach a magnitude error of {error}"
