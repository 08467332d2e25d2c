"""Recommend the coupling between a device and another end than a wall: spring, dampers, what is rendered, limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from avc_casadi._util.json_values import Document
from avc_casadi._util.progress import Stages
from avc_casadi._util.text import quantity
from avc_casadi.claims.llewellyn import Teleoperator, least_damping_ns_per_m, passivity_margin
from avc_casadi.coupling import Coupling
from avc_casadi.design.pair_certificate import PairCertificate, certify_pair
from avc_casadi.design.virtual_tool import ToolSearch, search_of
from avc_casadi.model.device import Device
from avc_casadi.model.ends import Follower, Simulation, ToolGains
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.preconditions import assumed, not_used
from avc_casadi.recommendation.reasons import (
    FollowerLimit,
    HandsUnsettled,
    LastTried,
    NoGainMargin,
    NoMass,
    NoPairStable,
    Reason,
    SettledWithFollower,
    StiffestSettled,
    StiffnessNotReached,
    Unsettled,
    UnsettledWithDroppedSteps,
)
from avc_casadi.recommendation.recommendation import NoPair, Pair, PairLimits, PairRecommendation
from avc_casadi.recommendation.refusals import unstable_engine
from avc_casadi.recommendation.rendered import rendered_pair
from avc_casadi.recommendation.request import Request
from avc_casadi.recommendation.sensitivity import (
    Sensitivity,
    same_stiffness,
    search_ends,
    stable_on_other_devices,
    what_would_help_tool,
)
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.other_ends import try_end
from avc_casadi.simulation.population.trial import Trial

GAIN_MARGIN = 1.5
"""K and B may be this many times as large before a hand, released, a tool or a contact is unstable.

Usual design margins lie between 1.5 and 2 (Astrom and Murray, Feedback Systems, 10.3).
"""


FEW_HANDS = 16
"""Hands of a first trial, corners included."""

_HALVINGS = 7
"""How often the stiffness between leader and follower is halved where no hand settles with one near the limit.

