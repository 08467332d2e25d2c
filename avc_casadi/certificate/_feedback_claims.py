"""The claims of a coupling with state feedback, on its own loop and with any share of the innovation passing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.certificate._certificate import Certificate, Level, LevelResult
from avc_casadi.certificate._feedback_radius import DRAWS, FeedbackRadius, feedback_radius
from avc_casadi.certificate._levels import Rows, level_result, not_judged
from avc_casadi.passivity import passive_limit_n_per_m
from avc_casadi.stability import RADIUS_TOLERANCE, frozen_parts

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


def certify_feedback(coupling: Coupling, draws: int = DRAWS, seed: int = 0) -> Certificate:
    """Certify a coupling with state feedback: L5 on its own loop; L0 to L4 know gains alone and are not judged."""
    gains, problem = coupling.schedule, coupling.problem
    b, k, contact = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
    present = np.isfinite(b) & np.isfinite(k) & np.isfinite(contact)
    rows = Rows(problem, gains.frequency_hz, present, b[present], k[present], contact[present])
    model = problem.stability.model
    why = "the level knows gains alone, and these run behind an observer with state feedback"
    first: tuple[Level, ...] = ("L0", "L1", "L2", "L3", "L4")
    levels: dict[Level, LevelResult] = {level: not_judged(rows, level, model, why) for level in first}
    levels["L5"] = _hands(feedback_radius(coupling, draws, seed), rows)
    device = problem.device
    stiffness = frozen_parts(problem, rows.b, rows.k).integral / device.sample_time_s
    missing = int(np.count_nonzero(~present))
    return Certificate(
        problem=problem.name,
        requested=False,
        frequency_hz=gains.frequency_hz,
        rows_without_gains=missing,
        levels=levels,
        passive_limit_n_per_m=passive_limit_n_per_m(device),
        dc_stiffness_n_per_m=rows.spread(stiffness),
    )


def _hands(found: FeedbackRadius, rows: Rows) -> LevelResult:
    worst, one = found.any_share, np.ones(len(rows.b))
    held = worst.hand
    who = f"{held['mass_kg']:.4g} kg, {held['damping_ns_per_m']:.4g} N.s/m, {held['stiffness_n_per_m']:.4g} N/m"
    claim = (
        f"the loop with observer and state feedback is linearly stable, with no friction, with the worst hand that a "
        f"search from {found.hands} of [hands] found, whatever share of the innovation passes the dead zone"
    )
    if worst.radius >= 1 - RADIUS_TOLERANCE:
        claim = (
            f"Not met: spectral radius {worst.radius:.6g} with a hand of {who} and {worst.share:.3g} of the innovation"
        )
    passed = np.full(len(rows.b), worst.radius < 1 - RADIUS_TOLERANCE)
    result = level_result(
        rows, "L5", "sampled-data", claim, passed, (1 - worst.radius) * one, 0 * one, RADIUS_TOLERANCE * one
    )
    detail = {
        "spectral_radius": worst.radius,
        "released_spectral_radius": found.free.radius,
        "released_pass": found.free.radius < 1 - RADIUS_TOLERANCE,
        "common_lyapunov": None,
        "hands": found.hands,
        "worst_hand": held,
        "worst_share": worst.share,
    }
    return LevelResult(**{**vars(result), "claim": claim, "margin_ns_per_m": float("nan"), "detail": detail})
