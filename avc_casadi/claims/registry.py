"""The registry of claims, the levels of a certificate; each is one class in a file of `avc_casadi.claims.level`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.registry import Registry

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult
    from avc_casadi.claims.levels import Rows
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Model, Problem, Scope
    from avc_casadi.model.schedule import GainSchedule


CLAIMS: Registry[Claim] = Registry("level", "avc_casadi.claims.level")


@dataclass(frozen=True)
class Judged:
    """Inputs of a certificate."""

    problem: Problem
    rows: Rows
    gains: GainSchedule
    whole: GainSchedule | Coupling
    draws: int = 24
    seed: int = 0
    progress: Progress = SILENT

    @property
    def behind_feedback(self) -> bool:
        """Whether the gains run behind an observer with state feedback."""
        return self.gains.state_feedback is not None and bool(self.gains.usable.any())

    @cached_property
    def coupling(self) -> Coupling | None:
        """The deployed table with its runtime; None where no row has gains."""
        from avc_casadi.coupling import Coupling  # noqa: PLC0415 - the registry alone is light

        if isinstance(self.whole, Coupling):
            return self.whole.on(self.problem)
        return Coupling.of(self.problem, self.gains) if self.gains.usable.any() else None


class Claim(ABC):
    """One level of a certificate. A subclass that gives its name is in the registry."""

    name: ClassVar[str]
    title: ClassVar[str]
    rank: ClassVar[float]
    claims: ClassVar[str]
    leaves: ClassVar[str]
    hold: ClassVar[Model | None] = None
    scope: ClassVar[Scope | None] = None
    on_demand: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "name" in vars(cls):
            CLAIMS.add(cls.name, cls(), cls.rank)

    @abstractmethod
    def judge(self, judged: Judged) -> LevelResult:
        """Judge the gains."""


def asked_for(problem: Problem) -> str:
    """Return the level that the scope of a problem requires."""
    stated = problem.stability
    return next(name for name, one in CLAIMS.items() if one.scope == stated.scope and one.hold in {None, stated.model})


Where = Literal["own", "band", "all"]
"""Frequencies at which a row is judged: its own, a band about it, or all."""


class PassivityClaim(Claim):
    """Passivity of frozen gains, at frequencies and with environments of a level."""

    where: ClassVar[Where] = "all"
    any_environment: ClassVar[bool] = False

    def judge(self, judged: Judged) -> LevelResult:
        """Judge the rows."""
        from avc_casadi.claims.levels import judge_passivity  # noqa: PLC0415 - help texts need the names alone

        return judge_passivity(judged, self)
