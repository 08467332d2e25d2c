"""Spring and damper between a device and a virtual tool: the stiffest stable ones, the best damper, the certificate."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi.claims.engine_port import engine_port
from avc_casadi.loops.engine import ToolLoops, tool_of
from avc_casadi.loops.follower import FollowerLoops
from avc_casadi.loops.system import Loops, WithMargin
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class ToolSearchOptions:
    """Numbers of the search."""

    # Dampers B tried before the best are refined: the limit of K over B has several humps, some no wider than a third.
    dampers: int = 49
    precision: float = 5e-3
    # Dampers of the device's local loop, as damping ratios of the released device on K: above 1 it only creeps back.
    local_ratios: tuple[float, ...] = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0)


DEFAULT_OPTIONS = ToolSearchOptions()
WIDEST_MARGIN = 4.0
"""Upper limit of the gain margins that are searched."""
# Share of the stiffest K from which a local maximum over B is refined.
_HUMP = 0.5


@dataclass(frozen=True)
class Scale:
    """Scales of the search."""

    mass_kg: float
    damping_ns_per_m: float
    sample_time_s: float
    slow_s: float

    @classmethod
    def of(cls, problem: Problem, slow_s: float) -> Scale:
        """Return the scales of a problem's device, with its lightest hand where it has no mass."""
        device = problem.device
        lightest = device.mass_kg if device.range.mass_kg is None else device.range.mass_kg[0]
        mass = lightest or max(problem.hands.mass_kg[0], 1e-6)
        damping = device.damping_ns_per_m if device.range.damping_ns_per_m is None else device.range.damping_ns_per_m[0]
        return cls(mass, damping, device.sample_time_s, max(slow_s, device.sample_time_s))

    def dampers_ns_per_m(self, options: ToolSearchOptions = DEFAULT_OPTIONS) -> FloatArray:
        """Return the dampers B that are tried, in increasing order."""
        return self.mass_kg / self.sample_time_s * np.geomspace(1e-4, 1.0, options.dampers)


