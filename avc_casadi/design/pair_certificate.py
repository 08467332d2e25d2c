"""The certificate of a spring and damper to another end than a wall: stability and passivity apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from avc_casadi._util.json_values import Document
from avc_casadi._util.page import Worded, worded
from avc_casadi._util.progress import UNSEEN_STAGES, Stages
from avc_casadi.claims.engine_port import PortPassivity, port_passivity
from avc_casadi.design.virtual_tool import EndSearch
from avc_casadi.loops.loop_family import LeastDampedMode
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class PairCertificate(Worded, Document):
    """Certificate of a spring and damper to another end than a wall: stability and passivity apart.

    Attributes:
        stable: whether all loops are stable, over all ranges.
        spectral_radius: the largest, for a tick.
        worst: the loop with it.
        loops: number of loops.
        gain_margin: of K and B at both ends.
        motor_margins: of the device's motor alone, and of the follower's.
        least_damped: the least damped oscillation; None where a loop is unstable.
        passivity: that of the port of the end; None where it has none.
    """

    JSON_KEYS: ClassVar = (
        "stable",
        "spectral_radius",
        "worst",
        "loops",
        "gain_margin",
        "motor_margins",
        "least_damped",
        "claim",
        ("passivity", "judged_passivity"),
    )

    stable: bool
    spectral_radius: float
    worst: Any
    loops: int
    gain_margin: float
    motor_margins: tuple[float, ...]
    least_damped: LeastDampedMode | None
    passivity: PortPassivity | None

    @property
    def claim(self) -> str:
        """What is claimed, in words."""
        return worded(self)

    @property
    def judged_passivity(self) -> dict[str, Any]:
        """The values of its passivity; empty where its end has no port."""
        return {} if self.passivity is None else self.passivity.document()


def certify_pair(
    problem: Problem, gains: ToolGains, search: EndSearch, stages: Stages = UNSEEN_STAGES
) -> PairCertificate:
    """Return the certificate of a spring and damper to another end than a wall: stability and passivity apart.

    Stability is that of every loop at the corners of all ranges and between them. Each region that is searched is a
    stage of the progress.
    """
    stable = search.loops.stable_over_ranges(gains, stages)
    radius, case = search.loops.radius(gains, stages)
    margins = search.margins(gains, stages)
    return PairCertificate(
        stable=stable,
        spectral_radius=radius,
        worst=case,
        loops=search.loop_count,
        gain_margin=margins.gain_margin,
        motor_margins=margins.motor_margins,
        least_damped=search.loops.slowest(gains) if stable else None,
        passivity=port_passivity(problem.end, problem, gains),
    )
