"""Export of a coupling to a simulation: the device's end and the engine's end of spring and damper, as C."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi.loops.engine import ToolLoops
from avc_casadi.simulation.emit import Precision
from avc_hardware.codegen.c_frame import FRAME, HEADER, NAME, SOURCE, checked, compiler_checks, named
from avc_hardware.codegen.other_end_export import FADE_S, eased_c, verdict
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds, believed_c
from avc_hardware.codegen.tool_header import MISSED_STEPS, tool_header

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.virtual_tool import VirtualTool


_SOURCE = """\
/* Coupling {id}: spring and damper to the tool of a simulation; do not edit. */
#include "avc_coupling.h"

{checks}
/* In samples: until an engine that does not step hangs, and in which the force fades. */
#define WATCHDOG {watchdog}ul
#define FADE {fade}ul

{believed}
{eased}
void avc_coupling_init(avc_coupling_t *coupling)
{{
    coupling->position_m = {zero};
    coupling->velocity_m_per_s = {zero};
{clear}
    coupling->missed = 0ul;
    coupling->lost = 0ul;
    coupling->silent = 0ul;
    coupling->faded = 0ul;
    coupling->force_n = {zero};
    coupling->to_tool_n = {zero};
    coupling->handed_n = {zero};
    coupling->started = 0u;
    coupling->given = 0u;
    coupling->fading = 0u;
}}

void avc_coupling_alive(avc_coupling_t *coupling)
{{
    coupling->silent = 0ul;
}}

void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m)
{{
    if (coupling->missed >= FADE) {{
        coupling->started = 0u;
    }}
    if (coupling->silent <= WATCHDOG) {{
        coupling->silent++;
    }}
    if (!believed(position_m, coupling->position_m, coupling->velocity_m_per_s * AVC_COUPLING_SAMPLE_TIME_S,
                  coupling->missed == 0ul || coupling->started == 0u ? coupling->started : 1u, {jump}, {change})) {{
        coupling->velocity_m_per_s = {zero};
        if (coupling->missed < FADE) {{
            coupling->missed++;
        }}
        return;
    }}
    coupling->velocity_m_per_s = {zero};
    if (coupling->started != 0u) {{
        coupling->velocity_m_per_s =
            (position_m - coupling->position_m) / (({real})(coupling->missed + 1ul) * AVC_COUPLING_SAMPLE_TIME_S);
    }}
    coupling->position_m = position_m;
    coupling->started = coupling->started != 0u && coupling->missed == 0ul ? 2u : 1u;
    coupling->missed = 0ul;
}}

