"""The schedule in numbers: states and their lattice, the constraints of each stage, and all stages as one NLP."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.claims.hands import ScopeSlack, deciding_frequencies_hz, scope_band_hz, scope_slack
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.wall import frozen_law, linear_stability
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import corner_problems, least_damped
from avc_casadi.paper.equations import ImpedanceLoop, coupling_impedance, loop_at
from avc_casadi.paper.numbers import Complex, ComplexExpr, Real, abs2, casadi_numbers
from avc_casadi.paper.realism import bound_magnitudes, relative_errors
from avc_casadi.paper.rows import GainArrays

FLOOR_SHARE = 1e-4
"""Floor of a state, of the smallest gain that weighs as much as the environment: it admits a gain of 0."""
CONTACT_FLOOR_RATIO = 10.0
"""Least floor of b_p, as a multiple of that of b."""
END_REACH = 1e-5
"""Distance of a state from its end, in the logarithm, within which its gain is the end: IPOPT only approaches it."""
SLOWEST_TURNS = 0.5e-4
"""Lowest frequency of a scope at which a slot is put between its ends, in turns a sample."""
NLP_SLOTS = 3
"""Frequencies between the ends of a scope in the NLP."""
SPREAD_SLOTS = {"band": 5, "all": 23}
"""Frequencies between the ends of a scope in the lattice, which adds none, by the scope."""
NEAREST_ZERO = 1e-7
"""Share of Nyquist's frequency that stands for 0, where an impedance is infinite."""
NEAREST_NYQUIST = 1e-9
"""Distance from Nyquist's frequency, as a share of it, that stands for it."""
LARGEST_STEP = 0.1
"""Largest |1 - spectral radius| in the table of the hands: a cubic spline would ring at a larger step."""
TABLE_NODES = {2: (64, 64), 3: (20, 20, 28)}
"""Nodes of the hands' table along each state, by the number of states; b_p, the sharpest, has more of them."""
SMALLEST_SPAN = 1e-3
"""Span, in the logarithm, that the hands' table gives to a state which cannot move: a spline needs several nodes."""
TARGET_SHARE = 1e-3
"""Share of |Z_h_ds| in the scale of Re Z_h."""
OUTSIDE_WEIGHT = 0.1
"""Weight of a frequency outside schedule.interaction_hz, against one inside."""
SMALLEST_RATIO = 1e-30
"""Added to |Z_h|^2/|Z_h_ds|^2 below a root, whose gradient is not a number at 0."""


@dataclass(frozen=True)
class States:
    """The map between gains and states, sigma = ln(gain + floor), and the box of both.

    Attributes:
        floors: floor of each gain, shape (d,): N.s/m, N/m, and N.s/m for b_p where it is admitted.
        least: lower end of each gain, shape (d,).
        most: upper end of each gain, shape (d,).
    """

    floors: FloatArray
    least: FloatArray
    most: FloatArray

    @classmethod
    def of(cls, problem: Problem, loop: ImpedanceLoop) -> States:
        """Return the map between gains and states for a problem at the frequencies of ``loop``, with its floors.

        The floor of b or k is 1e-4 of the smallest gain that weighs as much as the environment at some frequency. A
        floor admits a gain of 0, as a state is ln(gain + floor).
        """
        weight = np.abs(loop.environment)
        weight = np.where(weight > 0, weight, max(problem.device.damping_ns_per_m, 1.0))
        b_floor = FLOOR_SHARE * float(weight.min())
        k_floor = FLOOR_SHARE * float((weight / np.abs(coupling_impedance(loop.angle, 0.0, 1.0))).min())
        floors = [b_floor, k_floor]
        box = problem.coupling
        ends = [box.damping_ns_per_m, box.stiffness_n_per_m]
        if box.contact_damping_ns_per_m[1] > 0:
            floors.append(max(problem.device.damping_ns_per_m, CONTACT_FLOOR_RATIO * b_floor))
            ends.append(box.contact_damping_ns_per_m)
        least, most = np.array(ends).T
        return cls(np.array(floors), least, most)

    @property
    def low(self) -> FloatArray:
        """Lower ends of the states, (d,)."""
        return np.asarray(np.log(self.least + self.floors))

    @property
    def high(self) -> FloatArray:
        """Upper ends of the states, (d,)."""
        return np.asarray(np.log(self.most + self.floors))

    def within(self, low: FloatArray, high: FloatArray) -> States:
        """Return the states of a part of the box, between states of shape (d,) clipped to the box."""
        least = np.where(low > self.low, np.exp(low) - self.floors, self.least)
        most = np.where(high < self.high, np.exp(high) - self.floors, self.most)
        return replace(self, least=np.clip(least, self.least, self.most), most=np.clip(most, self.least, self.most))

    def lattice(self, points: Mapping[int, tuple[int, ...]]) -> tuple[list[FloatArray], FloatArray]:
        """Return the axes of a lattice over the box and its nodes, (d, m); ``points`` along each of d states."""
        ends = zip(self.low, self.high, points[len(self.floors)], strict=True)
        axes = [np.linspace(low, high, count if high > low else 1) for low, high, count in ends]
        return axes, np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])

    def gains(self, states: FloatArray) -> GainArrays:
        """Return (b, k, b_p) of states of shape (d, ...), inside the box to the last bit."""
        last = states.T
        inside = np.clip(np.exp(last) - self.floors, self.least, self.most)
        at_low_end = last <= self.low + END_REACH
        at_high_end = last >= self.high - END_REACH
        gains = np.where(at_low_end, self.least, np.where(at_high_end, self.most, inside)).T
        contact = gains[2] if len(gains) == 3 else np.zeros_like(gains[0])
        return gains[0], gains[1], contact

    def states(self, gains: GainArrays) -> FloatArray:
        """Return the states of (b, k, b_p), shape (d, ...), clipped to the box."""
        kept = np.array(gains[: len(self.floors)]).T
        return np.asarray(np.clip(np.log(kept + self.floors), self.low, self.high).T)