class CouplingSearch:
    """Search for a spring and damper that stabilise all loops."""

    def __init__(
        self, loops: Loops, scale: Scale, options: ToolSearchOptions = DEFAULT_OPTIONS, least: float = 1.0
    ) -> None:
        self.loops, self.scale, self.options, self.least = loops, scale, options, least
        self.deployable = self._with(least)

    @cached_property
    def dampers_ns_per_m(self) -> FloatArray:
        """Dampers B tried, in increasing order."""
        return self.scale.dampers_ns_per_m(self.options)

    @property
    def stiffest_n_per_m(self) -> float:
        """Stiffness at which a search ends: that of a mass that oscillates faster than T resolves."""
        return 10 * self.scale.mass_kg / self.scale.sample_time_s**2

    @property
    def _softest_n_per_m(self) -> float:
        """Stiffness below which a coupling counts as none."""
        return 1e-5 * self.scale.mass_kg / self.scale.slow_s**2

    @property
    def softest(self) -> ToolGains:
        """The softest coupling searched, with the middle damper."""
        return ToolGains(self._softest_n_per_m, float(self.dampers_ns_per_m[self.options.dampers // 2]))

    def stiffest(self, local_damping_ns_per_m: float = 0.0) -> ToolGains:
        """Return the stiffest K up to which every loop is stable, with its best B; 0 where there is none."""
        return self._summit(lambda b, k: ToolGains(k, b, local_damping_ns_per_m))

    def stiffest_beside_local_damper(self) -> ToolGains:
        """Return the stiffest K, with its B, where the local loop damps the released device up to critically."""

        def beside(ratio: float) -> ToolGains:
            return self._summit(lambda b, k: ToolGains(k, b, self._local(k, ratio)))

        # The limit hardly varies between neighbours of these ratios: every other one suffices.
        found = [self.stiffest(), *map(beside, self.options.local_ratios[1::2])]
        return max(found, key=lambda one: one.stiffness_n_per_m)

    def _local(self, stiffness_n_per_m: float, ratio: float) -> float:
        """Return the damper that, with the device's own, gives a damping ratio when released on a spring."""
        critical = 2 * math.sqrt(stiffness_n_per_m * self.scale.mass_kg)
        return max(0.0, ratio * critical - self.scale.damping_ns_per_m)

    def stiffest_with_margin(self, limit: ToolGains, gain_margin: float, *, local: bool) -> float:
        """Return the stiffest K that has a gain margin with some B; 0 where none has."""
        judge, below = self._with(gain_margin), limit.times(1 / gain_margin)
        if below.stiffness_n_per_m > 0 and judge.stable(below) and not judge.has_counterexample(below):
            return below.stiffness_n_per_m
        # A trial begins at a share of it: every other damper suffices.
        search = CouplingSearch(judge, self.scale, replace(self.options, dampers=self.options.dampers // 2 + 1))
        return (search.stiffest_beside_local_damper() if local else search.stiffest()).stiffness_n_per_m

    def _summit(self, gains: Callable[[float, float], ToolGains]) -> ToolGains:
        """Return the gains of a damper and a spring with the stiffest K that no search of the ranges refutes."""
        limits: list[float] = []
        for _ in range(20):  # each search of the ranges adds a loop or some; few are needed
            limits = self._lowered(gains, limits) if limits else self._limits(gains)
            found = self._top(gains, limits)
            softer = (replace(found, stiffness_n_per_m=share * found.stiffness_n_per_m) for share in (0.99, 0.8))
            if not found.stiffness_n_per_m or not any(self.loops.has_counterexample(one) for one in softer):
                return found
        return gains(0.0, 0.0)

    def _limits(self, gains: Callable[[float, float], ToolGains]) -> list[float]:
        """Return roughly the stiffest stable K of each damper."""
        limits: list[float] = []
        for damping in self.dampers_ns_per_m.tolist():
            before = limits[-1] if limits else 0.0
            limits.append(self._followed(partial(gains, damping), before, self.stiffest_n_per_m))
        return limits

    def _lowered(self, gains: Callable[[float, float], ToolGains], before: list[float]) -> list[float]:
        """Return the limits where loops were added; those that stay below a hump are left as they were."""
        limits, top, low = before.copy(), 0.0, self._softest_n_per_m
        for place in sorted(range(len(before)), key=lambda at: -before[at]):
            if before[place] <= max(low, _HUMP * top):
                break
            one = partial(gains, float(self.dampers_ns_per_m[place]))
            limits[place] = self._followed(one, before[place], before[place])
            top = max(top, limits[place])
        return limits

    def _top(self, gains: Callable[[float, float], ToolGains], limits: list[float]) -> ToolGains:
        """Return the gains with the stiffest stable K: every hump of the limit is refined."""
        dampers = self.dampers_ns_per_m.tolist()
        least, ends = _HUMP * max(limits), [0.0, *limits, 0.0]
        humps = [
            place
            for place, (before, here, after) in enumerate(zip(ends, limits, ends[2:], strict=False))
            if here > 0 and here >= least and before <= here >= after
        ]
        found = [one for place in humps for one in self._refined(gains, dampers[place], limits[place])]
        best = gains(0.0, 0.0)
        for limit, damping in sorted(found, reverse=True):
            if limit <= best.stiffness_n_per_m:
                break
            checked = self._without_gaps(partial(gains, damping), limit)
            best = max(best, checked, key=lambda one: one.stiffness_n_per_m)
        return best

    def _refined(
        self, gains: Callable[[float, float], ToolGains], damping_ns_per_m: float, limit_n_per_m: float
    ) -> list[tuple[float, float]]:
        """Return limits with their dampers, from one damper to its neighbours on both sides."""
        from scipy.optimize import minimize_scalar  # noqa: PLC0415 - as long as all that `avc check` needs

        fine = 1 + self.options.precision
        found = [(self._limit(partial(gains, damping_ns_per_m), limit_n_per_m, fine), damping_ns_per_m)]

        def softness(logarithm: float) -> float:
            damping = math.exp(logarithm)
            limit = self._limit(partial(gains, damping), max(found)[0], fine)
            found.append((limit, damping))
            return -limit

        ratio, middle = math.log(self.dampers_ns_per_m[1] / self.dampers_ns_per_m[0]), math.log(damping_ns_per_m)
        minimize_scalar(
            softness,
            bounds=(middle - ratio, middle + ratio),
            method="bounded",
            options={"maxiter": 16, "xatol": 2e-3},  # humps have a sharp edge
        )
        return found

    def damped(self, stiffness_n_per_m: float, *, local: bool = False, gain_margin: float = 1.0) -> list[ToolGains]:
        """Return K with dampers to try: that of best damping ratio, lighter ones of half of it, the heaviest."""
        # A light one transmits less of the encoder's steps. In a contact that rings by itself all are equally good:
        # there the heaviest damps the other modes.
        stable = list(filter(self.deployable.stable, self._tried(stiffness_n_per_m, local=local)))
        if not stable:
            return []
        safe = list(filter(self._with(gain_margin).stable, stable))
        if not safe:
            return [max(stable, key=self.gain_margin)]
        ratios = [self.loops.slowest(one).damping_ratio for one in safe]
        good, half, quarter = (
            [one for one, ratio in zip(safe, ratios, strict=True) if ratio >= 0.9 * part * max(ratios)]
            for part in (1.0, 0.5, 0.25)
        )
        best, heaviest = max(good, key=self.gain_margin), max(good, key=_dampers)
        lighter = [min(some, key=_dampers) for some in (half, quarter)]
        return list(dict.fromkeys((best, *lighter, heaviest)))

    def held(self, stiffness_n_per_m: float, *, local: bool = False, inside: bool = True) -> ToolGains | None:
        """Return gains of this K with which every loop, at corners or inside too, has its least margins, or None."""
        tried = self._tried(stiffness_n_per_m, local=local)
        order = sorted(range(len(tried)), key=lambda at: abs(at - len(tried) / 2))
        safe = filter(self.deployable.stable, (tried[at] for at in order))
        return next((one for one in safe if not (inside and self.deployable.has_counterexample(one))), None)

    def has_counterexample(self, gains: ToolGains, gain_margin: float) -> bool:
        """Return whether a search of the ranges refutes gains with their margin; without it where they have none."""
        judge = self._with(gain_margin)
        return (judge if judge.stable(gains) else self.deployable).has_counterexample(gains)

    def _with(self, gain_margin: float) -> WithMargin:
        return WithMargin(self.loops, max(gain_margin, self.least), self.least)

    def _tried(self, stiffness_n_per_m: float, *, local: bool) -> list[ToolGains]:
        """Return the couplings of one stiffness to try."""
        locals_ = {0.0, *(self._local(stiffness_n_per_m, ratio) for ratio in self.options.local_ratios if local)}
        return [
            ToolGains(stiffness_n_per_m, damping, beside)
            for beside in sorted(locals_)
            for damping in ([0.0] if local else []) + self.dampers_ns_per_m.tolist()
        ]

    def gain_margin(self, gains: ToolGains, motor: int | None = None) -> float:
        """Return the gain margin of K and B, or of one motor alone, with all known loops; 0 where they are unstable."""
        if not self.loops.stable(gains):
            return 0.0
        fine = 1 + self.options.precision
        return edge(lambda factor: self.loops.stable(gains.times(factor, motor)), 1.0, WIDEST_MARGIN, fine)

    def gain_margin_over_ranges(self, gains: ToolGains, motor: int | None = None) -> float:
        """Return the gain margin of K and B, or of one motor alone, once no search of the ranges refutes it."""
        found = self.gain_margin(gains, motor)
        while found and self.loops.has_counterexample(gains.times(found / (1 + self.options.precision), motor)):
            found = self.gain_margin(gains, motor)
        return found

    def margins(self, gains: ToolGains) -> dict[str, Any]:
        """Return the gain margins of K and B at both ends, and of the device's motor alone and the follower's."""
        each = [self.gain_margin_over_ranges(gains, motor) for motor in range(self.loops.motors)]
        return {"gain_margin": self.gain_margin_over_ranges(gains), "motor_margins": each}

    def why_not(self, gains: ToolGains) -> str:
        """Return why gains should not run on a device; empty where they may."""
        thin = f"linearly stable with a gain margin below {self.least:g}, of K and B or of one motor alone"
        claims: dict[str, Loops] = {"linearly unstable": self.loops, thin: self.deployable}
        return next((why for why, one in claims.items() if not one.stable(gains) or one.has_counterexample(gains)), "")

    def local_dampers_ns_per_m(self, gains: ToolGains) -> tuple[float, float]:
        """Return the range of the damper in the device's local loop with which K and B stay stable."""
        top, here = float(self.dampers_ns_per_m[-1]), gains.local_damping_ns_per_m

        def stable(damping: float) -> bool:
            return self.loops.stable(replace(gains, local_damping_ns_per_m=damping))

        start = here if here > 0 else float(self.dampers_ns_per_m[0])
        if not stable(start):
            return here, here
        most = edge(stable, start, top, 1 + self.options.precision)
        if stable(0.0):
            return 0.0, most
        least = start / edge(lambda part: stable(start / part), 1.0, start / (1e-6 * top), 1 + self.options.precision)
        return least, most

    def _edge(self, gains: Callable[[float], ToolGains], low: float, high: float, precision: float = 1.05) -> float:
        return edge(lambda k: self.loops.stable(gains(k)), low, high, precision)

    def _followed(self, gains: Callable[[float], ToolGains], before_n_per_m: float, most_n_per_m: float) -> float:
        """Return roughly the largest K up to which softer ones are stable, from the limit with the damper before."""
        low = self._softest_n_per_m
        if not self.loops.stable(gains(low)):
            return 0.0
        for high in (share * before_n_per_m for share in (1 / 64, 1 / 16, 1 / 4, 1.0)):
            if high > low:
                if not self.loops.stable(gains(high)):
                    return self._edge(gains, low, high)
                low = high
        return self._edge(gains, low, most_n_per_m)

    def _limit(self, gains: Callable[[float], ToolGains], near: float, precision: float) -> float:
        """Return the largest stable K near an initial guess, 0 where there is none."""
        low = near
        while not self.loops.stable(gains(low)):
            low /= 2**0.5
            if low < self._softest_n_per_m:
                return 0.0
        high = near if low < near else self.stiffest_n_per_m
        return self._edge(gains, low, high, precision)

    def _without_gaps(self, gains: Callable[[float], ToolGains], limit: float) -> ToolGains:
        """Return the gains at a limit, or below a gap in which a softer coupling is unstable with the same dampers."""
        count = math.ceil(math.log(50) / math.log(1.25))
        softer = (limit * np.geomspace(0.02, 1.0, count + 1)).tolist()
        if not self.loops.stable(gains(softer[0])):
            return gains(0.0)
        for before, after in itertools.pairwise(softer):
            if not self.loops.stable(gains(after)):
                return gains(self._edge(gains, before, after, 1 + self.options.precision))
        return gains(limit)


class ToolSearch(CouplingSearch):
    """Search for couplings of one problem with [simulation]."""

    loops: ToolLoops

    def __init__(
        self, problem: Problem, options: ToolSearchOptions = DEFAULT_OPTIONS, beside: Sequence[Hand] = ()
    ) -> None:
        self.loops = ToolLoops(problem, beside)
        super().__init__(
            self.loops, Scale.of(problem, max(self.loops.tool.step_s)), options, problem.robustness.gain_margin
        )

    @cached_property
    def limit(self) -> tuple[ToolGains, bool]:
        """The stiffest that is stable, and whether a damper of the device's loop belongs to it."""
        tool, local = self.loops.tool, self.loops.tool.damped_locally
        stiffest = self.stiffest_beside_local_damper() if local else self.stiffest()
        if not local and tool.stiffness_n_per_m is not None and tool.stiffness_n_per_m > stiffest.stiffness_n_per_m:
            return self.stiffest_beside_local_damper(), True
        return stiffest, local


class FollowerSearch(CouplingSearch):
    """Search for couplings of one problem with [follower]."""

    loops: FollowerLoops

    def __init__(self, problem: Problem) -> None:
        self.loops = FollowerLoops(problem)
        slow_s = max(sum(one) for one in self.loops.follower.delays_s)
        # Long delays make large matrices, so fewer dampers are tried.
        few = ToolSearchOptions(dampers=13, local_ratios=(0.2, 0.5, 1.0), precision=0.01)
        super().__init__(self.loops, Scale.of(problem, slow_s), few, problem.robustness.gain_margin)


def _dampers(gains: ToolGains) -> float:
    return gains.damping_ns_per_m + gains.local_damping_ns_per_m


def edge(stable: Callable[[float], bool], low: float, high: float, precision: float) -> float:
    """Return the stability limit between a stable value and a larger one, bisected in the logarithm."""
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


def certify_pair(problem: Problem, gains: ToolGains, search: ToolSearch | FollowerSearch) -> dict[str, Any]:
    """Return the certificate: JSON values, stability and passivity apart."""
    stable, (radius, case) = search.loops.stable_over_ranges(gains), search.loops.radius(gains)
    found: dict[str, Any] = plain(
        {
            "stable": stable,
            "spectral_radius": radius,
            "worst": asdict(case),
            "loops": len(search.loops),
            **search.margins(gains),
            "least_damped": asdict(search.loops.slowest(gains)) if stable else None,
            "claim": (
                "linear stability of the lifted loop: hands of [hands] and the device released, devices, tools, "
                "delays, steady steps and contacts of their ranges (corners, then a search for the worst point "
                "inside), every phase of the clocks (one where a step is a whole number of samples: it begins at a "
                "sample)"
            ),
            "passivity": {} if problem.simulation is None else _passivity(problem, gains),
        }
    )
    return found


def _passivity(problem: Problem, gains: ToolGains) -> dict[str, Any]:
    claim = (
        "the port at which the engine meets the coupling is passive, with the corner hands of [hands] and released: "
        "stable with any engine that is passive there, whatever its tool weighs and touches. Such an engine solves the "
        "tool together with the coupling's force (implicit); one that moves a mass explicitly is none, however heavy"
    )
    try:
        port = engine_port(problem.device, problem.hands, tool_of(problem), gains)
    except UnsupportedError as refusal:
        return {"passive": None, "refused": str(refusal), "claim": claim}
    return {**asdict(port), "refused": None, "claim": claim}
