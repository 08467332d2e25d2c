"""The answers of `recommend`: a coupling with its analysis, by the kind of its end, or why there is none."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import cached_property, singledispatch
from typing import Any, ClassVar, Generic, TypeVar

from avc_casadi._util.json_values import Document, plain_table
from avc_casadi._util.page import Worded, worded
from avc_casadi._util.printed import Printed
from avc_casadi.claims.deployable import Deployable
from avc_casadi.claims.levels import LevelResult
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.loops.loop_family import LeastDampedMode
from avc_casadi.loops.margins import Margins, OpenLoop, Transient, transients
from avc_casadi.model.ends import End, Follower, Simulation, ToolGains
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.assumptions import Assumption, Unused
from avc_casadi.recommendation.damped_wall import DampedWall
from avc_casadi.recommendation.evaluator import PerturbedDevices, UnmodelledTrial
from avc_casadi.recommendation.reasons import Reason, Unsettled
from avc_casadi.recommendation.rendered import RenderedPair, RenderedPoint
from avc_casadi.recommendation.rendered_wall import RenderedWall
from avc_casadi.recommendation.sensitivity import Sensitivity, Trade
from avc_casadi.simulation.population.trial import CouplingTrial, HandCounts, Trial

Result = TypeVar("Result")


@dataclass(frozen=True)
class ReleasedAndHeld(Generic[Result]):
    """A result of the device released, and the worst one with the corner hands."""

    released: Result
    worst_hand: Result


@dataclass(frozen=True)
class LimitCycleFreedom(Worded, Document):
    """Settling of a coupling with every hand, making and breaking contact.

    Attributes:
        proof: level L7 of its certificate; None where no proof was tried, and rest is simulated alone.
        without_detents: whether the proof is of the wall alone, and the problem has detents.
    """

    JSON_KEYS: ClassVar = ("word", "sentence")

    proof: LevelResult | None = None
    without_detents: bool = False

    @property
    def word(self) -> str:
        """proved, refuted or open; simulated where no proof was tried."""
        return "simulated" if self.proof is None else self.proof.word

    @property
    def sentence(self) -> str:
        """The claim that holds, or why it does not, in words."""
        return worded(self)


@dataclass(frozen=True, kw_only=True)
class PairLimits:
    """What limits a spring and damper to another end than a wall; what is not known of a kind of end is None or empty.

    Attributes:
        stiffest: linearly stable with every hand and contact.
        worst: loop of the largest spectral radius at that limit.
        loops: number of loops.
        wanted_n_per_m: stiffness that the problem asks for.
        least_tool_mass_kg: tool with which the same K is stable with some B.
        slowest_step_s: step of the engine with which it is.
        exchanges: with which it is, by name.
        same_k: with each of these three.
        searched_to: ends of these searches.
        passivity_margin_ns_per_m: of the two-port; passive at 0 or more.
        passive_damping_ns_per_m: that passivity requires of each device.
    """

    stiffest: ToolGains
    worst: Any
    loops: int
    wanted_n_per_m: float | None = None
    least_tool_mass_kg: float | None = None
    slowest_step_s: float | None = None
    exchanges: Mapping[str, bool] = field(default_factory=dict)
    same_k: Mapping[str, ToolGains] = field(default_factory=dict)
    searched_to: Mapping[str, float] = field(default_factory=dict)
    passivity_margin_ns_per_m: float | None = None
    passive_damping_ns_per_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Pair(PairLimits):
    """Analysis of a spring and damper to another end, beside its limits.

    Attributes:
        gain_margin: common, of K and B.
        motor_margins: of the device's motor alone, and of a follower's.
        mode: the least damped oscillation of all loops.
        points: impedance at the handle, by frequency.
        stiffer: the next stiffer K that was tried, with which hands do not settle; None where none was.
        mismatch_stable: on devices a tenth off and a quarter sample late; None where not asked.
        local_dampers_ns_per_m: that keep K and B stable; None where no local damper belongs to them.
    """

    gain_margin: float
    motor_margins: Sequence[float]
    mode: LeastDampedMode
    points: tuple[RenderedPoint, ...] = ()
    stiffer: Unsettled | None = None
    mismatch_stable: bool | None = None
    local_dampers_ns_per_m: tuple[float, float] | None = None


@dataclass(frozen=True)
class WallLimits:
    """What limits a coupling to a wall.

    Attributes:
        plain_wall_n_per_m: the stiffest wall with a plain spring and damper, by linear stability alone.
        no_stiffer: why the next stiffer wall is not recommended, where the wall is the stiffest that a hand that moves
            gets within 20 %; else None.
    """

    plain_wall_n_per_m: float = 0.0
    no_stiffer: Reason | None = None


class Decision(Enum):
    """Whether a coupling may be loaded into the device, and if not which of the trials or claims refuses it."""

    DEPLOYABLE = auto()
    CLAIM_FAILS = auto()
    """A claim of `deployable` does not hold."""
    NOTHING_RENDERED = auto()
    """No press of a hand renders anything of the wall."""
    REQUIREMENT_UNMET = auto()
    """Hands do not settle with what [robustness] asks for."""
    STRIKE_UNSETTLED = auto()
    """A corner hand that strikes the wall does not settle."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Recommendation(Printed, Document, ABC):
    """The coupling to deploy and its analysis: one of the classes below, by the end and whether there is a coupling.

    Attributes:
        problem: the problem as stated.
        coupling: certified and tried; None where no coupling is deployable.
        trial: result with simulated hands; None without a coupling.
        why: why this one, or why none.
        sensitivities: of the stiffness limit of a spring and damper, the largest first.
        assumed: assumptions.
        not_used: declared keys that the analysis does not use.
        considered: number of couplings judged.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable, found.trial.hands
        (True, 10)
    """

    JSON_KEYS: ClassVar[tuple[str | tuple[str, str], ...]] = (
        ("problem", "problem.name"),
        ("end", "end.kind"),
        "deployable",
        "reason",
        "considered",
        "trial",
        "certificate",
        ("what_would_help", "sensitivities"),
        "assumed",
        "not_used",
    )

    problem: Problem
    coupling: Coupling | None
    trial: Trial | None
    why: Reason
    sensitivities: tuple[Sensitivity, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    not_used: tuple[Unused, ...] = ()
    considered: int = 1

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.problem.name!r}: {self.coupling!r}; {self.reason})"

    @property
    def reason(self) -> str:
        """One sentence: why this one, or why none."""
        return worded(self.why, self.problem.units)

    @property
    def end(self) -> End:
        """What the coupling leads to."""
        return self.problem.end

    @property
    def deployable(self) -> bool:
        """Whether the coupling may be loaded into the device."""
        return self.coupling is not None

    @property
    def certificate(self) -> Document | None:
        """Certificate of the coupling; None without a coupling."""
        return None if self.coupling is None else self.coupling.certificate

    def data(self) -> dict[str, Any]:
        """Return JSON values, computed once: of a wall what is rendered, settling and margins; else the pair."""
        return self._data

    @cached_property
    def _data(self) -> dict[str, Any]:
        return self.document()


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoCoupling(Recommendation):
    """No coupling is deployable, for a reason."""

    coupling: None = field(default=None, init=False)
    trial: None = field(default=None, init=False)


