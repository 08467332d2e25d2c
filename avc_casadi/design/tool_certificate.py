"""Certificate of a coupling to a virtual tool: stability of all its loops, and passivity at the engine's port."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.json_values import plain
from avc_casadi.claims.engine_port import engine_port
from avc_casadi.design.virtual_tool import ToolSearch
from avc_casadi.loops.engine import required_tool

if TYPE_CHECKING:
    from avc_casadi.model.ends import ToolGains
    from avc_casadi.model.problem import Problem

STABILITY = (
    "linear stability of the lifted loop: hands of [hands] and the device released, devices, tools and contacts of "
    "their ranges (corners, then a search for the worst point inside), every phase of the clocks"
)
PASSIVITY = (
    "the port at which the engine meets the coupling is passive, with the corner hands of [hands] and released: "
    "stable with any engine that is passive there, whatever its tool weighs and touches. Such an engine solves the "
    "tool together with the coupling's force (implicit); one that moves a mass explicitly is none, however heavy"
)


def tool_certificate(problem: Problem, gains: ToolGains, search: ToolSearch | None = None) -> dict[str, Any]:
    """Return the certificate: JSON values, stability and passivity apart."""
    search = ToolSearch(problem) if search is None else search
    stable, (radius, case) = search.loops.stable_over_ranges(gains), search.loops.radius(gains)
    found: dict[str, Any] = plain(
        {
            "stable": stable,
            "spectral_radius": radius,
            "worst": asdict(case),
            "loops": len(search.loops),
            "gain_margin": search.gain_margin_over_ranges(gains),
            "least_damped": asdict(search.loops.slowest(gains)) if stable else None,
            "claim": STABILITY,
            "passivity": _passivity(problem, gains),
        }
    )
    return found


def _passivity(problem: Problem, gains: ToolGains) -> dict[str, Any]:
    try:
        port = engine_port(problem.device, problem.hands, required_tool(problem), gains)
    except UnsupportedError as refusal:
        return {"passive": None, "refused": str(refusal), "claim": PASSIVITY}
    return {**asdict(port), "refused": None, "claim": PASSIVITY}
