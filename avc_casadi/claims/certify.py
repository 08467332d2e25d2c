"""Certify a gain table: every level, whatever the table was designed for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.certificate import Certificate, Level, LevelResult
from avc_casadi.claims.feedback import certify_feedback
from avc_casadi.claims.hands_level import hands_level, not_proved, proved_level
from avc_casadi.claims.levels import Rows, device_level, ideal, llewellyn_level, not_judged, passivity_level
from avc_casadi.claims.passivity.sampled_loop import SampledLoop, fractions, passive_limit_n_per_m
from avc_casadi.claims.proof_levels import changes_level, proof_level, rest_level, rests, ripple_level
from avc_casadi.coupling import Coupling, check_sample_time, require_coupling
from avc_casadi.files.problem_file import as_problem
from avc_casadi.model.corners import least_damped
from avc_casadi.model.schedule import GainSchedule

if TYPE_CHECKING:
    from pathlib import Path

    from avc_casadi.claims.certificate import Level, LevelResult
    from avc_casadi.claims.prove.rest import Rest
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Model, Problem


_LEVELS: tuple[Level, ...] = ("L7", "L8", "L9")


def on_demand(
    problem: Problem, gains: GainSchedule | Coupling, *, seed: int = 0, progress: Progress = SILENT
) -> tuple[dict[Level, LevelResult], list[Rest]]:
    """Prove, refute or leave open L7 to L9 of the table that runs, with all that runs beside it.

    A device let go has no place of rest, and is no part of them.

    Args:
        problem: what is judged against.
        gains: a table, or the coupling with it.
        seed: of hands that are drawn and of the search for orbits.
        progress: told of the rows.

    Returns:
        The levels, and what is known of the rest of each row of the table that runs.
    """
    if isinstance(gains, GainSchedule):
        if not gains.usable.any():
            none = np.zeros(gains.rows, dtype=bool)
            return {level: proof_level(level, "open", "no row has gains", none, {}) for level in _LEVELS}, []
        coupling = Coupling.of(problem, gains)
    else:
        coupling = gains.on(problem)
    found = rests(coupling, seed, progress)
    with progress.step("patterns of changing gains"):
        changing = changes_level(coupling, progress)
    with progress.step("bound of the ripple"):
        ripple = ripple_level(coupling, found, progress)
    return {"L7": rest_level(coupling, found, progress), "L8": changing, "L9": ripple}, found


def certify(
    problem: Problem | str | Path,
    gains: GainSchedule | Coupling,
    *,
    requested: bool = False,
    draws: int = 24,
    seed: int = 0,
    prove: bool = False,
    progress: Progress = SILENT,
) -> Certificate:
    """Say which stability claims a gain table meets, with the worst margin of each and where it stands.

    Args:
        problem: device, environment, models and hands to judge against; or a problem file, or a name of the catalogue.
        gains: the table, or the coupling with it; rows without gains fail every level.
        requested: judge the gains that unrealisable rows asked for as well. Rows that asked for an infinite gain are
            judged as a rigid coupling.
        draws: hands drawn for L5 beside the corners of the range.
        seed: seed of the draws.
        prove: ask for proofs, seconds a row: L5 over every hand and device of the ranges, where a search alone has
            looked; and of the table that runs, with what runs beside it, rest (L7), gains that change (L8) and ripple
            (L9). Each says proved, refuted or open, with the reason. Proofs and witnesses stand in the detail of the
            level as ``proofs`` and can be read again (`avc_casadi.claims.prove`: `HandsProof`, `Rest`, `Changing`). On
            which devices and laws each level can be proved stands in ``avc certify --help``.
        progress: told of the rows that are judged.

    Raises:
        InputError: gains of another sample time, or neither a table nor a coupling.

    Example:
        >>> certificate = avc.certify("soft", avc.solve("soft", "exact"))
        >>> certificate.levels["L0"].passed
        True
    """
    problem, whole = as_problem(problem), gains
    if not isinstance(gains, GainSchedule):
        require_coupling(gains)
        gains = gains.schedule
    check_sample_time(gains.sample_time_s, problem, f"gains by {gains.method} for {gains.problem}")
    if gains.state_feedback is not None and gains.usable.any():
        certificate = certify_feedback(Coupling.of(problem, gains), draws=draws, seed=seed)
        if prove:
            demanded, rests = on_demand(problem, whole, seed=seed, progress=progress)
            why = "the enclosure knows gains, not an observer with state feedback"
            if all(one.multiplier is not None for one in rests):
                why += "; where all of the innovation passes, the multiplier of L7 proves it"
            certificate.levels["L5"] = not_proved(certificate.levels["L5"], why)
            certificate.levels.update(demanded)
        return certificate
    b, k, contact = (
        (gains.requested_damping_ns_per_m, gains.requested_stiffness_n_per_m, gains.requested_contact_damping_ns_per_m)
        if requested
        else (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    )
    # A rigid spring or damper is a limit with a meaning; a contact damper without bound is none.
    present = ~(np.isnan(b) | np.isnan(k)) & np.isfinite(contact)
    rows = Rows(problem, gains.frequency_hz, present, b[present], k[present], contact[present])
    model = problem.stability.model
    levels: dict[Level, LevelResult] = {
        "L0": _if_offered(rows, "L0", model, progress),
        "L1": _if_offered(rows, "L1", model, progress),
        "L2": _if_offered(rows, "L2", "paper", progress),
        "L3": _if_offered(rows, "L3", "sampled-data", progress),
        "L4": _if_offered(rows, "L4", model, progress),
        "L5": hands_level(rows, draws=draws, seed=seed, progress=progress),
    }
    if prove:
        demanded, rests = on_demand(problem, whole, seed=seed, progress=progress)
        levels["L5"] = proved_level(rows, levels["L5"], rests, progress)
        levels |= demanded
    device = problem.device
    parts = fractions(SampledLoop.of(problem), rows.b, rows.k)
    return Certificate(
        problem=problem.name,
        requested=requested,
        frequency_hz=gains.frequency_hz,
        rows_without_gains=int(np.count_nonzero(~present)),
        levels=levels,
        passive_limit_n_per_m=passive_limit_n_per_m(device),
        dc_stiffness_n_per_m=rows.spread(parts.integral / device.sample_time_s),
    )


def _if_offered(rows: Rows, level: Level, model: Model, progress: Progress) -> LevelResult:
    """Judge L0 to L4; a device for which a level is not offered does not meet it."""
    try:
        if not ideal(rows.problem.device):
            return device_level(rows, level, model, progress)
        # Re Z_h grows with the device's damping, so that the lower end of its range stands for the others.
        lean = replace(rows, problem=least_damped(rows.problem))
        if level == "L4":
            return llewellyn_level(lean, model, progress)
        return passivity_level(lean, level, model, progress)
    except UnsupportedError as refusal:
        return not_judged(rows, level, model, str(refusal))