What settles may be softer than stable by far: a force that an encoder step makes moves the weakest hand by a step where
K is above the stiffness of that hand, and the limit does not know of steps.
"""


@dataclass(frozen=True)
class TeleoperatorCertificate(Document):
    """Certificate of a coupling to a follower: margins, and passivity of the two-port.

    Attributes:
        loops: number of loops.
        gain_margin: of K and B at both ends.
        motor_margins: of the leader's motor alone, and of the follower's.
        passivity_margin_ns_per_m: of the two-port; None where it is not known.
    """

    JSON_KEYS: ClassVar = ("loops", "gain_margin", "motor_margins", "passivity_margin_ns_per_m")

    loops: int
    gain_margin: float
    motor_margins: tuple[float, ...]
    passivity_margin_ns_per_m: float | None


@dataclass(frozen=True)
class TrialPlan:
    """Stiffnesses that are tried: the first, how many, and the ratio of each to the one before; then halves."""

    stiffness_n_per_m: float
    count: int
    softer: float
    halvings: int = 0

    def stiffnesses_n_per_m(self) -> list[float]:
        """Return all of them, the stiffest first."""
        near = [self.stiffness_n_per_m * self.softer**number for number in range(self.count)]
        return near + [near[-1] / 2 ** (number + 1) for number in range(self.halvings)]


@dataclass(frozen=True)
class Settled:
    """The coupling with which hands settle, its trial, and the softest stiffer one with which they do not, if any."""

    gains: ToolGains
    trial: Trial
    stiffer: Unsettled | None


class PairDesign:
    """Design of a spring and damper to another end: every loop stable with a margin, and simulated hands settle.

    What a kind of end has beyond this is a subclass.
    """

    beyond_limit: ClassVar[float] = 1.02
    """Factor of the stiffest gains at which the worst loop is looked for."""

    stages: ClassVar[int] = 4
    """Stages of a usual design: the limit, its gain margin, a trial, the certificate."""

    def __init__(self, problem: Problem, request: Request) -> None:
        """Find the stiffest stable coupling to the end, and the stiffness K, N/m, that the problem asks for."""
        self.problem = problem
        self.request = request
        self._stages = Stages(request.progress, self.stages)
        self._stages.begin("stiffest stable coupling")
        self.search = search_of(problem.end, problem)
        self.stiffest, self.local = self.search.limit
        self.wanted_n_per_m = self.search.wanted_n_per_m
        self.last_trial: Trial | None = None

    def why_infeasible(self) -> Reason | None:
        """Return why no coupling is deployable at any gains; None where one may be."""
        return None

    def plan(self) -> TrialPlan | None:
        """Return what is tried; None where nothing is worth a trial."""
        return TrialPlan(self._first(local=self.local), 12, 0.8) if self.stiffest.stiffness_n_per_m > 0 else None

    def best(self) -> Settled | None:
        """Return the stiffest coupling with which all hands settle; None where they do with none."""
        plan = self.plan()
        return None if plan is None else self._stiffest_settled(plan)

    def recommendation(self, best: Settled) -> PairRecommendation:
        """Return the answer with a coupling: its certificate, margins, trial, and the impedance at the handle."""
        problem, gains = self.problem, best.gains
        self._stages.begin("certificate and margins")
        certificate = self.certificate(gains)
        versions = self.request.versions
        coupling = Coupling.to_end(problem, gains, certificate, best.trial, versions)
        return PairRecommendation(
            problem=problem,
            coupling=coupling,
            trial=best.trial,
            why=self.why(certificate.gain_margin, best),
            sensitivities=self.sensitivities(),
            assumed=assumed(problem),
            not_used=not_used(problem),
            pair=Pair(
                **self.limits(gains),
                gain_margin=certificate.gain_margin,
                motor_margins=certificate.motor_margins,
                mode=self.search.loops.slowest(gains),
                points=rendered_pair(problem, gains),
                **self.analysis(best),
            ),
        )

    def no_coupling(self, infeasible: Reason | None) -> NoPair:
        """Return the answer without a coupling: infeasible for a reason, or else as `why_none` says.

        Simulated hands did not settle, or no coupling had the gain margin or the required stiffness.
        """
        return NoPair(
            problem=self.problem,
            why=infeasible or self.why_none(),
            sensitivities=self.sensitivities(),
            assumed=assumed(self.problem),
            not_used=not_used(self.problem),
            pair=PairLimits(**self.limits(None)),
        )

    def certificate(self, gains: ToolGains) -> PairCertificate | TeleoperatorCertificate:
        """Return the certificate of gains."""
        return certify_pair(self.problem, gains, self.search)

    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Return what would help, largest first."""
        return ()

    def limits(self, gains: ToolGains | None) -> dict[str, Any]:  # noqa: ARG002 - of some kinds of end alone
        """Return the stiffest coupling, its worst loop beyond the limit, the number of loops, and the wanted stiffness.

        Kinds of end add values, some of them of the gains, if there are any.
        """
        stiffest = self.stiffest
        beyond = stiffest.times(self.beyond_limit) if stiffest.stiffness_n_per_m else self.search.softest
        return {
            "stiffest": self.stiffest,
            "worst": self.search.loops.radius(beyond)[1],
            "loops": self.search.loop_count,
            "wanted_n_per_m": self.wanted_n_per_m,
        }

    def analysis(self, best: Settled) -> dict[str, Any]:  # noqa: ARG002
        """Return the values of `Pair` that only some kinds of end have."""
        return {}

    def why(self, gain_margin: float, best: Settled) -> Reason:
        """Return why this coupling."""
        return StiffestSettled(
            required=self.wanted_n_per_m is not None,
            low_gain_margin=gain_margin if gain_margin < GAIN_MARGIN else None,
            stiffer=best.stiffer,
        )

    def why_none(self) -> Reason:
        """Return why no coupling, though one is feasible."""
        if self.last_trial is not None:
            return HandsUnsettled(self.last_trial)
        if self.wanted_n_per_m is None:
            return NoGainMargin()
        return StiffnessNotReached(self.wanted_n_per_m, self.stiffest.stiffness_n_per_m)

    def _first(self, *, local: bool) -> float:
        """Return the initial stiffness where none is wanted: nine tenths of the stiffest that has the gain margin."""
        self._stages.begin("its gain margin")
        margins = (GAIN_MARGIN, self.search.least)
        stiffest = (self.search.stiffest_with_margin(self.stiffest, margin, local=local) for margin in margins)
        return 0.9 * (next(filter(None, stiffest), 0.0) or self.stiffest.stiffness_n_per_m / GAIN_MARGIN)

    def _try(self, gains: ToolGains, hands: Hand, *, screen: bool) -> Trial:
        return try_end(self.problem.end, self.problem, gains, hands, self.request.seed, screen=screen)

    def _stiffest_settled(self, plan: TrialPlan) -> Settled | None:
        """Return the stiffest coupling of a plan with which all hands settle; None where none does.

        Few hands try each damper of a K first, then all; K falls by a factor. One that settles only by dry friction is
        taken where the next two K bring none that settles without.
        """
        problem, search = self.problem, self.search
        hands = people_of(problem.hands, self.request.hands, self.request.seed)
        first_hands = hands.pick(slice(0, FEW_HANDS))
        leaning: Settled | None = None
        stiffer: Unsettled | None = None
        for number, stiffness in enumerate(plan.stiffnesses_n_per_m()):
            self._stages.begin(f"hands with K of {quantity(stiffness, problem.units.unit('N/m'))}")
            tries: list[Trial] = []
            for gains in search.damped(stiffness, local=self.local, gain_margin=GAIN_MARGIN):
                trial = self.last_trial = self._try(gains, first_hands, screen=True)
                if trial.all_settle_with_friction and search.has_counterexample(gains, GAIN_MARGIN):
                    continue
                if trial.all_settle_with_friction:
                    trial = self.last_trial = self._try(gains, hands, screen=False)
                if trial.all_settle:
                    return Settled(gains, trial, stiffer)
                if leaning is None and trial.all_settle_with_friction:
                    leaning = Settled(gains, trial, stiffer)
                tries.append(trial)
            if tries:
                stiffer = Unsettled(stiffness, max(tries, key=lambda trial: float(trial.hand_settles.mean())))
            if leaning is not None and number >= 2:
                break
        return leaning