{real} avc_coupling_force(avc_coupling_t *coupling, {given})
{{
    {real} force_n = {zero};
    if (coupling->lost >= FADE) {{
        coupling->given = 0u;
    }}
    if ({good}) {{
{keep}
        coupling->lost = 0ul;
        coupling->given = 1u;
    }} else if (coupling->lost < FADE) {{
        coupling->lost++;
    }}
    if (coupling->started != 0u && coupling->given != 0u) {{
        force_n = {spring};
        if (coupling->missed == 0ul && coupling->lost == 0ul) {{
            force_n -= {dampers};
        }}
{clip}    }}
    return eased(coupling, force_n,
                 coupling->missed == 0ul && coupling->lost == 0ul && coupling->silent <= WATCHDOG, FADE);
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {given})
{{
    avc_coupling_sample(coupling, position_m);
    return avc_coupling_force(coupling, {passed});
}}

{engine}"""

# A force of spring and damper from the tool's present state.
_PULL = """\
{real} avc_coupling_{which}(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s)
{{
    {real} force_n, left_n;
    avc_coupling_alive(coupling);
    if (coupling->started == 0u || !within(tool_position_m, {scene_farthest}) ||
        !within(tool_velocity_m_per_s, {scene_farthest})) {{
        return {zero};
    }}
    force_n = AVC_COUPLING_TOOL_STIFFNESS * ({position_scale} * coupling->position_m - tool_position_m);
    if (coupling->missed == 0ul) {{
        force_n += AVC_COUPLING_TOOL_DAMPING * {speed};
    }}
    left_n = left_of(force_n, coupling->faded, FADE);
    coupling->{kept} = coupling->missed == 0ul ? left_n : no_more(left_n, coupling->{kept});
    return coupling->{kept};
}}
"""

_TARGET = """\
{real} avc_coupling_target(avc_coupling_t *coupling, {real} *position_m, {real} *velocity_m_per_s)
{{
    avc_coupling_alive(coupling);
    *position_m = {position_scale} * coupling->position_m;
    *velocity_m_per_s = {position_scale} * coupling->velocity_m_per_s;
    return coupling->started == 0u ? {zero} : left_of({one}, coupling->faded, FADE);
}}
"""


def export_tool_c(
    coupling: Coupling, *, precision: str = "single", name: str = NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return a coupling to a simulation as C, ``avc_coupling.h`` and ``avc_coupling.c``, by file name."""
    chosen = checked(precision, name)
    judged = verdict(coupling.problem, ToolLoops(coupling.problem), coupling.gains, unsafe=unsafe)
    words, numbers = _words(coupling.tool, chosen), _numbers(coupling, chosen)
    files = {
        HEADER: tool_header(coupling, judged, {**words, **numbers}),
        SOURCE: _SOURCE.format(**FRAME, **words, **numbers, engine=_engine_c(coupling.tool, numbers)),
    }
    return named(files, name)


def _engine_c(tool: VirtualTool, numbers: dict[str, str]) -> str:
    """Return the functions of the engine's end: forces without what its integrator solves, or the target."""
    moving = f"{numbers['position_scale']} * coupling->velocity_m_per_s"
    both = f"({moving} - tool_velocity_m_per_s)"
    if tool.solved == "spring and damper":
        found = [_TARGET.format(**numbers)]
    else:
        speed = f"({moving})" if tool.solved == "damper" else both
        found = [_PULL.format(**numbers, which="tool_force", speed=speed, kept="to_tool_n")]
    if tool.solved != "nothing" and tool.exchange == "held-force":
        found.append(_PULL.format(**numbers, which="handed_force", speed=both, kept="handed_n"))
    return "\n".join(found)


def _numbers(coupling: Coupling, precision: Precision) -> dict[str, str]:
    """Return the literals of a coupling for both files."""
    device, tool, literal = coupling.problem.device, coupling.tool, precision.literal
    bounds = SensorBounds.of(device)
    samples = math.ceil(max(tool.step_s) / device.sample_time_s - 1e-9)
    scene, force = coupling.in_scene, device.max_force_n
    return {
        "id": coupling.id,
        "precision": precision.name,
        "checks": compiler_checks(precision),
        "real": precision.c_type,
        "zero": literal(0.0),
        "one": literal(1.0),
        "sample_time_literal": literal(device.sample_time_s),
        "sample_time_ns": str(round(device.sample_time_s * 1e9)),
        "watchdog": str(MISSED_STEPS * samples),
        "fade": str(max(1, round(FADE_S / device.sample_time_s))),
        "scene_farthest": literal(FARTHEST_M * tool.position_scale),
        "believed": believed_c(precision),
        "eased": eased_c(precision),
        "jump": literal(bounds.jump_m),
        "change": literal(bounds.change_m),
        "position_scale": literal(tool.position_scale),
        "scene_spring": literal(scene.stiffness_n_per_m),
        "scene_damper": literal(scene.damping_ns_per_m),
        "clip": "" if force is None else _clip("AVC_COUPLING_MAX_FORCE_N"),
        "max_force": "" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {literal(force)}\n",
        **_law(coupling, precision, bounds.fastest_m_per_s),
    }


def _clip(limit: str) -> str:
    return (
        f"        if (force_n > {limit}) {{\n            force_n = {limit};\n        }}\n"
        f"        if (force_n < -{limit}) {{\n            force_n = -{limit};\n        }}\n"
    )


def _law(coupling: Coupling, precision: Precision, fastest: float) -> dict[str, str]:
    """Return the force on the device as expressions: spring, dampers, valid inputs."""
    gains, tool, literal = coupling.gains, coupling.tool, precision.literal
    local = f"{literal(gains.local_damping_ns_per_m)} * coupling->velocity_m_per_s"
    if tool.exchange == "held-force":
        return {
            "good": f"within(tool_force_n, {literal(FARTHEST_M / tool.force_scale)})",
            "keep": _lines(["coupling->tool_force_n = tool_force_n;"], 8),
            "clear": _lines([f"coupling->tool_force_n = {literal(0.0)};"], 4),
            "spring": f"-({literal(tool.force_scale)} * coupling->tool_force_n)",
            "dampers": local,
        }
    scale = literal(tool.position_scale)
    # A tool may move as far in a step of the engine as in a sample.
    farthest = fastest * tool.position_scale * max(*tool.step_s, coupling.problem.device.sample_time_s)
    kept = ("tool_position_m", "tool_velocity_m_per_s")
    spring = f"coupling->position_m - coupling->tool_position_m / {scale}"
    damper = f"coupling->velocity_m_per_s - coupling->tool_velocity_m_per_s / {scale}"
    dampers = f"{literal(gains.damping_ns_per_m)} * ({damper})"
    return {
        "good": f"within(tool_position_m, {literal(FARTHEST_M * tool.position_scale)}) &&\n"
        f"        within(tool_velocity_m_per_s, {literal(fastest * tool.position_scale)}) &&\n"
        f"        (coupling->given == 0u || within(tool_position_m - coupling->tool_position_m, {literal(farthest)}))",
        "keep": _lines([f"coupling->{one} = {one};" for one in kept], 8),
        "clear": _lines([f"coupling->{one} = {literal(0.0)};" for one in kept], 4),
        "spring": f"-({literal(gains.stiffness_n_per_m)} * ({spring}))",
        "dampers": f"{dampers} +\n                       {local}" if gains.local_damping_ns_per_m else dampers,
    }


def _words(tool: VirtualTool, precision: Precision) -> dict[str, str]:
    """Return names of the inputs of the device's loop: the tool's state, or the force on it."""
    real = precision.c_type
    if tool.exchange == "held-force":
        return {
            "given": f"{real} tool_force_n",
            "passed": "tool_force_n",
            "held": "tool_force_n",
            "held_is": "The last good force on the tool, in units of the scene.",
            "given_is": f"tool_force_n: {_newest(tool)}, the same until its next step; 0 before the first one.",
        }
    return {
        "given": f"{real} tool_position_m, {real} tool_velocity_m_per_s",
        "passed": "tool_position_m, tool_velocity_m_per_s",
        "held": "tool_position_m, tool_velocity_m_per_s",
        "held_is": "The last good state of the tool, in units of the scene.",
        "given_is": (
            "tool_position_m, tool_velocity_m_per_s: of the tool in the scene,\n"
            " * the same until the engine's next step."
        ),
    }


def _newest(tool: VirtualTool) -> str:
    if tool.solved != "nothing":
        return "the newest one\n * of avc_coupling_handed_force"
    return "the newest force on the tool, from avc_coupling_tool_force\n * or of the engine itself"


def _lines(lines: list[str], indent: int) -> str:
    return "\n".join(f"{'':{indent}}{line}" for line in lines)