REALISM_ROWS = {"none": 0, "jnd": 1, "bounds": 2}
"""Number of non-negative values of each requirement."""


def deciding_corners(problem: Problem) -> tuple[Problem, ...]:
    """Return the problem at the critical corners of its device: all for hands, the least damped one for Re Z_h."""
    if problem.stability.scope == "hands":
        return corner_problems(problem)
    # Re Z_h does not depend on the mass and grows with the damping; the hand's is credited.
    return (least_damped(problem, problem.schedule.hand_damping_ns_per_m),)


def worst_slack(problem: Problem, frequency_hz: FloatArray, gains: GainArrays) -> ScopeSlack:
    """Return the exact slack of each row of gains over its whole scope, at the worst corner of the device.

    It is Re Z_h less the margin, N.s/m, at the frequency where it is least; with scope hands it is 1 - spectral radius.
    """
    corners = deciding_corners(problem)
    deciding = deciding_frequencies_hz(problem, frequency_hz)
    if deciding is not None:
        scope_hz = _evaluable(problem, deciding.T)
        real = loop_at(corners[0], scope_hz).perceived(*gains).real
        lowest = real.argmin(axis=0), np.arange(real.shape[1])
        return ScopeSlack(real[lowest] - problem.stability.margin_ns_per_m, scope_hz[lowest])
    all_slacks = [scope_slack(corner, frequency_hz, *gains) for corner in corners]
    slack = np.array([item.slack for item in all_slacks])
    worst = slack.argmin(axis=0), np.arange(slack.shape[1])
    return ScopeSlack(slack[worst], np.array([item.frequency_hz for item in all_slacks])[worst])


@dataclass
class Slots:
    """Frequencies at which Re Z_h is kept above the margin; violating ones are added until none is left.

    Attributes:
        frequency_hz: frequencies of each of n stages, shape (slots, n), Hz.
        fixed: number of slots, the first, that are never replaced.
    """

    frequency_hz: FloatArray
    fixed: int

    @classmethod
    def of(cls, problem: Problem, frequency_hz: FloatArray, *, spread: bool = False) -> Slots:
        """Return the critical frequencies, where known, or else the ends of each scope and some between."""
        if problem.stability.scope == "hands":
            return cls(np.empty((0, len(frequency_hz))), 0)
        deciding = deciding_frequencies_hz(problem, frequency_hz)
        if deciding is not None:
            return cls(_evaluable(problem, deciding.T), deciding.shape[1])
        low, high = scope_band_hz(problem, frequency_hz)
        lowest = np.minimum(np.maximum(low, SLOWEST_TURNS / problem.device.sample_time_s), high)
        count = SPREAD_SLOTS[problem.stability.scope] if spread else NLP_SLOTS
        between = np.geomspace(lowest, high, count + 2)[1:-1]
        return cls(_evaluable(problem, np.concatenate((low[None], high[None], between))), 2)

    def add(self, problem: Problem, gains: GainArrays, worst: ScopeSlack, missed: BoolArray) -> None:
        """Replace the least active frequency of each stage by its worst one, ``missed`` (n,)."""
        if len(self.frequency_hz) == self.fixed:
            return
        replaceable_hz = self.frequency_hz[self.fixed :]
        real = loop_at(deciding_corners(problem)[0], replaceable_hz).perceived(*gains).real
        slot = self.fixed + real.argmax(axis=0)
        stages = np.flatnonzero(missed)
        self.frequency_hz[slot[stages], stages] = _evaluable(problem, worst.frequency_hz[stages])