class ToolDesign(PairDesign):
    """Design of spring and damper to a simulation, where a damper of the device's own loop may belong to them."""

    search: ToolSearch
    stages = 7

    def __init__(self, problem: Problem, request: Request, tool: Simulation) -> None:
        super().__init__(problem, request)
        self.tool = tool

    def why_infeasible(self) -> Reason | None:
        """Return why no coupling to the tool is stable at all; None where one is."""
        if self.problem.device.mass_kg == 0:
            return NoMass(to_wall=False)
        if self.stiffest.stiffness_n_per_m > 0:
            return None
        if self.search.loops.engine_alone_stable():
            return NoPairStable()
        return unstable_engine(self.tool)

    def plan(self) -> TrialPlan | None:
        """Return what is tried: a wanted stiffness alone, where some dampers hold it."""
        wanted = self.wanted_n_per_m
        if wanted is None:
            return super().plan()
        return TrialPlan(wanted, 1, 1.0) if self.search.held(wanted, local=self.local) else None

    def sensitivities(self) -> tuple[Sensitivity, ...]:
        """Return what would help, largest first."""
        self._stages.begin("what would help")
        return what_would_help_tool(self.problem, self.search, local=self.local)

    def limits(self, gains: ToolGains | None) -> dict[str, Any]:
        """Return the values of `PairLimits`: also with which tool, step and exchange the same K is stable."""
        self._stages.begin("the same K with another tool, step and exchange")
        # What is only linearly stable is no help where hands refute it.
        wanted = self.wanted_n_per_m if self.last_trial is None else None
        stiffness = wanted if gains is None else gains.stiffness_n_per_m
        known = {} if stiffness is None else same_stiffness(self.problem, stiffness, local=self.local)
        return {**super().limits(gains), **known, "searched_to": search_ends(self.problem)}

    def analysis(self, best: Settled) -> dict[str, Any]:
        """Return the values of `Pair` that only a coupling to a tool has."""
        self._stages.begin("devices a tenth off")
        return {
            "stiffer": best.stiffer,
            "mismatch_stable": stable_on_other_devices(self.problem, best.gains),
            "local_dampers_ns_per_m": self.search.local_dampers_ns_per_m(best.gains) if self.local else None,
        }

    def why(self, gain_margin: float, best: Settled) -> Reason:
        """Return why this coupling."""
        return StiffestSettled(
            required=self.wanted_n_per_m is not None,
            low_gain_margin=gain_margin if gain_margin < GAIN_MARGIN else None,
            stiffer=best.stiffer,
            exchange=self.tool.exchange,
        )

    def why_none(self) -> Reason:
        """Return why no coupling, though one is feasible."""
        trial = self.last_trial
        if trial is None or trial.settled < trial.hands:
            return super().why_none()
        with_dropped_steps = int(trial.variants["with_dropped_steps"].sum())
        return UnsettledWithDroppedSteps(trial.hands, trial.settled, with_dropped_steps)


