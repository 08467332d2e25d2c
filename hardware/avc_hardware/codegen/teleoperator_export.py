"""Export of a coupling between two devices: leader's end and follower's end of spring and damper, as C."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi.loops.follower import FollowerLoops
from avc_casadi.simulation.emit import Precision
from avc_hardware.codegen.c_frame import FRAME, HEADER, NAME, SOURCE, checked, compiler_checks, named
from avc_hardware.codegen.other_end_export import FADE_S, eased_c, verdict
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds, believed_c
from avc_hardware.codegen.teleoperator_header import teleoperator_header

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.virtual_tool import ToolGains

# A link without so many messages in a row, jitter aside, is silent: with 1 % of losses once in 1e10 messages.
_MESSAGES = 5

_SOURCE = """\
/* Coupling {id}: spring and damper between a leader and its follower; do not edit. */
#include "avc_coupling.h"

{checks}
{ends}
{believed}
{eased}
void avc_coupling_init(avc_coupling_t *coupling, const avc_coupling_end_t *end)
{{
    coupling->end = end;
    coupling->own.number = 0u;
    coupling->own.position_m = {zero};
    coupling->own.velocity_m_per_s = {zero};
    coupling->own.force_n = {zero};
    coupling->far = coupling->own;
    coupling->missed = 0ul;
    coupling->silent = 0ul;
    coupling->faded = end->fade;
    coupling->force_n = {zero};
    coupling->started = 0u;
    coupling->given = 0u;
    coupling->fading = 0u;
}}

avc_coupling_message_t avc_coupling_message(const avc_coupling_t *coupling)
{{
    return coupling->own;
}}

int avc_coupling_receive(avc_coupling_t *coupling, const avc_coupling_message_t *message)
{{
    const avc_coupling_end_t *end = coupling->end;
    const uint32_t ahead = message->number - coupling->far.number;
    if (message->number == 0u || ahead == 0u || !within(message->position_m, {farthest}) ||
        !within(message->force_n, {farthest}) || !within(message->velocity_m_per_s, end->far_fastest_m_per_s)) {{
        return 0;
    }}
    if (coupling->given != 0u &&
        (ahead > end->most ||
         !within(message->position_m - coupling->far.position_m, ({real})ahead * end->far_jump_m + end->far_step_m))) {{
        return 0;
    }}
    coupling->far = *message;
    coupling->silent = 0ul;
    coupling->given = 1u;
    return 1;
}}

void avc_coupling_sample(avc_coupling_t *coupling, {real} own_position_m)
{{
    const avc_coupling_end_t *end = coupling->end;
    avc_coupling_message_t *own = &coupling->own;
    if (coupling->missed >= end->fade) {{
        coupling->started = 0u;
    }}
    if (coupling->silent < end->watchdog + end->fade) {{
        coupling->silent++;
    }} else {{
        coupling->given = 0u;
    }}
    if (!believed(own_position_m, own->position_m, own->velocity_m_per_s * end->sample_time_s,
                  coupling->missed == 0ul || coupling->started == 0u ? coupling->started : 1u, end->jump_m,
                  end->change_m)) {{
        if (coupling->missed < end->fade) {{
            coupling->missed++;
        }}
        return;
    }}
    own->velocity_m_per_s = {zero};
    if (coupling->started != 0u) {{
        own->velocity_m_per_s =
            (own_position_m - own->position_m) / (({real})(coupling->missed + 1ul) * end->sample_time_s);
    }}
    own->position_m = own_position_m;
    own->number += own->number < UINT32_MAX ? 1u : 2u;
    coupling->started = coupling->started != 0u && coupling->missed == 0ul ? 2u : 1u;
    coupling->missed = 0ul;
}}

{real} avc_coupling_force(avc_coupling_t *coupling)
{{
    const avc_coupling_end_t *end = coupling->end;
    avc_coupling_message_t *own = &coupling->own;
    const avc_coupling_message_t *far = &coupling->far;
    {real} pull_n = {zero}, force_n = {zero};
    if (coupling->started != 0u && coupling->given != 0u) {{
        if (end->feels_force != 0u) {{
            pull_n = -(end->force_scale * far->force_n);
        }} else {{
            pull_n = end->stiffness_n_per_m * (end->position_scale * far->position_m - own->position_m);
            if (coupling->missed == 0ul) {{
                pull_n +=
                    end->damping_ns_per_m * (end->position_scale * far->velocity_m_per_s - own->velocity_m_per_s);
            }}
        }}
        force_n = pull_n;
        if (coupling->missed == 0ul) {{
            force_n -= end->local_damping_ns_per_m * own->velocity_m_per_s;
        }}
        if (force_n > end->max_force_n) {{
            force_n = end->max_force_n;
        }}
        if (force_n < -end->max_force_n) {{
            force_n = -end->max_force_n;
        }}
    }}
    force_n = eased(coupling, force_n,
                    coupling->missed == 0ul && coupling->given != 0u && coupling->silent <= end->watchdog, end->fade);
    own->force_n = left_of(pull_n, coupling->faded, end->fade);
    return force_n;
}}

