"""Whether the force of a log is that of a coupling which should have run: its spring and damper against the fitted."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from avc_casadi.coupling import Coupling
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import Log, Oscillation

_STIFFNESS_SHARE = 0.05
"""Difference of k, as a share of the expected one, up to which it is the same: readings of a coarse encoder."""
_DAMPING_SHARE = 0.1
"""The same of b."""
_DAMPING_OF_DELAY = 3
"""A part of a tick; a damper is the same where so much delay of the spring does as much."""
_RATE_SHARE = 0.02
"""Difference of the time from one force to the next up to which it is the same."""
_SLOW_HZ = 1.0
"""Frequency of a press, Hz, at which laws are compared if nothing swings."""


class WhyNotCompared(Enum):
    """Why a log and a coupling are not compared by spring and damper."""

    FEEDBACK = "its law is an observer with state feedback"
    TABLE = "its gains follow the frequency of the motion"
    RUNTIME = "an observer or a guard changes its force"
    DETENTS = "its problem has detents"
    LOG = "the force of the log is not that of a spring and damper alone"


@dataclass(frozen=True)
class RunComparison:
    """A fitted law next to the spring and damper that a coupling with its wall has at the frequency of the log.

    Attributes:
        coupling: identifier of the coupling.
        why_not: why they are not compared; None where they are.
        stiffness_n_per_m: expected spring of the force, N/m.
        damping_ns_per_m: expected damper, N.s/m.
        sample_time_s: expected time from one force to the next, s.
        runs: whether the log may run the coupling; None where they are not compared.
    """

    coupling: str
    why_not: WhyNotCompared | None
    stiffness_n_per_m: float
    damping_ns_per_m: float
    sample_time_s: float
    runs: bool | None

    def same_rate(self, log: Log) -> bool:
        """Return whether the log has a new force as often as the coupling."""
        return math.isclose(log.period_s, self.sample_time_s, rel_tol=_RATE_SHARE)

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        return vars(self) | {"why_not": None if self.why_not is None else self.why_not.value}


def compared_with(coupling: Coupling, law: FittedLaw | None, swing: Oscillation, log: Log) -> RunComparison:
    """Return whether the fitted law of a log is the coupling to a wall that should have run: k, b and sample time.

    Differences within the errors of the fit, and within a share of k and b and k T, are allowed.
    """
    swings = swing.kind != "none" and math.isfinite(swing.frequency_hz) and swing.frequency_hz > 0
    stiffness, damping = spring_and_damper(coupling, swing.frequency_hz if swings else _SLOW_HZ)
    why_not = _why_not(coupling, law)
    comparison = RunComparison(coupling.id, why_not, stiffness, damping, coupling.sample_time_s, None)
    if law is not None and why_not is None:
        of_delay = stiffness * log.period_s / _DAMPING_OF_DELAY
        allowed_n_per_m = law.stiffness_error_n_per_m + _STIFFNESS_SHARE * stiffness
        allowed_ns_per_m = law.damping_error_ns_per_m + _DAMPING_SHARE * damping + of_delay
        runs = (
            comparison.same_rate(log)
            and abs(law.stiffness_n_per_m - stiffness) <= allowed_n_per_m
            and abs(law.damping_ns_per_m - damping) <= allowed_ns_per_m
        )
        return replace(comparison, runs=runs)
    return comparison


def spring_and_damper(coupling: Coupling, frequency_hz: float) -> tuple[float, float]:
    """Return k and b of the force at the wall, at rest gains and one frequency.

    Coupling and wall are in series, next to the contact damper: F/x = s (Z_avc Z_e/(Z_avc + Z_e) + b_p), with the
    backward difference s = (1 - 1/z)/T. k and b are real with F/x = k + b s.
    """
    period_s = coupling.sample_time_s
    s = (1 - cmath.exp(-2j * math.pi * frequency_hz * period_s)) / period_s
    row, wall = coupling.table.at_rest, coupling.wall
    z_avc = row.damping_ns_per_m + row.stiffness_n_per_m / s
    z_e = wall.damping_ns_per_m + wall.stiffness_n_per_m / s
    in_series = z_avc * z_e / (z_avc + z_e) if z_avc + z_e else 0j
    force = s * (in_series + row.contact_damping_ns_per_m)
    damping = force.imag / s.imag
    return force.real - damping * s.real, damping


def _why_not(coupling: Coupling, law: FittedLaw | None) -> WhyNotCompared | None:
    """Return why spring and damper of a log are not those of a coupling; None where they compare."""
    runtime = coupling.runtime
    if runtime.state_feedback is not None:
        return WhyNotCompared.FEEDBACK
    if not coupling.table.constant:
        return WhyNotCompared.TABLE
    if runtime.observer_mass_kg is not None or runtime.guard is not None:
        return WhyNotCompared.RUNTIME
    if coupling.problem.detent is not None:
        return WhyNotCompared.DETENTS
    if law is None or not law.explains or law.switch or law.frames or law.dead_zone_m is not None:
        return WhyNotCompared.LOG
    return None