class FollowerDesign(PairDesign):
    """Design of spring and dampers between a leader and its follower, where a wanted K may need local dampers."""

    beyond_limit = 1.05

    def __init__(self, problem: Problem, request: Request, follower: Follower) -> None:
        super().__init__(problem, request)
        self.follower = follower
        self._first_n_per_m = self._first(local=False)
        wanted = self.wanted_n_per_m
        self.local = wanted is not None and wanted > self._first_n_per_m

    def plan(self) -> TrialPlan | None:
        """Return what is tried: a wanted K alone, twice: loops get known."""
        if not (self.stiffest.stiffness_n_per_m > 0 or self.local):
            return None
        wanted = self.wanted_n_per_m
        return TrialPlan(self._first_n_per_m, 5, 0.85, _HALVINGS) if wanted is None else TrialPlan(wanted, 2, 1.0)

    def certificate(self, gains: ToolGains) -> TeleoperatorCertificate:
        """Return stability margins of a spring and dampers, and the passivity margin of the two-port, N.s/m."""
        margins = self.search.margins(gains)
        passivity_margin_ns_per_m, _ = self._passivity(gains)
        return TeleoperatorCertificate(
            loops=self.search.loop_count,
            gain_margin=margins.gain_margin,
            motor_margins=margins.motor_margins,
            passivity_margin_ns_per_m=passivity_margin_ns_per_m,
        )

    def limits(self, gains: ToolGains | None) -> dict[str, Any]:
        """Return the values of `PairLimits`: also the passivity of the two-port."""
        margin, needed = self._passivity(gains or self.stiffest)
        passivity = {"passivity_margin_ns_per_m": margin, "passive_damping_ns_per_m": needed}
        return super().limits(gains) | passivity

    def why(self, gain_margin: float, best: Settled) -> Reason:  # noqa: ARG002
        """Return why this coupling."""
        return SettledWithFollower(required=self.wanted_n_per_m is not None)

    def why_none(self) -> Reason:
        """Return why no coupling."""
        if self.last_trial is not None:
            damped = _least_damping(self.follower) > 0
            return HandsUnsettled(self.last_trial, LastTried.SOFTEST if damped else LastTried.SOFTEST_WITHOUT_DAMPING)
        if self.wanted_n_per_m is None:
            return FollowerLimit(self.stiffest.stiffness_n_per_m)
        return StiffnessNotReached(self.wanted_n_per_m, self.stiffest.stiffness_n_per_m)

    def _passivity(self, gains: ToolGains) -> tuple[float | None, float | None]:
        """Return the passivity margin of the two-port and the device damping that passivity needs, N.s/m.

        Both are None where they are not known: of position-force, and of different sample times.
        """
        follower, leader = self.follower, self.problem.device
        far, t = follower.at_leader(), leader.sample_time_s
        if follower.architecture != "position-position" or not math.isclose(t, far.sample_time_s, rel_tol=1e-9):
            return None, None
        damping, far_damping = _least_damping(leader), _least_damping(far)
        late, far_late = (max(device.range.delay_samples or (device.delay_samples,)) for device in (leader, far))
        pairs = []
        for delays_s in follower.delays_s:
            forth, back = (delay_s / t for delay_s in delays_s)
            # Unsynchronised clocks delay messages by at most this many samples, both ends together.
            wait = 1 + (-(forth + back)) % 1
            pairs.append(Teleoperator(damping, far_damping, t, forth + wait / 2, back + wait / 2, late, far_late))
        return (
            min(passivity_margin(pair, gains)[0] for pair in pairs),
            max(least_damping_ns_per_m(pair, gains) for pair in pairs),
        )


def _least_damping(device: Device) -> float:
    return min(device.range.damping_ns_per_m or (device.damping_ns_per_m,))
