"""The couplings among which `recommend` chooses: today's designs, each for every hand and the device let go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.coupling import Coupling, Gains, Runtime
from avc_casadi.recommendation._designs import tuned_margin
from avc_casadi.recommendation._limits import damping_range
from avc_casadi.recommendation._reach import tuned
from avc_casadi.trial import with_let_go

if TYPE_CHECKING:
    from avc_casadi.problem import Problem
    from avc_casadi.trial import Subjects

# A spring that no hand tells from a rigid joint, and that a device still holds in single precision.
RIGID_N_PER_M = 1e8
# Damping kept in reserve, as multiples of the tuned designs' own: a coarse encoder asks for more.
_RESERVES = (1.0, 2.5, 5.0)
# Where in the interval of stable dampings the damper of a rigid coupling stands.
_SHARES = (0.5, 0.25)


def candidates(problem: Problem, subjects: Subjects) -> Iterator[Coupling]:
    """Yield the couplings to be judged, the simplest first.

    No coupling but the wall itself; a rigid coupling with a contact damper; constant gains tuned for every hand and the
    device let go, with a contact damper and without, with growing reserves; the same scheduled on frequency.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
    """
    for gains, name in _rigid(problem, subjects):
        yield from _with_observer(Coupling.constant(problem, gains, name))
    safe = problem.changed(hands={"let_go": True})
    for share in _RESERVES:
        found = _tuned(safe, share, scheduled=False)
        if isinstance(found, Gains):
            yield from _with_observer(Coupling.constant(problem, found, "static-tuned"))
    series = _tuned(safe, 1.0, scheduled=False, structure="series")
    if isinstance(series, Gains):
        yield from _with_observer(Coupling.constant(problem, series, "static-tuned, series"))


def _tuned(problem: Problem, share: float, *, scheduled: bool, structure: str = "damped") -> object:
    try:
        return tuned(
            problem,
            scheduled=scheduled,
            margin_ns_per_m=share * tuned_margin(problem),
            structure="series" if structure == "series" else "damped",
        )
    except UnsupportedError:
        return None


def _rigid(problem: Problem, subjects: Subjects) -> Iterator[tuple[Gains, str]]:
    yield Gains(0.0, RIGID_N_PER_M), "none"
    wall = problem.environment
    found = damping_range(problem.device, with_let_go(subjects), wall.stiffness_n_per_m)
    if np.isnan(found.lowest_ns_per_m):
        return
    for share in _SHARES:
        total = found.lowest_ns_per_m + share * (found.highest_ns_per_m - found.lowest_ns_per_m)
        yield Gains(0.0, RIGID_N_PER_M, max(0.0, total - wall.damping_ns_per_m)), "contact damper"


def _with_observer(coupling: Coupling) -> Iterator[Coupling]:
    """Yield a coupling without an observer, and with one where an encoder or a delay may call for it."""
    yield coupling
    problem = coupling.problem
    if problem.device.encoder_resolution_m > 0:
        mass = problem.device.mass_kg + problem.hands.mass_kg[0]
        yield Coupling.constant(problem, coupling.table.at_rest, coupling.method, Runtime(observer_mass_kg=mass))
