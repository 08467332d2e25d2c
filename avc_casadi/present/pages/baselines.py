"""A recommendation beside other control laws on the same device: a row each."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.quantity import percent, quantity
from avc_casadi._util.units import FORCE, M_PER_S
from avc_casadi.present.pages.subject import headline
from avc_casadi.present.terminal import Mark, Page, Row
from avc_casadi.recommendation.baselines import DIFFERENCE, GUARDED, PASSIVE
from avc_casadi.recommendation.ripple import SPEEDS_M_PER_S

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

_NAMES = {
    DIFFERENCE: "Difference",
    "first-order": "Low pass",
    "kalman": "Kalman filter",
    "foaw": "FOAW",
    "levant": "Levant",
    GUARDED: "PO/PC",
    PASSIVE: "Static, passive",
}
_TOLD_HZ = ("1", "10")


def baselines_page(document: dict[str, Any], problem: Problem, page: Page, shown: str = "P") -> str:
    """Return the `recommend --compare` document as a headline and a row for each law.

    Args:
        document: of `avc recommend --compare --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
    """
    rows = [_recommended(document, problem), *(_row(one, problem) for one in document["baselines"])]
    what = "stiffest wall with which all hands settle without friction (its damping), impedance error at 1 and 10 Hz,"
    slowly = quantity(SPEEDS_M_PER_S[0] / problem.device.metres_per_unit, M_PER_S)
    more = f"ripple of the {FORCE} at {slowly}; how many settle at the wall that is asked for"
    rows.append(Row("Told", f"{what} {more}"))
    return page.rendered(headline(problem, shown), rows, [f"avc recommend {quote(shown)}"])


def _recommended(document: dict[str, Any], problem: Problem) -> Row:
    if not document["deployable"]:
        return Row("Recommended", document["reason"], Mark.FAIL)
    felt, trial = document["felt"], document["trial"]
    noise = next(iter(felt["ripple"]["force_n"].values()))
    told = _rendered(felt["stiffness_n_per_m"], felt["complex_error"], noise, problem)
    free, hands = trial["at_rest_without_friction"], trial["hands"]
    return Row("Recommended", f"{told}; {free} of {hands}", Mark.PASS if free == hands else Mark.CAUTION)


def _row(one: dict[str, Any], problem: Problem) -> Row:
    cutoff = one["settings"].get("cutoff_hz")
    label = _NAMES.get(one["law"], one["law"]) + ("" if cutoff is None else f" {quantity(cutoff, 'Hz')}")
    at_wall = f"{one['settled_at_wall']} of {one['hands']}"
    if one["stiffness_n_per_m"] == 0:
        nothing = "renders nothing" if one["law"] == PASSIVE else f"no wall down to a 256th; {at_wall}"
        return Row(label, nothing, Mark.FAIL)
    told = _rendered(one["stiffness_n_per_m"], one["error"], one["ripple_n"], problem, one["damping_ns_per_m"])
    if one["law"] == PASSIVE:
        at_wall = f"{one['settled']} of {one['hands']}"
    nearly = 0.99 * problem.environment.stiffness_n_per_m
    whole = one["settled_at_wall"] == one["hands"] and one["stiffness_n_per_m"] >= nearly
    return Row(label, f"{told}; {at_wall}", Mark.PASS if whole else Mark.CAUTION)


def _rendered(
    stiffness_n_per_m: float,
    error: dict[str, float],
    ripple_n: float,
    problem: Problem,
    damping_ns_per_m: float | None = None,
) -> str:
    unit = problem.units.unit
    errors = ", ".join(percent(error[hz]) for hz in _TOLD_HZ if hz in error)
    damping = "" if damping_ns_per_m is None else f" ({quantity(damping_ns_per_m, unit('N.s/m'))})"
    return (
        f"{quantity(stiffness_n_per_m, unit('N/m'))}{damping}, error {errors}, ripple {quantity(ripple_n, unit('N'))}"
    )
