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
    from avc_casadi.claims.prove.rest import Rest
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Model, Problem, Scope
    from avc_casadi.model.schedule import GainSchedule


CLAIMS: Registry[Claim] = Registry("level", "avc_casadi.claims.level")


@dataclass(frozen=True)
class Judged:
    """What a certificate is made of.

    Attributes:
        problem: what is judged against.
        rows: the gains.
        gains: the table that they are of.
        whole: the table, or the coupling that it came in.
        draws: hands drawn beside the corners of their ranges.
        seed: of what is drawn.
        progress: reported over the rows.
    """

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
        """The table that runs, with what runs beside it; None where no row has gains."""
        from avc_casadi.coupling import Coupling  # noqa: PLC0415 - the registry alone is light

        if isinstance(self.whole, Coupling):
            return self.whole.on(self.problem)
        return Coupling.of(self.problem, self.gains) if self.gains.usable.any() else None

    @cached_property
    def rests(self) -> list[Rest]:
        """What is known of the rest of each row of the table that runs, proved once for all levels that need it."""
        from avc_casadi.claims.proof_levels import rests  # noqa: PLC0415 - loads the proofs

        return [] if self.coupling is None else rests(self.coupling, self.seed, self.progress)


class Claim(ABC):
    """One level of a certificate. A subclass that gives its name is in the registry.

    Attributes:
        name: of the level.
        title: the claim in a few words.
        rank: its place in every list.
        claims: the claim, if it passes, for people.
        leaves: what it does not say, for people.
        hold: hold model that it is made in; None is the problem's.
        scope: the scope of a problem file that asks for it; None where none does.
        on_demand: whether it is judged only where proofs are asked for.
        provable: on what --prove can prove it, for people; empty where nothing is proved.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    rank: ClassVar[float]
    claims: ClassVar[str]
    leaves: ClassVar[str]
    hold: ClassVar[Model | None] = None
    scope: ClassVar[Scope | None] = None
    on_demand: ClassVar[bool] = False
    provable: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "name" in vars(cls):
            CLAIMS.add(cls.name, cls(), cls.rank)

    @abstractmethod
    def judge(self, judged: Judged) -> LevelResult:
        """Judge the gains."""

    def prove(self, judged: Judged, checked: LevelResult) -> LevelResult:  # noqa: ARG002 - most are exact already
        """Prove or refute what was checked; most levels are as they were judged."""
        return checked


def asked_for(problem: Problem) -> str:
    """Return the level that the scope of a problem asks its gains to meet."""
    stated = problem.stability
    return next(name for name, one in CLAIMS.items() if one.scope == stated.scope and one.hold in {None, stated.model})


Where = Literal["own", "band", "all"]
"""At which frequencies a row is judged: its own, a band about it, or all."""


class PassivityClaim(Claim):
    """Frozen gains are passive, at frequencies and with environments that a level names.

    Attributes:
        where: at which frequencies.
        any_environment: whether before any passive environment, and not this one alone.
    """

    where: ClassVar[Where] = "all"
    any_environment: ClassVar[bool] = False

    def judge(self, judged: Judged) -> LevelResult:
        """Judge the rows."""
        from avc_casadi.claims.levels import judge_passivity  # noqa: PLC0415 - help texts need the names alone

        return judge_passivity(judged, self)
