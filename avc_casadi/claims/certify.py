"""Certification of a gain table: one claim a level, each with its worst margin, whatever the design method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.hands import hands_level
from avc_casadi.claims.levels import LEVELS, Judged, LevelResult, Rows, passivity_level
from avc_casadi.coupling import check_sample_time, require_coupling
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.loops.sampled_loop import SampledLoop, fractions, passive_limit_n_per_m
from avc_casadi.loops.wall import frozen_parts
from avc_casadi.model.gains import GainSchedule

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Tabular):
    """Passivity and stability of a gain table: one claim a level, with its worst margin. The levels are never merged.

    Attributes:
        problem: name of the problem.
        requested: whether the infeasible gains of unrealisable rows were judged in place of missing ones.
        frequency_hz: interaction frequencies of the rows, shape (n,).
        rows_without_gains: number of rows without gains; each fails every level.
        levels: results by level.
        passive_limit_n_per_m: 2 b_d/((1 + d) T) at the worst of the ranges: the largest DC stiffness of any passive
            linear rendering; not a number where none is known.
        dc_stiffness_n_per_m: DC stiffness k k_e/(k + k_e) of each row, shape (n,).
        stated: the problem judged against, for ``print``.
        gains: the judged gains.

    Example:
        >>> certificate = avc.certify("soft", avc.solve("soft", "exact"))
        >>> certificate.levels["L5"].passed
        True
    """

    problem: str
    requested: bool
    frequency_hz: FloatArray
    rows_without_gains: int
    levels: dict[str, LevelResult]
    passive_limit_n_per_m: float
    dc_stiffness_n_per_m: FloatArray
    stated: Problem
    gains: GainSchedule | Coupling

    def to_dict(self) -> Columns:
        """Return the levels as columns, each of shape (levels,)."""
        levels = self.levels.values()
        columns = ("level", "passed", "margin_ns_per_m", "frequency_hz", "model", "rows_failed", "claim")
        found = {name: np.array([getattr(one, name) for one in levels]) for name in columns}
        return found | {"title": np.array([LEVELS[one.level].title for one in levels])}

    @property
    def _judged(self) -> str:
        return "requested gains" if self.requested else "gains"

    def _summary(self) -> str:
        marks = ", ".join(f"{level} {found.word}" for level, found in self.levels.items())
        return f"{self.problem!r}, {self._judged} of {len(self.frequency_hz)} rows: {marks}"

    def document(self) -> dict[str, Any]:
        """Return the `certify` document: JSON values only."""
        kept = ("problem", "frequency_hz", "rows_without_gains", "passive_limit_n_per_m", "dc_stiffness_n_per_m")
        levels = {level: result.document() for level, result in self.levels.items()}
        return {name: plain(getattr(self, name)) for name in kept} | {"judged": self._judged, "levels": levels}


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
    parts = frozen_parts(problem, rows.b, rows.k) if behind else fractions(SampledLoop.of(problem), rows.b, rows.k)
    return Certificate(
        problem=problem.name,
        requested=requested and not behind,
        frequency_hz=gains.frequency_hz,
        rows_without_gains=int(np.count_nonzero(~rows.present)),
        levels={name: _level(judged, name) for name, level in LEVELS.items() if prove or not level.on_demand},
        passive_limit_n_per_m=passive_limit_n_per_m(problem.device),
        dc_stiffness_n_per_m=rows.spread(parts.integral / problem.device.sample_time_s),
        stated=problem,
        gains=whole,
    )


def _level(judged: Judged, name: str) -> LevelResult:
    if name == "L5":
        return hands_level(judged)
    if name == "L7":
        from avc_casadi.claims.proof_levels import rest_level  # noqa: PLC0415 - loads the proofs

        return rest_level(judged)
    return passivity_level(judged, name)