def _evaluable(problem: Problem, frequency_hz: FloatArray) -> FloatArray:
    """Return frequencies just inside 0 and Nyquist, where an impedance is infinite though its real part is not."""
    nyquist = 0.5 / problem.device.sample_time_s
    return np.asarray(np.clip(frequency_hz, NEAREST_ZERO * nyquist, (1 - NEAREST_NYQUIST) * nyquist))


def realism_values(problem: Problem, z: Complex, target: Complex, bounds: FloatArray | list[Real]) -> list[Real]:
    """Return what must not be negative, of symbols or arrays; ``bounds`` are those of |Z_h|^2 over |Z_h_ds|^2.

    jnd: 1 - |Z_h - Z_h_ds|^2/(rho |Z_h_ds|)^2; bounds: |Z_h|^2/|Z_h_ds|^2 less the lower one, the upper one less it.
    """
    if problem.realism.require == "jnd":
        return [1 - abs2(z - target) / (abs2(target) * problem.realism.jnd**2)]
    size2 = abs2(z) / abs2(target)
    return [size2 - bounds[0], bounds[1] - size2] if problem.realism.require == "bounds" else []


def relative_bounds(problem: Problem, loop: ImpedanceLoop) -> FloatArray:
    """Return least and largest |Z_h|^2 of the problem's bounds, over |Z_h_ds|^2, (2, n)."""
    return np.asarray((np.array(bound_magnitudes(problem, loop)) / np.abs(loop.target)) ** 2)


def realism_slack(problem: Problem, loop: ImpedanceLoop, gains: GainArrays) -> FloatArray:
    """Return the relative slack of gains, each (..., n), in the required realism at n frequencies; infinite if none."""
    if problem.realism.require == "none":
        return np.full(gains[0].shape, np.inf)
    target, bounds = np.asarray(loop.target), relative_bounds(problem, loop)
    return np.asarray(np.min(realism_values(problem, loop.perceived(*gains), target, bounds), axis=0))


def hands_slack(problem: Problem, states: States, nodes: FloatArray) -> FloatArray:
    """Return 1 - spectral radius of the frozen loop at nodes (d, m) of states, the least over all corners, shape (m,).

    Corners are those of the hands and of the device; the margin is taken off the device's damping.
    """
    b, k, contact = states.gains(nodes)
    hands = PlantFamily.of(problem).corner_hands
    margin = problem.stability.margin_ns_per_m
    slack = []
    for corner in deciding_corners(problem):
        left_damping = {"damping_ns_per_m": corner.device.damping_ns_per_m - margin}
        device = corner.device.model_copy(update=left_damping)
        radius = linear_stability(device, frozen_law(corner, b, k, contact), hands).radius
        slack.append(1 - radius.max(axis=1))
    return np.asarray(np.clip(np.min(slack, axis=0), -LARGEST_STEP, LARGEST_STEP))


@dataclass(frozen=True)
class HandsTable:
    """Slack of the worst hand on the lattice of the dynamic programme.

    Attributes:
        axes: nodes along each of the d states.
        nodes: all m nodes, shape (d, m).
        values: 1 - spectral radius at each node with the worst hand, shape (m,).
        spline: CasADi function of a state (d,): the interpolating cubic spline of the values.
    """

    axes: list[FloatArray]
    nodes: FloatArray
    values: FloatArray
    spline: Any

    @classmethod
    def of(cls, problem: Problem, states: States, points: Mapping[int, tuple[int, ...]] | None = None) -> HandsTable:
        """Return the table over the box of the states, with ``points`` along each of d states."""
        counts = (points or TABLE_NODES)[len(states.low)]
        axes = [
            np.linspace(low, high if high > low else low + SMALLEST_SPAN, count)
            for low, high, count in zip(states.low, states.high, counts, strict=True)
        ]
        nodes = np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
        values = hands_slack(problem, states, nodes)
        return cls(axes, nodes, values, _spline(axes, values.reshape([len(axis) for axis in axes])))


