"""Method `static`: the best constant coupling that a condition on all frequencies allows."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.claims.passivity.sampled_loop import SampledLoop
from avc_casadi.design.constant.static_search import StaticCondition, StaticSearch
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.paper.rows import row_status

if TYPE_CHECKING:
    from avc_casadi.model.problem import Model, Problem

_CONDITIONS = {
    "llewellyn": "Llewellyn (6), any passive environment",
    "all": "passive with this environment at all frequencies",
}


@dataclass(frozen=True)
class StaticCoupling:
    """A constant coupling.

    Attributes:
        condition: llewellyn or all.
        model: hold model of the condition.
        damping_ns_per_m: b.
        stiffness_n_per_m: k.
        contact_damping_ns_per_m: b_p; 0 in the series structure.
        margin_ns_per_m: what the condition leaves to spare; below the margin asked for where nothing meets it.
        error: root of the mean squared relative error over the problem's frequencies, by the problem's objective.
        found: whether the condition is met.
    """

    condition: StaticCondition
    model: Model
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    margin_ns_per_m: float
    error: float
    found: bool

    def sentence(self) -> str:
        """Return one line for people."""
        name = f"{_CONDITIONS[self.condition]}, {self.model} model"
        if not self.found:
            return f"{name}: no constant coupling of the gain box"
        contact = f", b_p = {self.contact_damping_ns_per_m:.6g} N.s/m" if self.contact_damping_ns_per_m else ""
        return (
            f"{name}: b = {self.damping_ns_per_m:.6g} N.s/m, k = {self.stiffness_n_per_m:.6g} N/m{contact}, "
            f"error {100 * self.error:.4g} %"
        )


def static_coupling(
    problem: Problem, condition: StaticCondition = "llewellyn", model: Model | None = None
) -> StaticCoupling:
    """Find the constant coupling with the least mean squared relative error that a condition allows.

    The search is global on a logarithmic grid, then refined from its best cells; only gains that meet the condition
    with its margin, without tolerance, are compared.

    Args:
        problem: the problem; its objective says what counts as error.
        condition: llewellyn: (4) to (6); all: Re Z_h >= margin at all frequencies with the problem's environment.
        model: hold model of the condition; None is the problem's.

    Raises:
        UnsupportedError: a device without damping, for which (6) allows nothing.
    """
    if problem.device.damping_ns_per_m == 0:
        raise UnsupportedError(
            "static needs device.damping_ns_per_m > 0: with 0 neither Llewellyn's condition (6) nor passivity at all "
            "frequencies allows a coupling; use closed-form, exact or direct, which judge one frequency alone",
            key="device.damping_ns_per_m",
        )
    search = StaticSearch(problem, condition, SampledLoop.of(problem, model))
    best, cost = search.run()
    b, k, contact = (float(value) for value in search.gains(best[None])[:, 0])
    margin = float(search.slack(best[None])[0]) + problem.stability.margin_ns_per_m
    return StaticCoupling(
        condition, search.loop.model, b, k, contact, margin, float(np.sqrt(cost)), bool(np.isfinite(cost))
    )


def solve_static(problem: Problem) -> GainSchedule:
    """Solve by a constant coupling under Llewellyn's condition, in the problem's model.

    The notes compare it with the best constant coupling that is passive with this environment alone.

    Raises:
        UnsupportedError: a device without damping.
    """
    started = time.perf_counter()
    certified = static_coupling(problem)
    special = static_coupling(problem, "all")
    n = len(problem.frequencies_hz())
    gains = (certified.damping_ns_per_m, certified.stiffness_n_per_m, certified.contact_damping_ns_per_m)
    b, k, contact = (np.full(n, value) for value in gains)
    if certified.found:
        status, reason = row_status(problem, b, k, contact), ("",) * n
    else:
        status = (Status.INFEASIBLE,) * n
        lacking = problem.stability.margin_ns_per_m - certified.margin_ns_per_m
        why = (
            f"no constant coupling of the gain box meets Llewellyn's condition (6), {certified.model} model: the best, "
            f"b = {b[0]:.6g} N.s/m and k = {k[0]:.6g} N/m, lacks {lacking:.6g} N.s/m of device damping"
        )
        reason = (why,) * n
    return gain_schedule(
        problem,
        "static",
        (b, k, contact),
        status,
        reason=reason,
        solve_seconds=time.perf_counter() - started,
        notes=tuple(f"best constant coupling, {choice.sentence()}" for choice in (certified, special)),
    )
