"""The law of least impedance error under conditions, by quadratic programs in a trust region.

Minimised is the merit, an exact penalty function: the largest error + sum of weight x what a condition misses. In each
step all values are linearised with their exact derivatives, and a quadratic program (DAQP, in CasADi) minimises the
linearised merit over changes of L that change Phi by no more than the reach; the reach grows where the merit falls as
predicted and shrinks where it does not. It is a method of the kind of Apkarian and Noll (IEEE Transactions on Automatic
Control 51, 2006): a local optimum of a structure that is fixed, from the given start, and never worse than the start.
It stops where a step promises less than `TrustRegionSettings.tolerance`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.design.conditions import Condition, ImpedanceError, Linearised
from avc_casadi.design.law_family import LawFamily, LawLoops


@dataclass(frozen=True)
class TrustRegionSettings:
    """Numbers of the method."""

    first_reach: float = 0.3
    """Relative change of Phi (root mean square) that the first step may make; a larger one trusts the model more."""
    largest_reach: float = 1.0
    smallest_reach: float = 1e-4
    """Below it the iteration ends."""
    accepted: float = 0.1
    """Share of the predicted decrease that a step must reach to be taken."""
    trusted: float = 0.7
    """Share from which on the reach doubles."""
    shrinks: float = 1 / 3
    """Factor on the reach after a step that is not taken."""
    tolerance: float = 5e-5
    """Decrease of the merit below which it stops, a share of the impedance. Less gives more digits of the optimum for
    more steps, the last of which rounding decides."""
    slow_steps: int = 3
    """Number of steps in a row with less than the tolerance after which it stops."""
    most_steps: int = 120
    renewed_gain: float = 1e-3
    """Decrease of the merit below which a search is not begun anew from its own end."""
    resolved: float = 1e-6
    """Directions of L that change Phi by less than this, relative to the strongest one, are left out: single precision
    cannot tell them apart, and without the bound L grows along them to 1e9."""


@dataclass(frozen=True, eq=False)
class TrustStep:
    """A solution of the quadratic program."""

    change: FloatArray  # of L
    merit: float  # predicted by the linearisation


class TrustRegion:
    """Minimises the impedance error of a family of laws."""

    def __init__(
        self,
        family: LawFamily,
        conditions: tuple[Condition, ...],
        settings: TrustRegionSettings | None = None,
    ) -> None:
        """Set up the search among the laws of a family for the least impedance error under conditions."""
        self.family, self.conditions = family, conditions
        self.settings = settings or TrustRegionSettings()
        self.objective = ImpedanceError()

    def merit(self, loops: LawLoops) -> float:
        """Return the largest impedance error + sum of weight x miss of each condition; infinite where unstable."""
        if not (np.isfinite(loops.gain).all() and loops.radius < 1):
            return math.inf
        missing = (condition.weight * max(0.0, condition.worst(loops)) for condition in self.conditions)
        return self.objective.largest(loops) + sum(missing)

    def minimised(self, start: FloatArray) -> LawLoops:
        """Return the law of least merit that steps from a stable gain L reach, never worse than the start.

        Each step minimises the linearised merit within the reach. It is taken where the merit falls by a tenth of what
        was promised; then the reach doubles from seven tenths on. Where it is not taken, the reach shrinks to a third.
        """
        settings = self.settings
        reach = settings.first_reach
        slow = 0
        best = self.family.at(start)
        best_merit = self.merit(best)
        for _ in range(settings.most_steps):
            axes = self._axes(best)
            taken = None
            while taken is None and reach > settings.smallest_reach:
                step = self._step(best, axes, reach)
                promised = 0.0 if step is None else best_merit - step.merit
                if step is not None and promised < settings.tolerance:
                    return best
                tried = None if step is None else self.family.at(best.gain + step.change)
                gained = -math.inf if tried is None else best_merit - self.merit(tried)
                if gained > settings.accepted * promised:
                    taken = tried
                    if gained > settings.trusted * promised:
                        reach = min(2 * reach, settings.largest_reach)
                else:
                    reach *= settings.shrinks
            if taken is None:
                return best
            slow = slow + 1 if gained < settings.tolerance else 0
            best, best_merit = taken, best_merit - gained
            if slow == settings.slow_steps:
                return best
        return best

    def renewed(self, loops: LawLoops) -> LawLoops:
        """Return the law of searches that begin anew, each at the end of the one before, until one gains nothing.

        A search ends at a small reach where the conditions that bind change from step to step. With the first reach
        again, the next one sees beyond them.
        """
        while True:
            again = self.minimised(loops.gain)
            if self.merit(loops) - self.merit(again) < self.settings.renewed_gain:
                return again
            loops = again

    def _axes(self, loops: LawLoops) -> FloatArray:
        """Return axes W of L, (n, r): a change W w changes Phi by |w| relative to itself, as a root mean square.

        Phi is the closed loop of a gain L at all frequencies and plants, of which W are the singular directions,
        scaled. Directions that single precision does not resolve are left out.
        """
        relative = self.family.coarse.phi / loops.phi_coarse[..., None]
        flat = relative.reshape(-1, relative.shape[-1])
        parts = np.concatenate([flat.real, flat.imag])
        scale = np.linalg.norm(parts, axis=0)
        _, values, axes = np.linalg.svd(parts / scale, full_matrices=False)
        resolved = values > self.settings.resolved * values[0]
        return np.asarray(axes[resolved].T / scale[:, None] * np.sqrt(len(flat)) / values[resolved])

    def _step(self, loops: LawLoops, axes: FloatArray, reach: float) -> TrustStep | None:
        """Return the change W w of the gain L that minimises the linearised merit within the reach.

        Each column of the axes W changes Phi, the closed loop, by 1 relative to itself (root mean square). None where
        the solver's answer does not hold.
        """
        program = _QuadraticProgram(axes, self.conditions, reach)
        program.require(self.objective.linearised(loops))
        for place, condition in enumerate(self.conditions):
            program.require(condition.linearised(loops, reach), place)
        program.bound(self.objective.relative_change_of_size(loops))
        return program.solved()


class _QuadraticProgram:
    """Variables w, then the error t, then what each condition misses."""

    CURVATURE = 1e-3
    """Of every variable, so that there is one minimiser. DAQP divides rows by its root: with 1e-6 for the error and
    what is missed, 102 of 2 189 programs came back with a row that does not hold, and the iteration ended there."""
    LARGEST_ERROR, LARGEST_MISS = 10.0, 50.0
    FEASIBLE = 1e-6  # what rounding may leave of a row
    SOLVER_TOLERANCE = 1e-10  # DAQP's own, 1e-6, counts in rows that it scales by the curvature: 1e-3 in ours

    def __init__(self, axes: FloatArray, conditions: tuple[Condition, ...], reach: float) -> None:
        """Begin a program over w, |w_i| up to the reach, by which the gain L changes as W w, W the axes.

        Further variables are the impedance error, and what each of the conditions misses.
        """
        self._axes = axes
        self._reach = reach
        self._directions = axes.shape[1]
        self._weights = np.array([1.0, *(condition.weight for condition in conditions)])
        self._rows: list[FloatArray] = []
        self._most: list[FloatArray] = []

    def require(self, values: Linearised, condition: int | None = None) -> None:
        """Require values + rows @ (change of L) to be at most the error, or what the condition of a number misses."""
        rows = np.zeros((len(values.values), self._directions + len(self._weights)))
        rows[:, : self._directions] = values.rows @ self._axes
        rows[:, self._directions + (0 if condition is None else 1 + condition)] = -1.0
        self._rows.append(rows)
        self._most.append(-values.values)

    def bound(self, changes: ComplexArray) -> None:
        """Require real and imaginary parts of complex changes to stay within the reach."""
        parts = np.concatenate([changes.real, changes.imag]) @ self._axes
        padded = np.pad(np.concatenate([parts, -parts]), ((0, 0), (0, len(self._weights))))
        self._rows.append(padded)
        self._most.append(np.full(len(padded), self._reach))

    def solved(self) -> TrustStep | None:
        """Return the step of L that minimises error + sum of weight x miss; None where the answer breaks a row."""
        rows, most = np.concatenate(self._rows), np.concatenate(self._most)
        misses = len(self._weights) - 1
        upper = np.concatenate(
            [np.full(self._directions, self._reach), [self.LARGEST_ERROR], np.full(misses, self.LARGEST_MISS)]
        )
        lower = np.concatenate([np.full(self._directions, -self._reach), np.zeros(1 + misses)])
        slope = np.concatenate([np.zeros(self._directions), self._weights])
        curvature = np.full(len(slope), self.CURVATURE)
        solution = _polished(_daqp(curvature, slope, rows, most, lower, upper), slope, rows, most, lower, upper)
        if not np.isfinite(solution).all() or (rows @ solution > most + self.FEASIBLE * (1 + np.abs(most))).any():
            return None
        return TrustStep(self._axes @ solution[: self._directions], float(slope @ solution))


def _daqp(
    curvature: FloatArray, slope: FloatArray, rows: FloatArray, most: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Minimise x'diag(curvature)x/2 + slope'x subject to rows x <= most and lower <= x <= upper.

    CasADi's DAQP through its buffers, which take no copies: a call with arrays costs more than the solution.
    """
    pattern = {"h": ca.Sparsity.dense(len(slope), len(slope)), "a": ca.Sparsity.dense(*rows.shape)}
    solver = ca.conic(
        "step", "daqp", pattern, {"error_on_fail": False, "daqp": {"primal_tol": _QuadraticProgram.SOLVER_TOLERANCE}}
    )
    inputs = {
        "h": np.diag(curvature).ravel(),
        "g": slope,
        "a": np.ravel(rows, order="F"),
        "lba": np.full(len(most), -np.inf),
        "uba": most,
        "lbx": lower,
        "ubx": upper,
    }
    buffer: Any  # CasADi's own annotations ask for the size too, which it takes from the memory
    buffer, evaluate = solver.buffer()
    for name, values in inputs.items():
        buffer.set_arg(solver.index_in(name), values.data)
    solution = np.full(len(slope), np.nan)
    buffer.set_res(solver.index_out("x"), solution.data)
    evaluate()
    return solution


