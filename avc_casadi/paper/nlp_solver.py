"""Solve the CasADi NLP one frequency at a time, from several fixed starts, then break the ties of (11)."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.interrupt import HeldInterrupt
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.corners import margin_over_range
from avc_casadi.paper.backends import Backend, backend
from avc_casadi.paper.equations import coupling_impedance
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.nlp import coupling_nlp, nlp_parameters
from avc_casadi.paper.rows import GainArrays, best_candidate, guarded_margin

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


@contextlib.contextmanager
def silent_terminal(*, active: bool) -> Iterator[None]:
    """Send what is written to standard output and error to nowhere, whether by Python or by a library.

    Args:
        active: whether to do so at all.
    """
    if not active:
        yield
        return
    sys.stdout.flush()
    sys.stderr.flush()
    with contextlib.ExitStack() as stack:
        nowhere = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123 - not a real path
        for number in (1, 2):
            kept = os.dup(number)
            stack.callback(_restore, kept, number)
            os.dup2(nowhere.fileno(), number)
        stack.enter_context(contextlib.redirect_stdout(nowhere))
        stack.enter_context(contextlib.redirect_stderr(nowhere))
        yield


def _restore(kept: int, number: int) -> None:
    # A library's own buffer would otherwise be written to the terminal later.
    with contextlib.suppress(OSError, TypeError, AttributeError):
        ctypes.CDLL(None).fflush(None)
    os.dup2(kept, number)
    os.close(kept)


_STARTS = np.array([(0.5, 0.5, 0.0), (0.95, 0.95, 0.5), (0.05, 0.05, 0.05), (0.95, 0.05, 0.0), (0.05, 0.95, 0.5)])
"""Fixed starts as shares x = t/(c + t) of each gain t, c its natural scale; the solution of the frequency before is one
more start."""
_ROOT = 1e-4
"""A magnitude error below this share of |Z_h_ds| counts as a curve of minimisers, whose ties are then broken."""
_LAST_SHARE = 1.0 - 2.0**-52


@dataclass(frozen=True)
class Found:
    """What a solver returned.

    Attributes:
        gains: best strictly feasible (b, k, b_p), each (n,); not a number where it found none.
        false_success: how often the solver reported success with a point that violates (12) by more than its
            tolerance.
        calls: how often it was called.
    """

    gains: GainArrays
    false_success: int
    calls: int


@dataclass(frozen=True)
class _Solvers:
    """CasADi functions of one backend: (11)-(12), its tie-break, and the squared relative error of given gains."""

    backend: Backend
    direct: Any
    tie_break: Any


@lru_cache(maxsize=16)
def nlp_solvers(name: str, tolerance: float) -> _Solvers:
    """Build the solvers of (11)-(12) and of its tie-break, once for each backend and tolerance.

    The tie-break minimises |Z_h_avc - Z_h_ds|^2 on the curve |Z_h_avc|^2 = |Z_h_ds|^2, always in shares.

    Raises:
        InputError: unknown backend.
        UnsupportedError: this CasADi was built without it.
    """
    chosen = backend(name)
    nlp = coupling_nlp()
    share, scales = ca.SX.sym("x", 3), nlp.parameters[-3:]
    gains = scales * share / (1 - share)
    radius2 = _radius2()
    # In shares (12) is the division-free polynomial times ((1 - x_b)(1 - x_k))^2, which is of the order of |Z_h_ds|.
    even = ((1 - share[0]) * (1 - share[1])) ** 2 / (scales[0] ** 2 * ca.sqrt(radius2))
    on_curve = (nlp.impedance.real**2 + nlp.impedance.imag**2 - nlp.target.real**2 - nlp.target.imag**2) / radius2

    def solver(label: str, variables: Any, goal: Any, constraints: Any) -> Any:
        problem = {"x": variables, "f": goal, "g": constraints, "p": nlp.parameters}
        try:
            return ca.nlpsol(label, chosen.plugin, problem, chosen.options(tolerance))
        except RuntimeError as error:
            raise UnsupportedError(
                f"solver {name} cannot be used: {_last_line(error)}; avc doctor lists those that can"
            ) from error

    if chosen.coordinates == "gains":
        direct = solver("direct", nlp.gains, nlp.objective, nlp.constraint_polynomial)
    else:
        goal, limit = ca.substitute([nlp.objective / radius2, nlp.constraint_polynomial], [nlp.gains], [gains])
        direct = solver("direct", share, goal, limit * even)
    goal, limit, curve = ca.substitute(
        [nlp.distance / radius2, nlp.constraint_polynomial, on_curve], [nlp.gains], [gains]
    )
    return _Solvers(chosen, direct, solver("tie_break", share, goal, ca.vertcat(limit * even, curve)))


def _radius2() -> Any:
    """|Z_h_ds|^2, but 1 where it is 0."""
    target = coupling_nlp().target
    radius2 = target.real**2 + target.imag**2
    return radius2 + (radius2 == 0)


@cache
def _relative_error2() -> Any:
    nlp = coupling_nlp()
    return ca.Function("relative_error2", [nlp.gains, nlp.parameters], [nlp.objective / _radius2()])


def _last_line(error: Exception) -> str:
    return str(error).strip().splitlines()[-1]


def nlp_gains(
    problem: Problem,
    loop: Loop,
    name: str,
    tolerance: float,
    starts: FloatArray = _STARTS,
    progress: Progress = SILENT,
) -> Found:
    """Solve every frequency by a CasADi solver; that of a device that turns as felt at its handle.

    Tolerances of solvers are absolute, and what is of the order of 1 in N.s/m is nothing in N.m.s/rad.

    Args:
        problem: the problem.
        loop: its loop.
        name: the backend.
        tolerance: relative tolerance asked of it.
        starts: fixed starts as shares, shape (m, 3).
        progress: told of the frequencies.

    Raises:
        KeyboardInterrupt: Ctrl-C, whatever the solver made of it.
    """
    solvers = nlp_solvers(name, tolerance)
    size = problem.device.metres_per_unit**2
    parameters = nlp_parameters(problem, loop, size)
    box = problem.coupling
    bounds = np.array([box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m]) / size
    points: list[FloatArray] = []
    claims: list[BoolArray] = []
    calls = 0
    before = starts[0]
    with silent_terminal(active=solvers.backend.prints):
        for values in parameters.T:
            run = _Run(solvers, values, bounds)
            # Where a handler of somebody else takes Ctrl-C without ending anything, the next frequency follows.
            with HeldInterrupt():
                for start in (*starts, before):
                    run.solve_from(start)
            before = run.best_share()
            points.append(np.array(run.points))
            claims.append(np.array(run.claims))
            calls += run.calls
            progress.advance(len(points), parameters.shape[1], "frequencies")
    most = max(len(row) for row in points)
    found = np.full((most, 3, len(points)), np.nan)
    claimed = np.zeros((most, len(points)), dtype=bool)
    for row, (some, claim) in enumerate(zip(points, claims, strict=True)):
        found[: len(some), :, row], claimed[: len(some), row] = some * size, claim
    false_success = int(np.count_nonzero(claimed & _violates(problem, loop, found, tolerance)))
    every = np.concatenate((found, _pulled_inside(problem, loop, found, parameters[-3:] * size, bounds * size)))
    return Found(best_candidate(problem, loop, every[:, 0], every[:, 1], every[:, 2]), false_success, calls)


class _Run:
    """The solves of one frequency: their points as gains, and whether the solver claimed success for each."""

    def __init__(self, solvers: _Solvers, parameters: FloatArray, bounds: FloatArray) -> None:
        self._solvers, self._parameters = solvers, parameters
        self._low, self._high = bounds.T
        self._scales = parameters[-3:]
        self._shares = tuple(np.minimum(end / (self._scales + end), _LAST_SHARE) for end in (self._low, self._high))
        self.points: list[FloatArray] = []
        self.claims: list[bool] = []
        self.errors: list[float] = []
        self.calls = 0

    def solve_from(self, start: FloatArray) -> None:
        """Solve (11)-(12) from a start in shares; break ties if it ends on the goal's magnitude."""
        if self._solvers.backend.coordinates == "gains":
            self._call(
                self._solvers.direct, self._to_gains(start), (self._low, self._high), np.array, (0.0,), (np.inf,)
            )
        else:
            self._call(self._solvers.direct, start, self._shares, self._to_gains, (0.0,), (np.inf,))
        if self.errors[-1] < _ROOT:
            share = self._to_share(self.points[-1])
            self._call(self._solvers.tie_break, share, self._shares, self._to_gains, (0.0, 0.0), (np.inf, 0.0))

    def best_share(self) -> FloatArray:
        """Shares of the point with the smallest error: a start for the next frequency."""
        return self._to_share(self.points[int(np.argmin(self.errors))])

    def _to_gains(self, share: FloatArray) -> FloatArray:
        inner = np.minimum(share, _LAST_SHARE)
        gains = self._scales * inner / (1 - inner)
        gains = np.where(share <= self._shares[0], self._low, np.where(share >= self._shares[1], self._high, gains))
        clipped: FloatArray = np.clip(gains, self._low, self._high)
        return clipped

    def _to_share(self, gains: FloatArray) -> FloatArray:
        return np.minimum(gains / (self._scales + gains), _LAST_SHARE)

    def _call(
        self,
        solver: Any,
        start: FloatArray,
        box: tuple[FloatArray, FloatArray],
        to_gains: Any,
        low: tuple[float, ...],
        high: tuple[float, ...],
    ) -> None:
        self.calls += 1
        start, claimed = np.clip(start, *box), False
        x = start
        try:
            result = solver(x0=start, p=self._parameters, lbx=box[0], ubx=box[1], lbg=low, ubg=high)
        except RuntimeError:
            # Some solvers throw where others return a status.
            pass
        else:
            x = np.asarray(result["x"], dtype=np.float64).ravel()
            claimed = bool(solver.stats()["success"]) and bool(np.isfinite(x).all())
            x = np.where(np.isfinite(x), np.clip(x, *box), start)
        gains = to_gains(x)
        error2 = float(_relative_error2()(gains, self._parameters))
        self.points.append(gains)
        self.claims.append(claimed)
        self.errors.append(np.sqrt(error2) if np.isfinite(error2) else np.inf)