class _ToWall:
    """A recommendation for a wall: what limits a coupling to it."""

    problem: Problem
    limits: WallLimits

    @property
    def no_stiffer(self) -> str:
        """Why the next stiffer wall is not recommended, in words; empty where the stiffest was not looked for."""
        return "" if self.limits.no_stiffer is None else worded(self.limits.no_stiffer, self.problem.units)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoWallCoupling(_ToWall, NoCoupling):
    """No coupling to the wall is deployable.

    Attributes:
        limits: what limits one.
    """

    limits: WallLimits = WallLimits()

    JSON_KEYS: ClassVar = (
        *Recommendation.JSON_KEYS,
        "coupling",
        "no_stiffer",
        ("plain_wall_n_per_m", "limits.plain_wall_n_per_m"),
    )

    def document(self) -> dict[str, Any]:
        """Return the JSON document, which has the keys of one with a coupling, null or empty."""
        return super().document() | {
            "rest": None,
            "felt": {"stiffness_n_per_m": None, "share_of_wall": None},
            "transient": {},
            "margins": {},
            "stiffest_wall_n_per_m": None,
            "confirmed": None,
            "simulated": None,
            "off_file": None,
            "beyond_file": [],
            "trade_off": [],
            "damped_wall": None,
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WallRecommendation(_ToWall, Recommendation):
    """A coupling to a wall.

    Attributes:
        decision: whether it may be deployed.
        claims: what makes a coupling deployable, each with its result.
        rest: limit-cycle freedom with every hand, making and breaking contact.
        limits: what limits a coupling to this wall.
        confirmed: result with hands of [hands] outside the selection; None of gains that were not selected.
        perturbed_devices: result of 16 hands, the corners first, on devices perturbed by a tenth; None where every
            value of the device has a range.
        unmodelled_effects: results with one unmodelled effect each: lighter device, missed samples, another grip.
        trade_off: what a disk margin costs, at four of them; empty where that was not asked for.
        damped_wall: what a damper of the wall would change; None where the coupling does not ring, or nothing helps.
    """

    JSON_KEYS: ClassVar = (
        *Recommendation.JSON_KEYS,
        "rest",
        ("felt", "rendered"),
        ("transient", "transients"),
        "margins",
        "no_stiffer",
        "stiffest_wall_n_per_m",
        ("plain_wall_n_per_m", "limits.plain_wall_n_per_m"),
        "simulated",
        ("off_file", "perturbed_devices"),
        ("beyond_file", "unmodelled_effects"),
        "trade_off",
        "damped_wall",
    )

    coupling: Coupling
    trial: CouplingTrial
    claims: Deployable
    rest: LimitCycleFreedom
    decision: Decision = Decision.DEPLOYABLE
    limits: WallLimits = WallLimits()
    confirmed: CouplingTrial | None = None
    perturbed_devices: PerturbedDevices | None = None
    unmodelled_effects: tuple[UnmodelledTrial, ...] = ()
    trade_off: tuple[Trade, ...] = ()
    damped_wall: DampedWall | None = None

    @property
    def deployable(self) -> bool:
        """Whether the coupling may be loaded into the device."""
        return self.decision is Decision.DEPLOYABLE

    @property
    def stiffest_wall_n_per_m(self) -> float | None:
        """Stiffness of the wall where it is the stiffest that a hand that moves gets; None where not looked for."""
        return self.problem.environment.stiffness_n_per_m if self.limits.no_stiffer else None

    @property
    def simulated(self) -> HandCounts:
        """Counts of all simulated hands, those outside the selection among them."""
        counts = self.trial.counts()
        return counts if self.confirmed is None else counts + self.confirmed.counts()

    @cached_property
    def rendered(self) -> RenderedWall:
        """What is rendered of the wall."""
        return RenderedWall.of(self.coupling, self.trial)

    @cached_property
    def transients(self) -> ReleasedAndHeld[Transient]:
        """How the loop settles after an impact."""
        return ReleasedAndHeld(*transients(self.coupling))

    @cached_property
    def margins(self) -> ReleasedAndHeld[Margins]:
        """Stability margins at the actuator."""
        return ReleasedAndHeld(*OpenLoop.of(self.coupling).margins())

    def document(self) -> dict[str, Any]:
        """Return the JSON document."""
        return super().document() | {
            "coupling": coupling_document(self.coupling),
            "confirmed": None if self.confirmed is None else self.confirmed.counts_document(),
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NoPair(NoCoupling):
    """No spring and damper to another end is deployable.

    Attributes:
        pair: what limits one.
    """

    pair: PairLimits

    JSON_KEYS: ClassVar = (*Recommendation.JSON_KEYS, "coupling")

    def document(self) -> dict[str, Any]:
        """Return the JSON document, which has the keys of one with a coupling, null or empty."""
        without: dict[str, Any] = {"gain_margin": None, "motor_margins": [], "set_by": "", "mismatch_stable": None}
        return super().document() | {
            "felt": {"stiffness_n_per_m": None, "on_stiffest_contact_n_per_m": None, "at": []},
            "pair": plain_table(
                {
                    **{key: getattr(self.pair, key) for key in _LIMITS},
                    **without,
                    "local_dampers_ns_per_m": None,
                    "gains": None,
                    "in_scene": None,
                    "at_follower": None,
                    "least_damped": None,
                    "limited_by": self.pair.worst,
                }
            ),
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PairRecommendation(Recommendation):
    """A spring and damper to another end.

    Attributes:
        pair: its analysis.
    """

    JSON_KEYS: ClassVar = (*Recommendation.JSON_KEYS, ("felt", "rendered"))

    coupling: Coupling
    trial: Trial
    pair: Pair

    @property
    def rendered(self) -> RenderedPair:
        """What is rendered of the other end."""
        return RenderedPair.of(self.coupling, self.pair.points)

    @property
    def set_by(self) -> str:
        """Which hands do not settle with the next stiffer K that was tried, in words; empty where none was."""
        return "" if self.pair.stiffer is None else worded(self.pair.stiffer, self.problem.units)

    def document(self) -> dict[str, Any]:
        """Return the JSON document: the coupling, its limits and margins, and its gains in the units of either end."""
        return super().document() | {
            "coupling": coupling_document(self.coupling),
            "pair": plain_table(
                {
                    **{key: getattr(self.pair, key) for key in (*_LIMITS, *_ANALYSIS)},
                    "set_by": self.set_by,
                    "gains": self.coupling.gains,
                    "in_scene": None,
                    "at_follower": None,
                    **_scaled(self.end, self.coupling),
                    "least_damped": self.pair.mode,
                    "limited_by": self.pair.worst,
                }
            ),
        }


_LIMITS = (
    "stiffest",
    "loops",
    "least_tool_mass_kg",
    "slowest_step_s",
    "exchanges",
    "same_k",
    "searched_to",
    "passivity_margin_ns_per_m",
    "passive_damping_ns_per_m",
)
"""Attributes of the limits of a pair that are keys of its document."""
_ANALYSIS = ("gain_margin", "motor_margins", "mismatch_stable", "local_dampers_ns_per_m")
"""Attributes of a pair that are keys of its document too."""


@singledispatch
def _scaled(end: End, coupling: Coupling) -> dict[str, ToolGains]:  # noqa: ARG001
    """Return the gains of a coupling in the units of its end, by the key of the document."""
    return {}


@_scaled.register
def _in_scene(end: Simulation, coupling: Coupling) -> dict[str, ToolGains]:  # noqa: ARG001
    return {"in_scene": coupling.in_scene}


@_scaled.register
def _at_follower(end: Follower, coupling: Coupling) -> dict[str, ToolGains]:  # noqa: ARG001
    return {"at_follower": coupling.at_follower}