_ACTIVE = 1e-7  # what a row may miss of its limit and still count as active


def _polished(
    solution: FloatArray, slope: FloatArray, rows: FloatArray, most: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return the solution x of the quadratic program with all its digits, by the equations of its active rows A x = b.

    With their multipliers y, the curvature c and the slope s these are

        c x + s + A' y = 0,   A x = b

    DAQP leaves 1e-9 of them, which thirty steps turn into other laws on other processors.
    """
    if not np.isfinite(solution).all():
        return solution
    unit = np.eye(len(slope))
    all_rows, limits = np.concatenate([rows, unit, -unit]), np.concatenate([most, upper, -lower])
    active = np.abs(all_rows @ solution - limits) <= _ACTIVE * (1 + np.abs(limits))
    held = all_rows[active]
    nothing = np.zeros((len(held), len(held)))
    conditions = np.block([[_QuadraticProgram.CURVATURE * unit, held.T], [held, nothing]])
    right = np.concatenate([-slope, limits[active]])
    polished = np.linalg.lstsq(conditions, right, rcond=1e-12)[0][: len(slope)]
    near = np.abs(polished - solution).max() <= 1e-5 * (1 + np.abs(solution).max())
    return polished if near and (all_rows @ polished <= limits + _ACTIVE * (1 + np.abs(limits))).all() else solution