def _violates(problem: Problem, loop: Loop, found: FloatArray, tolerance: float) -> BoolArray:
    """Whether points (m, 3, n) miss (12) by more than ten times the tolerance, relative to the terms of Re Z_h."""
    rendered = loop.rendered(found[:, 0], found[:, 1]) + found[:, 2]
    terms = np.abs(loop.target) + np.abs(loop.device) + np.abs(loop.hold * rendered)
    missing = margin_over_range(problem) - (loop.device + loop.hold * rendered).real
    with np.errstate(invalid="ignore"):
        violates: BoolArray = missing > 10 * tolerance * terms
    return violates


def _pulled_inside(
    problem: Problem, loop: Loop, found: FloatArray, scales: FloatArray, bounds: FloatArray
) -> FloatArray:
    """Move points that miss (12) by a solver's tolerance onto it, along its gradient; shape of ``found``."""
    gains = found.copy()
    low, high = bounds[None, :, 0, None], bounds[None, :, 1, None]
    slope_k = coupling_impedance(loop.angle, 0.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(4):
            b, k, p = gains[:, 0], gains[:, 1], gains[:, 2]
            rendered = loop.rendered(b, k) + p
            missing = guarded_margin(loop.device, loop.hold, rendered, margin_over_range(problem))
            missing = missing - (loop.device + loop.hold * rendered).real
            dz = loop.sensitivity(b, k)
            gradient = np.stack((dz.real, (dz * slope_k).real, loop.hold.real + 0 * b), axis=1) * scales
            # A gain at its bound cannot move further out.
            blocked = ((gains <= low) & (gradient < 0)) | ((gains >= high) & (gradient > 0))
            gradient = np.where(blocked, 0.0, gradient)
            step = np.maximum(missing, 0)[:, None] * gradient / (gradient**2).sum(axis=1, keepdims=True)
            gains = np.clip(gains + np.where(np.isfinite(step), step, 0.0) * scales, low, high)
    return gains
