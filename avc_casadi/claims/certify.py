"""Certification of a gain table: every level, whatever the design method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.certificate import Certificate
from avc_casadi.claims.levels import Rows
from avc_casadi.claims.registry import CLAIMS, Judged
from avc_casadi.coupling import check_sample_time, require_coupling
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, passive_limit_n_per_m
from avc_casadi.loops.wall import frozen_parts
from avc_casadi.model.schedule import GainSchedule

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem


def _rows(problem: Problem, gains: GainSchedule, *, requested: bool = False) -> Rows:
    """Return the gains under judgement."""
    b, k, contact = (
        (gains.requested_damping_ns_per_m, gains.requested_stiffness_n_per_m, gains.requested_contact_damping_ns_per_m)
        if requested
        else (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    )
    # A rigid spring or damper is a meaningful limit, but not behind state feedback; an infinite contact damper is not.
    present = ~(np.isnan(b) | np.isnan(k)) & np.isfinite(contact)
    if gains.state_feedback is not None:
        present &= np.isfinite(b) & np.isfinite(k)
    return Rows(problem, gains.frequency_hz, present, b[present], k[present], contact[present])


@of_problem
def certify(
    problem: AnyProblem,
    gains: GainSchedule | Coupling,
    *,
    requested: bool = False,
    draws: int = 24,
    seed: int = 0,
    prove: bool = False,
    progress: Progress = SILENT,
) -> Certificate:
    """Return the certificate of a gain table: passivity and stability claims, with the worst margin of each.

    Args:
        problem: device, environment, models and hands to judge against; or a problem file, or a name of the catalogue.
        gains: the table, or the coupling with it; rows without gains fail every level.
        requested: judge the infeasible gains of unrealisable rows as well. Rows with an infinite gain are judged as a
            rigid coupling.
        draws: hands drawn for L5 in addition to the corners of the range.
        seed: seed of the draws.
        prove: request the proof of rest (L7) of the deployed table with its runtime, seconds a row: proved, refuted or
            open, with the reason. Proofs and witnesses are in the detail of the level as ``proofs`` and can be read
            again (`avc_casadi.claims.prove.rest.Rest`). ``avc certify --help`` says for which devices and laws.
        progress: reported over the rows that are judged.

    Raises:
        InputError: gains of another sample time, or neither a table nor a coupling.

    Example:
        >>> certificate = avc.certify("soft", avc.solve("soft", "exact"))
        >>> certificate.levels["L0"].passed
        True
    """
    problem, whole = with_wall(problem), gains
    if not isinstance(gains, GainSchedule):
        require_coupling(gains)
        gains = gains.schedule
    check_sample_time(gains.sample_time_s, problem, f"gains by {gains.method} for {gains.problem}")
    behind = gains.state_feedback is not None and bool(gains.usable.any())
    rows = _rows(problem, gains, requested=requested and not behind)
    judged = Judged(problem, rows, gains, whole, draws, seed, progress)
    levels = {name: claim.judge(judged) for name, claim in CLAIMS.items() if prove or not claim.on_demand}
    device = problem.device
    parts = frozen_parts(problem, rows.b, rows.k) if behind else fractions(SampledLoop.of(problem), rows.b, rows.k)
    return Certificate(
        problem=problem.name,
        requested=requested and not behind,
        frequency_hz=gains.frequency_hz,
        rows_without_gains=int(np.count_nonzero(~rows.present)),
        levels=levels,
        passive_limit_n_per_m=passive_limit_n_per_m(device),
        dc_stiffness_n_per_m=rows.spread(parts.integral / device.sample_time_s),
        stated=problem,
        gains=whole,
    )