def _spline(axes: list[FloatArray], values: FloatArray) -> Any:
    """Return CasADi's interpolating cubic spline of values on a grid of axes.

    Its coefficients come from one axis after another, 300 times as fast as CasADi finds them.
    """
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - half a second that few designs need

    knots: list[list[float]] = []
    coefficients = values
    for place, axis in enumerate(axes):
        along = make_interp_spline(axis, np.moveaxis(coefficients, place, 0), k=3)
        knots.append(along.t.tolist())
        coefficients = np.moveaxis(along.c, 0, place)
    return ca.Function.bspline("hands", knots, coefficients.ravel(order="F").tolist(), [3] * len(axes), 1, {})


_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 400,
    # The starts are good: a larger barrier pushes them out of their basin, often into a worse one.
    "ipopt.mu_init": 1e-6,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
}
BACKOFF = 1e-7
"""Backoff of the NLP from scope (over the scale of Re Z_h) and realism, so that its tolerance never violates them."""
_HANDS_BACKOFF = 1e-6
"""The same from the scope hands, in spectral radius."""


@dataclass(frozen=True)
class Solution:
    """The result of one solution of the NLP.

    Attributes:
        states: states of n stages, shape (d, n).
        cost: the objective, infinite after a failure.
        failure: why the solver stopped early; empty where it did not.
        short: what each stage lacks, shape (n,), where that was minimised; else empty.
    """

    states: FloatArray
    cost: float
    failure: str = ""
    short: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Programme:
    """A schedule problem in numbers, and its NLP.

    Attributes:
        problem: the problem as stated.
        frequency_hz: frequencies of the n stages, increasing, shape (n,), Hz.
        states: the map between gains and states.
        hands: table of the worst hand, of scope hands alone.
        constant: whether all stages have the same gains.
        elastic: "scope" or "realism" where the violation of that is minimised in place of the error.
    """

    problem: Problem
    frequency_hz: FloatArray
    states: States
    hands: HandsTable | None
    constant: bool = False
    elastic: str = ""

    @classmethod
    def of(cls, problem: Problem, *, constant: bool = False) -> Programme:
        """Return the programme of a problem at its frequencies, which increase."""
        frequency = problem.frequencies_hz()
        states = States.of(problem, loop_at(problem, frequency))
        hands = HandsTable.of(problem, states) if problem.stability.scope == "hands" else None
        return cls(problem, frequency, states, hands, constant=constant)

    @cached_property
    def loop(self) -> ImpedanceLoop:
        """The loop at the stages."""
        return loop_at(self.problem, self.frequency_hz)

    @cached_property
    def scale_ns_per_m(self) -> FloatArray:
        """Scale of Re Z_h at each stage, (n,): the size of its terms."""
        target = np.asarray(self.loop.target)
        return np.asarray(self.problem.device.damping_ns_per_m + np.abs(target.real) + TARGET_SHARE * np.abs(target))

    @property
    def tolerance(self) -> float:
        """Backoff of each stage from its scope, in the scale of Re Z or in spectral radius."""
        return BACKOFF if self.hands is None else _HANDS_BACKOFF

    @cached_property
    def log_frequency(self) -> FloatArray:
        """ln(omega) up to a constant, (n,)."""
        return np.asarray(np.log(self.frequency_hz))

    @cached_property
    def weight(self) -> FloatArray:
        """Trapezoidal weights over ln(omega), a tenth outside the interaction frequencies; they sum to 1."""
        x = self.log_frequency
        weight = np.ones(1) if len(x) == 1 else np.convolve(np.diff(x), [0.5, 0.5])
        interaction = self.problem.schedule.interaction_hz
        if interaction is not None:
            inside = (self.frequency_hz >= interaction[0]) & (self.frequency_hz <= interaction[1])
            weight = np.where(inside, weight, OUTSIDE_WEIGHT * weight)
        return np.asarray(weight / weight.sum())

    @property
    def slope_limit(self) -> float:
        """Largest |d sigma/d ln(omega)|."""
        limit = self.problem.schedule.slope_limit
        return np.inf if limit is None else limit

    def errors(self, gains: GainArrays) -> FloatArray:
        """Return the stage cost, error^2 + contact_damping_penalty (b_p/|Z_h_ds|)^2, of gains (..., n) or (..., 1)."""
        goal = self.problem.realism
        target = np.asarray(self.loop.target)
        error = relative_errors(self.loop.perceived(*gains), target, goal.objective, goal.jnd)
        return np.asarray(error**2 + self.problem.schedule.contact_damping_penalty * (gains[2] / np.abs(target)) ** 2)

    def cost_of(self, path: FloatArray) -> float:
        """Return the NLP's objective at states (d, n): sum w_i l_i + (rho_s/X) sum (d sigma_i)^2/(d x_i)."""
        goal = float(self.errors(self.states.gains(path)) @ self.weight)
        if self.constant or path.shape[1] == 1:
            return goal
        step = np.diff(self.log_frequency)
        roughness = float((np.diff(path, axis=1) ** 2 / step).sum() / step.sum())
        return goal + self.problem.schedule.slope_penalty * roughness

    def spare(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what states (d, n) leave of the scope, exactly, in the unit of `tolerance`, and of realism."""
        gains = self.states.gains(path)
        slack = worst_slack(self.problem, self.frequency_hz, gains).slack
        realism = realism_slack(self.problem, self.loop, gains)
        return slack if self.hands is not None else slack / self.scale_ns_per_m, realism

    def at(self, rows: BoolArray) -> Programme:
        """Return the programme of some stages."""
        return replace(self, frequency_hz=self.frequency_hz[rows])

    def solve(self, slots: Slots, backoff: FloatArray, start: FloatArray) -> Solution:
        """Solve the NLP from states (d, n), with a ``backoff`` of each stage from scope and realism, (2, n).

        Constraints: Re Z_h over its scale at each slot no less than margin + backoff, the values of realism, 1 -
        spectral radius, and slopes within their limit.
        """
        d, n = start.shape
        columns = 1 if self.constant else n
        low = np.repeat(self.states.low[:, None], columns, axis=1)
        high = np.repeat(self.states.high[:, None], columns, axis=1)
        begin = np.clip(start[:, :columns], low, high)
        margin = self.problem.stability.margin_ns_per_m / self.scale_ns_per_m
        lower_bounds = [margin + backoff[0]] * len(slots.frequency_hz)
        lower_bounds += [backoff[1]] * REALISM_ROWS[self.problem.realism.require]
        lower_bounds += [backoff[0]] * (self.hands is not None)
        least = np.array(lower_bounds).reshape(-1, n)
        slopes = np.full(d * (n - 1) if self._steep else 0, self.slope_limit)
        short = np.full(n if self.elastic else 0, self.tolerance)
        bounds = relative_bounds(self.problem, self.loop)
        parameters = np.array((self.frequency_hz, self.scale_ns_per_m, *bounds, *slots.frequency_hz))
        # CasADi warns of the evaluation interrupted by Ctrl-C; other faults show in the exact checks.
        with contextlib.redirect_stderr(io.StringIO()):
            result = self._solver(
                x0=np.concatenate((begin.ravel("F"), 1 + short)),
                p=parameters,
                lbx=np.concatenate((low.ravel("F"), -2 * short)),
                ubx=np.concatenate((high.ravel("F"), np.inf + short)),
                lbg=np.concatenate((least.ravel("F"), -slopes)),
                ubg=np.concatenate((np.full(least.size, np.inf), slopes)),
            )
        stats = self._solver.stats()
        if stats["return_status"] == "NonIpopt_Exception_Thrown":  # which Ctrl-C is to IPOPT
            raise KeyboardInterrupt
        variables = result["x"].full()[:, 0]
        states = variables[: d * columns].reshape((d, columns), order="F")
        return Solution(
            states=np.repeat(states, n // columns, axis=1),
            cost=float(result["f"]) if stats["success"] else np.inf,
            failure="" if stats["success"] else str(stats["return_status"]),
            short=variables[d * columns :],
        )

    @property
    def _steep(self) -> bool:
        """Whether slopes are limited."""
        return np.isfinite(self.slope_limit) and len(self.frequency_hz) > 1 and not (self.constant or self.elastic)

    def _stage(self, slots: int) -> Any:
        """Return the function (sigma, parameters) -> cost, margins of one frequency.

        sigma are the states ln(gain + floor); the parameters are frequency, scale of Re Z_h, bounds of realism, and the
        frequencies of the slots. The cost is the squared relative error of Z_h + the penalty on b_p. The margins are Re
        Z_h over its scale at each slot, then the values of realism.
        """
        problem = self.problem
        goal = problem.realism
        sigma = ca.SX.sym("sigma", len(self.states.floors))
        given = ca.SX.sym("given", 4 + slots)
        frequency, scale, *bounds = ca.vertsplit(given[:4])
        gains = [ca.exp(state) - floor for state, floor in zip(ca.vertsplit(sigma), self.states.floors, strict=True)]
        b, k, contact = (*gains, ca.SX(0))[:3]
        numbers = casadi_numbers()
        loop = loop_at(problem, frequency, numbers)
        z = loop.perceived(b, k, contact)
        target = loop.target
        cost = _error(goal.objective, z, target, goal.jnd)
        cost += problem.schedule.contact_damping_penalty * contact * contact / abs2(target)
        corner = deciding_corners(problem)[0]
        margins = [
            loop_at(corner, given[4 + slot], numbers).perceived(b, k, contact).real / scale for slot in range(slots)
        ]
        margins += realism_values(problem, z, target, bounds)
        return ca.Function("stage", [sigma, given], [cost, ca.vertcat(ca.SX(0, 1), *margins)], {"cse": True})

    @cached_property
    def _solver(self) -> Any:
        """IPOPT for all stages, or for what they lack where `elastic`; the frequencies of the scopes are parameters.

        The objective is the weighted sum of the costs + slope penalty x mean square of d sigma/d ln(omega).
        """
        slots = len(Slots.of(self.problem, self.frequency_hz).frequency_hz)
        d = len(self.states.floors)
        n = len(self.frequency_hz)
        x = ca.MX.sym("x", d, 1 if self.constant else n)
        given = ca.MX.sym("given", 4 + slots, n)
        sigma = ca.repmat(x, 1, n) if self.constant else x
        cost, margins = self._stage(slots).map(n)(sigma, given)
        if self.hands is not None:
            margins = ca.vertcat(margins, self.hands.spline.map(n)(sigma))
        short = ca.MX.sym("short", 1, n if self.elastic else 0)
        if self.elastic:
            rows = np.zeros(margins.shape[0])
            rows[slots : slots + REALISM_ROWS[self.problem.realism.require]] = 1.0
            margins += ca.mtimes(ca.DM(rows if self.elastic == "realism" else 1 - rows), short)
            nlp = {"x": ca.veccat(x, short), "f": ca.sum2(short), "g": ca.vec(margins), "p": given}
            return ca.nlpsol("shortest", "ipopt", nlp, _OPTIONS)
        goal = ca.dot(cost, ca.DM(self.weight).T)
        limits = []
        if n > 1 and not self.constant:
            step = ca.repmat(ca.DM(np.diff(self.log_frequency)).T, d)
            move = x[:, 1:] - x[:, :-1]
            goal += self.problem.schedule.slope_penalty / np.ptp(self.log_frequency) * ca.dot(move, move / step)
            limits = [ca.vec(move / step)] if self._steep else []
        nlp = {"x": ca.vec(x), "f": goal, "g": ca.vertcat(ca.vec(margins), *limits), "p": given}
        return ca.nlpsol("schedule", "ipopt", nlp, _OPTIONS)


def _error(objective: str, z: ComplexExpr, target: ComplexExpr, noticeable: Real) -> Real:
    """Return the squared relative error of Z_h from the target Z_t, by the objective.

    magnitude: (1 - |Z_h|/|Z_t|)^2; complex: |Z_h - Z_t|^2/|Z_t|^2; otherwise the part of this error above the
    noticeable one, (error/noticeable - 1)^2.
    """
    error2 = abs2(z - target) / abs2(target)
    if objective == "magnitude":
        return (1 - ca.sqrt(abs2(z) / abs2(target) + SMALLEST_RATIO)) ** 2
    if objective == "complex":
        return error2
    return (ca.sqrt(ca.fmax(error2 / noticeable**2, 1.0)) - 1) ** 2