{real} avc_coupling_step(
    avc_coupling_t *coupling, {real} own_position_m, const avc_coupling_message_t *message)
{{
    avc_coupling_sample(coupling, own_position_m);
    if (message) {{
        (void)avc_coupling_receive(coupling, message);
    }}
    return avc_coupling_force(coupling);
}}
"""


def export_teleoperator_c(
    coupling: Coupling, *, precision: str = "single", name: str = NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return a coupling between two devices as C, ``avc_coupling.h`` and ``avc_coupling.c``, by file name."""
    chosen = checked(precision, name)
    judged = verdict(
        coupling.problem,
        FollowerLoops(coupling.problem),
        coupling.gains,
        unsafe=unsafe,
        also=", the follower free and in contact",
    )
    numbers = _numbers(coupling, chosen)
    files = {
        HEADER: teleoperator_header(coupling, judged, numbers),
        SOURCE: _SOURCE.format(**FRAME, **numbers, ends=_ends(coupling, chosen)),
    }
    return named(files, name)


def _numbers(coupling: Coupling, precision: Precision) -> dict[str, str]:
    """Return the literals of a coupling for both files, and the silences of the link in words."""
    literal, leader, follower = precision.literal, coupling.problem.device, coupling.follower
    to_leader, to_follower = _delays(coupling)
    silence = _silence_samples(coupling, leader, follower, to_leader) * leader.sample_time_s
    far_silence = _silence_samples(coupling, follower, leader, to_follower) * follower.sample_time_s
    return {
        "id": coupling.id,
        "precision": precision.name,
        "checks": compiler_checks(precision),
        "real": precision.c_type,
        "zero": literal(0.0),
        "farthest": literal(FARTHEST_M),
        "believed": believed_c(precision),
        "eased": eased_c(precision),
        "leader_t_literal": literal(leader.sample_time_s),
        "follower_t_literal": literal(follower.sample_time_s),
        "leader_silence": f"{silence:.4g}",
        "follower_silence": f"{far_silence:.4g}",
    }


def _silence_samples(coupling: Coupling, own: Device, far: Device, delay_s: float) -> int:
    """Return the number of samples without a new message after which the link to one end is silent."""
    late = 2 * coupling.follower.jitter * delay_s
    return math.ceil((_MESSAGES * max(own.sample_time_s, far.sample_time_s) + late) / own.sample_time_s - 1e-9)


def _fade_samples(own: Device) -> int:
    return max(1, round(FADE_S / own.sample_time_s))


def _delays(coupling: Coupling) -> tuple[float, float]:
    """Return the longest delay to the leader, and to the follower."""
    there, back = coupling.follower.delays_s[-1]
    return back, there


def _ends(coupling: Coupling, precision: Precision) -> str:
    """Return both ends as constants."""
    leader, follower = coupling.problem.device, coupling.follower
    to_leader, to_follower = _delays(coupling)
    feels = follower.architecture == "position-force"
    position, force = follower.position_scale, follower.force_scale
    sides = (
        ("LEADER", leader, follower, coupling.gains, (1 / position, force), to_leader, feels),
        ("FOLLOWER", follower, leader, coupling.at_follower, (position, 1 / force), to_follower, False),
    )
    return "\n".join(_end(coupling, precision, *side) for side in sides)


def _end(
    coupling: Coupling,
    precision: Precision,
    name: str,
    own: Device,
    far: Device,
    gains: ToolGains,
    scales: tuple[float, float],
    delay_s: float,
    feels: bool,
) -> str:
    silence, fade = _silence_samples(coupling, own, far, delay_s), _fade_samples(own)
    # After a longer silence any message number is accepted.
    most = math.ceil(((silence + fade) * own.sample_time_s + delay_s) / far.sample_time_s) + 1
    bounds, fastest = SensorBounds.of(own), SensorBounds.of(far).fastest_m_per_s
    step = 2 * (far.encoder_resolution_m or 0.0)
    numbers = (
        own.sample_time_s,
        *scales,
        *vars(gains).values(),
        precision.largest if own.max_force_n is None else own.max_force_n,
        bounds.jump_m,
        bounds.change_m,
        fastest * far.sample_time_s,
        step,
        fastest + step / far.sample_time_s,
    )
    lines = [*map(precision.literal, numbers), f"{silence}ul", f"{fade}ul", f"{most}u", f"{int(feels)}u"]
    body = "".join(f"    {one},\n" for one in lines)
    return f"const avc_coupling_end_t AVC_COUPLING_{name} = {{\n{body}}};\n"
