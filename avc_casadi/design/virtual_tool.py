"""Spring and damper between a device and a virtual tool: the stiffest stable ones, the best damper, the certificate."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial, singledispatch

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.page import Worded
from avc_casadi._util.progress import UNSEEN_STAGES, Stages
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.follower import FollowerLoops
from avc_casadi.loops.loop_family import LoopFamily, Loops, PairMargins, WithGainMargin
from avc_casadi.model.ends import End, Follower, Simulation, ToolGains, not_known
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class PairFault(Worded):
    """Why a spring and damper to another end should not run on a device.

    Attributes:
        least_gain_margin: the gain margin that it lacks; None of one that is unstable.
    """

    least_gain_margin: float | None = None


@dataclass(frozen=True)
class ToolSearchOptions:
    """Numbers of the search.

    Attributes:
        dampers: dampers B tried before the best are refined. The limit of K over B has several humps, some no wider
            than a third; with fewer dampers a hump may be passed by.
        precision: relative precision of a limit; each halving costs another stability test for every limit.
        local_ratios: dampers of the device's local loop, as damping ratios of the released device on K: above 1 it
            only creeps back.
    """

    dampers: int = 49
    precision: float = 5e-3
    local_ratios: tuple[float, ...] = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)


CouplingOfDamperAndSpring = Callable[[float, float], ToolGains]
"""Makes a coupling of a damper B, N.s/m, and a spring K, N/m."""
CouplingOfSpring = Callable[[float], ToolGains]
"""The same of a spring K alone, with a given damper."""
DEFAULT_OPTIONS = ToolSearchOptions()
WIDEST_MARGIN = 4.0
"""Upper limit of the gain margins that are searched."""
# Share of the stiffest K from which a local maximum over B is refined.
_HUMP = 0.5
# Dampers B tried reach from this share of m/T to m/T.
_LIGHTEST_DAMPER = 1e-4
# Mass, kg, where neither device nor hand has any.
_SMALLEST_MASS_KG = 1e-6
# A search ends at this multiple of m/T^2, and a coupling counts as none below this share of m/T_slow^2.
_STIFFEST = 10
_SOFTEST = 1e-5
# Searches of the ranges for one summit: each adds a loop or some, and few are needed.
_SEARCHES = 20
# Shares of a summit's K that are searched for a counterexample: just below it, and well below.
_SOFTER = (0.99, 0.8)
# Precision of a limit while humps are looked for, and shares of the limit before at which the next is looked for.
_ROUGH = 1.05
_SHARES_OF_BEFORE = (1 / 64, 1 / 16, 1 / 4, 1.0)
# Steps and precision in ln B of a refined hump: humps have a sharp edge.
_HUMP_STEPS = 16
_HUMP_PRECISION = 2e-3
# A first guess of a limit that is unstable is divided by this until it is stable.
_BACK_OFF = 2**0.5
# Below a limit gaps are looked for down to a fiftieth, in steps of a quarter.
_GAP_REACH = 50
_GAP_STEP = 1.25
# Damping ratio, as a share of the best or of a part of it, from which a damper counts as that good.
_GOOD = 0.9
# Lightest damper of the device's local loop that is told from none, as a share of the heaviest.
_LIGHTEST_LOCAL = 1e-6


@dataclass(frozen=True)
class Scale:
    """Scales of the search.

    Attributes:
        mass_kg: mass m of the lightest device of the range, or of the lightest hand where it has none.
        damping_ns_per_m: damping of the least damped device of the range, N.s/m.
        sample_time_s: sample time T of the device, s.
        slow_s: the slowest time of the loop T_slow, s: the engine's step, or the delay of a round trip.
    """

    mass_kg: float
    damping_ns_per_m: float
    sample_time_s: float
    slow_s: float

    @classmethod
    def of(cls, problem: Problem, slow_s: float) -> Scale:
        """Return the scales of a problem's device, with its lightest hand where it has no mass.

        `slow_s` is the slowest time of the loop, which counts as a sample of the device at least.
        """
        device = problem.device
        lightest = device.mass_kg if device.range.mass_kg is None else device.range.mass_kg[0]
        mass = lightest or max(problem.hands.mass_kg[0], _SMALLEST_MASS_KG)
        damping = device.damping_ns_per_m if device.range.damping_ns_per_m is None else device.range.damping_ns_per_m[0]
        return cls(mass, damping, device.sample_time_s, max(slow_s, device.sample_time_s))

    def dampers_ns_per_m(self, options: ToolSearchOptions = DEFAULT_OPTIONS) -> FloatArray:
        """Return the dampers B that are tried, in increasing order."""
        return self.mass_kg / self.sample_time_s * np.geomspace(_LIGHTEST_DAMPER, 1.0, options.dampers)


class CouplingSearch:
    """Search for a spring K and damper B that stabilise all loops.

    Attributes:
        loops: the loops of all devices, hands and other ends, with every counterexample found so far.
        scale: scales of the search.
        options: its numbers.
        least: least gain margin with which a coupling may run.
        deployable: the loops with that margin.
    """

    def __init__(
        self, loops: Loops, scale: Scale, options: ToolSearchOptions = DEFAULT_OPTIONS, least: float = 1.0
    ) -> None:
        self.loops = loops
        self.scale = scale
        self.options = options
        self.least = least
        self.deployable = self._with(least)

    @cached_property
    def dampers_ns_per_m(self) -> FloatArray:
        """Dampers B tried, in increasing order."""
        return self.scale.dampers_ns_per_m(self.options)

    @property
    def stiffest_n_per_m(self) -> float:
        """Stiffness at which a search ends: that of a mass that oscillates faster than T resolves."""
        return _STIFFEST * self.scale.mass_kg / self.scale.sample_time_s**2

    @property
    def _softest_n_per_m(self) -> float:
        """Stiffness below which a coupling counts as none."""
        return _SOFTEST * self.scale.mass_kg / self.scale.slow_s**2

    @property
    def softest(self) -> ToolGains:
        """The softest coupling searched, with the middle damper."""
        return ToolGains(self._softest_n_per_m, float(self.dampers_ns_per_m[self.options.dampers // 2]))

    def stiffest(self, local_damping_ns_per_m: float = 0.0) -> ToolGains:
        """Return the stiffest K up to which every loop is stable, with its best B; 0 where there is none."""
        return self._summit(lambda b, k: ToolGains(k, b, local_damping_ns_per_m))

    def stiffest_beside_local_damper(self) -> ToolGains:
        """Return the stiffest stable K, with its B, where a damper of the device's own loop damps the released device.

        The local damper gives the released device on K a damping ratio of `options.local_ratios`; the best ratio is
        taken.
        """

        def stiffest_with_ratio(ratio: float) -> ToolGains:
            return self._summit(lambda b, k: ToolGains(k, b, self._local(k, ratio)))

        # The limit hardly varies between neighbours of these ratios: every other one suffices.
        summits = [self.stiffest(), *map(stiffest_with_ratio, self.options.local_ratios[1::2])]
        return max(summits, key=_stiffness)

    def _local(self, stiffness_n_per_m: float, ratio: float) -> float:
        """Return the damper that, with the device's own, gives a damping ratio on a spring: 2 zeta sqrt(K m) - b_d."""
        critical = 2 * math.sqrt(stiffness_n_per_m * self.scale.mass_kg)
        return max(0.0, ratio * critical - self.scale.damping_ns_per_m)

    def stiffest_with_margin(self, limit: ToolGains, gain_margin: float, *, local: bool) -> float:
        """Return the stiffest K, N/m, that has a gain margin with some B; 0 where none has.

        It is that of `limit`, the stiffest stable coupling, over the margin, or else is searched.
        """
        judge = self._with(gain_margin)
        below = limit.times(1 / gain_margin)
        if below.stiffness_n_per_m > 0 and judge.stable(below) and not judge.has_counterexample(below):
            return below.stiffness_n_per_m
        # A trial begins at a share of it: every other damper suffices.
        search = CouplingSearch(judge, self.scale, replace(self.options, dampers=self.options.dampers // 2 + 1))
        return (search.stiffest_beside_local_damper() if local else search.stiffest()).stiffness_n_per_m

    def _summit(self, gains: CouplingOfDamperAndSpring) -> ToolGains:
        """Return the coupling with the stiffest K over all dampers that no search of the ranges refutes.

        Each refutation adds its loop to those that are judged, and the limits of the dampers are lowered.
        """
        limits: list[float] = []
        for _ in range(_SEARCHES):
            limits = self._lowered(gains, limits) if limits else self._limits(gains)
            summit = self._top(gains, limits)
            if not summit.stiffness_n_per_m or not self._refuted_below(summit):
                return summit
        return gains(0.0, 0.0)

    def _refuted_below(self, summit: ToolGains) -> bool:
        """Return whether a search of the ranges refutes a softer coupling with the dampers of a summit."""
        softer = (replace(summit, stiffness_n_per_m=share * summit.stiffness_n_per_m) for share in _SOFTER)
        return any(self.loops.has_counterexample(coupling) for coupling in softer)

    def _limits(self, gains: CouplingOfDamperAndSpring) -> list[float]:
        """Return roughly the stiffest stable K, N/m, with each of the dampers B, in their order."""
        limits: list[float] = []
        for damping in self.dampers_ns_per_m.tolist():
            before = limits[-1] if limits else 0.0
            limits.append(self._followed(partial(gains, damping), before, self.stiffest_n_per_m))
        return limits

    def _lowered(self, gains: CouplingOfDamperAndSpring, before: list[float]) -> list[float]:
        """Return the limits of K with each damper B after loops were added, from those `before`, N/m.

        The highest come first; those below half of the top, which no hump reaches, are left as they were.
        """
        limits = before.copy()
        top = 0.0
        for place in sorted(range(len(before)), key=lambda place: -before[place]):
            if before[place] <= max(self._softest_n_per_m, _HUMP * top):
                break
            with_damper = partial(gains, float(self.dampers_ns_per_m[place]))
            limits[place] = self._followed(with_damper, before[place], before[place])
            top = max(top, limits[place])
        return limits

    def _top(self, gains: CouplingOfDamperAndSpring, limits: list[float]) -> ToolGains:
        """Return the coupling with the stiffest stable K: each hump of the limits of K over the dampers is refined."""
        dampers = self.dampers_ns_per_m.tolist()
        least = _HUMP * max(limits)
        lower = [0.0, *limits[:-1]]
        upper = [*limits[1:], 0.0]
        humps = [
            place
            for place, (before, limit, after) in enumerate(zip(lower, limits, upper, strict=True))
            if limit > 0 and limit >= least and before <= limit >= after
        ]
        refined = [pair for place in humps for pair in self._refined(gains, dampers[place], limits[place])]
        best = gains(0.0, 0.0)
        for limit, damping in sorted(refined, reverse=True):
            if limit <= best.stiffness_n_per_m:
                break
            checked = self._without_gaps(partial(gains, damping), limit)
            best = max(best, checked, key=_stiffness)
        return best

    def _refined(
        self, gains: CouplingOfDamperAndSpring, damping_ns_per_m: float, limit_n_per_m: float
    ) -> list[tuple[float, float]]:
        """Return stiffest K, N/m, with dampers B, N.s/m, between the neighbours of a damper, by a search over ln B."""
        from scipy.optimize import minimize_scalar  # noqa: PLC0415 - as long as all that `avc check` needs

        fine = 1 + self.options.precision
        limits = [(self._limit(partial(gains, damping_ns_per_m), limit_n_per_m, fine), damping_ns_per_m)]

        def softness(logarithm: float) -> float:
            damping = math.exp(logarithm)
            limit = self._limit(partial(gains, damping), max(limits)[0], fine)
            limits.append((limit, damping))
            return -limit

        ratio = math.log(self.dampers_ns_per_m[1] / self.dampers_ns_per_m[0])
        middle = math.log(damping_ns_per_m)
        minimize_scalar(
            softness,
            bounds=(middle - ratio, middle + ratio),
            method="bounded",
            options={"maxiter": _HUMP_STEPS, "xatol": _HUMP_PRECISION},
        )
        return limits

    def damped(self, stiffness_n_per_m: float, *, local: bool = False, gain_margin: float = 1.0) -> list[ToolGains]:
        """Return K with dampers to try: the best damping ratio, lighter ones of half and a quarter of it, the heaviest.

        All have the gain margin, if any has; otherwise the one of the largest margin is returned.
        """
        # A light one transmits less of the encoder's steps. In a contact that rings by itself all are equally good:
        # there the heaviest damps the other modes.
        stable = list(filter(self.deployable.stable, self._tried(stiffness_n_per_m, local=local)))
        if not stable:
            return []
        safe = list(filter(self._with(gain_margin).stable, stable))
        if not safe:
            return [max(stable, key=self.gain_margin)]
        ratios = [self.loops.slowest(coupling).damping_ratio for coupling in safe]

        def as_damped(part: float) -> list[ToolGains]:
            least = _GOOD * part * max(ratios)
            return [coupling for coupling, ratio in zip(safe, ratios, strict=True) if ratio >= least]

        good = as_damped(1.0)
        best = max(good, key=self.gain_margin)
        lightest_of_half = min(as_damped(1 / 2), key=_dampers)
        lightest_of_quarter = min(as_damped(1 / 4), key=_dampers)
        heaviest = max(good, key=_dampers)
        return list(dict.fromkeys((best, lightest_of_half, lightest_of_quarter, heaviest)))

    def held(self, stiffness_n_per_m: float, *, local: bool = False, inside: bool = True) -> ToolGains | None:
        """Return a coupling of this K with which every loop has its least margins; None where no damper gives one.

        `local` lets a damper act in the device's own loop; `inside` searches the ranges between their corners too.
        """
        couplings = self._tried(stiffness_n_per_m, local=local)
        middle_first = sorted(range(len(couplings)), key=lambda place: abs(place - len(couplings) / 2))
        for place in middle_first:
            coupling = couplings[place]
            if not self.deployable.stable(coupling):
                continue
            if not (inside and self.deployable.has_counterexample(coupling)):
                return coupling
        return None

    def has_counterexample(self, gains: ToolGains, gain_margin: float) -> bool:
        """Return whether a search of the ranges refutes gains with their margin; without it where they have none."""
        judge = self._with(gain_margin)
        return (judge if judge.stable(gains) else self.deployable).has_counterexample(gains)

    def _with(self, gain_margin: float) -> WithGainMargin:
        return WithGainMargin(self.loops, max(gain_margin, self.least), self.least)

    def _tried(self, stiffness_n_per_m: float, *, local: bool) -> list[ToolGains]:
        """Return couplings of a stiffness K with each of the dampers B, and of the device's own loop if `local`."""
        local_ratios = self.options.local_ratios if local else ()
        local_dampers = {0.0, *(self._local(stiffness_n_per_m, ratio) for ratio in local_ratios)}
        dampers = ([0.0] if local else []) + self.dampers_ns_per_m.tolist()
        return [
            ToolGains(stiffness_n_per_m, damping, local_damping)
            for local_damping in sorted(local_dampers)
            for damping in dampers
        ]

    def gain_margin(self, gains: ToolGains, motor: int | None = None) -> float:
        """Return the gain margin of K and B, or of one motor alone, with all known loops; 0 where they are unstable."""
        if not self.loops.stable(gains):
            return 0.0
        fine = 1 + self.options.precision
        return edge(lambda factor: self.loops.stable(gains.times(factor, motor)), 1.0, WIDEST_MARGIN, fine)

    def gain_margin_over_ranges(
        self, gains: ToolGains, motor: int | None = None, stages: Stages = UNSEEN_STAGES
    ) -> float:
        """Return the gain margin of K and B, or of one motor alone, once no search of the ranges refutes it."""
        margin = self.gain_margin(gains, motor)
        while margin and self.loops.has_counterexample(
            gains.times(margin / (1 + self.options.precision), motor), stages
        ):
            margin = self.gain_margin(gains, motor)
        return margin

    def margins(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> PairMargins:
        """Return the gain margins of K and B at both ends, and of the device's motor alone and the follower's."""
        motor_margins = [self.gain_margin_over_ranges(gains, motor, stages) for motor in range(self.loops.motors)]
        return PairMargins(self.gain_margin_over_ranges(gains, stages=stages), tuple(motor_margins))

    def fault(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> PairFault | None:
        """Return why gains should not run on a device; None where they may."""
        if _unstable(self.loops, gains, stages):
            return PairFault()
        return PairFault(least_gain_margin=self.least) if _unstable(self.deployable, gains, stages) else None

    def local_dampers_ns_per_m(self, gains: ToolGains) -> tuple[float, float]:
        """Return the range of the damper in the device's local loop with which K and B stay stable."""
        top = float(self.dampers_ns_per_m[-1])
        present = gains.local_damping_ns_per_m

        def stable(damping: float) -> bool:
            return self.loops.stable(replace(gains, local_damping_ns_per_m=damping))

        start = present if present > 0 else float(self.dampers_ns_per_m[0])
        if not stable(start):
            return present, present
        fine = 1 + self.options.precision
        most = edge(stable, start, top, fine)
        if stable(0.0):
            return 0.0, most
        largest_divisor = edge(lambda divisor: stable(start / divisor), 1.0, start / (_LIGHTEST_LOCAL * top), fine)
        return start / largest_divisor, most

    def _edge(self, gains: CouplingOfSpring, low: float, high: float, precision: float = _ROUGH) -> float:
        """Return the largest stable K between a stable one and a larger one."""
        return edge(lambda k: self.loops.stable(gains(k)), low, high, precision)

    def _followed(self, gains: CouplingOfSpring, before_n_per_m: float, most_n_per_m: float) -> float:
        """Return roughly the largest K, N/m, up to which all softer ones are stable; 0 where even the softest is not.

        It climbs by shares of the limit with the damper before, `before_n_per_m`, up to `most_n_per_m`.
        """
        low = self._softest_n_per_m
        if not self.loops.stable(gains(low)):
            return 0.0
        for share in _SHARES_OF_BEFORE:
            high = share * before_n_per_m
            if high > low:
                if not self.loops.stable(gains(high)):
                    return self._edge(gains, low, high)
                low = high
        return self._edge(gains, low, most_n_per_m)

    def _limit(self, gains: CouplingOfSpring, near: float, precision: float) -> float:
        """Return the largest stable K, N/m, near an initial guess, to a relative precision; 0 where none is stable."""
        low = near
        while not self.loops.stable(gains(low)):
            low /= _BACK_OFF
            if low < self._softest_n_per_m:
                return 0.0
        high = near if low < near else self.stiffest_n_per_m
        return self._edge(gains, low, high, precision)

    def _without_gaps(self, gains: CouplingOfSpring, limit: float) -> ToolGains:
        """Return the coupling at a limit of K, N/m, or below a gap where a softer one is unstable with its dampers."""
        count = math.ceil(math.log(_GAP_REACH) / math.log(_GAP_STEP))
        softer = (limit * np.geomspace(1 / _GAP_REACH, 1.0, count + 1)).tolist()
        if not self.loops.stable(gains(softer[0])):
            return gains(0.0)
        for before, after in itertools.pairwise(softer):
            if not self.loops.stable(gains(after)):
                return gains(self._edge(gains, before, after, 1 + self.options.precision))
        return gains(limit)


def _unstable(loops: Loops, gains: ToolGains, stages: Stages) -> bool:
    """Return whether some loop is unstable, at the corners of the ranges or inside."""
    return not loops.stable(gains) or loops.has_counterexample(gains, stages)


class EndSearch(CouplingSearch, ABC):
    """Search for couplings of one problem to its end.

    Attributes:
        loops: the loops of hands, devices and the end, with every counterexample found so far.
    """

    loops: LoopFamily

    @property
    @abstractmethod
    def loop_count(self) -> int:
        """Number of loops at the corners of all ranges, and of counterexamples inside."""

    @property
    def stages_of_verdict(self) -> int:
        """Regions of the ranges that a usual certificate and verdict search: each once with each of some gains.

        These are the gains themselves, those at the margin of each motor and of K and B, and those of `deployable`.
        """
        at_margins = self.loops.motors + 1
        return (1 + 2 * at_margins) * self.loops.regions

    @property
    def wanted_n_per_m(self) -> float | None:
        """Stiffness that the problem asks for; None where it asks for the stiffest."""
        return None

    @property
    def damped_locally(self) -> bool:
        """Whether a damper of the device's local loop belongs to every coupling."""
        return False

    @cached_property
    def limit(self) -> tuple[ToolGains, bool]:
        """The stiffest that is stable, and whether a damper of the device's loop belongs to it."""
        return self.stiffest(), False


@singledispatch
def search_of(end: End, problem: Problem) -> EndSearch:  # noqa: ARG001
    """Return the search for the couplings of a problem to its end.

    Raises:
        UnsupportedError: of this kind of end no spring and damper is searched.
    """
    raise not_known(end, "a search for spring and damper")


class ToolSearch(EndSearch):
    """Search for couplings of one problem with [simulation]."""

    loops: ToolLoops

    def __init__(
        self, problem: Problem, options: ToolSearchOptions = DEFAULT_OPTIONS, more_hands: Sequence[Hand] = ()
    ) -> None:
        self.loops = ToolLoops(problem, more_hands)
        scale = Scale.of(problem, max(self.loops.tool.step_s))
        super().__init__(self.loops, scale, options, problem.robustness.gain_margin)

    @property
    def loop_count(self) -> int:
        """Number of loops."""
        return len(self.loops)

    @property
    def wanted_n_per_m(self) -> float | None:
        """Stiffness that the problem asks for."""
        return self.loops.tool.stiffness_n_per_m

    @property
    def damped_locally(self) -> bool:
        """Whether the exchange needs a damper of the device's local loop."""
        return self.loops.tool.damped_locally

    @cached_property
    def limit(self) -> tuple[ToolGains, bool]:
        """The stiffest that is stable, and whether a damper of the device's own loop belongs to it.

        It belongs to it where the exchange needs one, or the wanted stiffness is not reached without.
        """
        if self.damped_locally:
            return self.stiffest_beside_local_damper(), True
        stiffest = self.stiffest()
        wanted_n_per_m = self.wanted_n_per_m
        if wanted_n_per_m is not None and wanted_n_per_m > stiffest.stiffness_n_per_m:
            return self.stiffest_beside_local_damper(), True
        return stiffest, False


@search_of.register
def _tool_search(end: Simulation, problem: Problem) -> EndSearch:  # noqa: ARG001
    return ToolSearch(problem)


class FollowerSearch(EndSearch):
    """Search for couplings of one problem with [follower]."""

    loops: FollowerLoops

    def __init__(self, problem: Problem) -> None:
        self.loops = FollowerLoops(problem)
        round_trip_s = max(sum(delays) for delays in self.loops.follower.delays_s)
        scale = Scale.of(problem, round_trip_s)
        super().__init__(self.loops, scale, _FOLLOWER_OPTIONS, problem.robustness.gain_margin)

    @property
    def wanted_n_per_m(self) -> float | None:
        """Stiffness that the problem asks for."""
        return self.loops.follower.stiffness_n_per_m

    @property
    def loop_count(self) -> int:
        """Number of loops."""
        return len(self.loops)


@search_of.register
def _follower_search(end: Follower, problem: Problem) -> EndSearch:  # noqa: ARG001
    return FollowerSearch(problem)


# Long delays make large matrices, so fewer dampers are tried.
_FOLLOWER_OPTIONS = ToolSearchOptions(dampers=13, local_ratios=(0.2, 0.5, 1.0), precision=0.01)


def _stiffness(gains: ToolGains) -> float:
    return gains.stiffness_n_per_m


def _dampers(gains: ToolGains) -> float:
    """Return what all dampers of a coupling damp together, N.s/m."""
    return gains.damping_ns_per_m + gains.local_damping_ns_per_m


def edge(stable: Callable[[float], bool], low: float, high: float, precision: float) -> float:
    """Return the limit between a stable value `low` and a larger one, to a ratio `precision`, bisected in logarithm.

    It doubles from `low` until a value is not `stable`; without any up to `high`, it is `high`.
    """
    while low < high:
        after = min(2 * low, high)
        if not stable(after):
            high = after
            break
        low = after
    else:
        return low
    while high > precision * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
