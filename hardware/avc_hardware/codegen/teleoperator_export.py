"""Export of a coupling between two devices: leader's end and follower's end of spring and damper, as C."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi._util.units import FORCE, M_PER_S, NEWTON, NS_PER_M, in_its_units
from avc_casadi.claims.stability.bilateral import BilateralLoops
from avc_hardware.codegen.export import HEADER, NAME, SOURCE, WIDE_ENOUGH
from avc_hardware.codegen.operations import DOUBLE, Precision
from avc_hardware.codegen.other_end_export import FADE_S, checked, eased_c, named, verdict
from avc_hardware.codegen.packages import WORDS, comment, comment_lines
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds, believed_c

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.other_end_coupling import TeleoperatorCoupling

# A link without so many messages in a row, jitter aside, is silent: with 1 % of losses once in 1e10 messages.
_MESSAGES = 5

_HEADER = """\
/* The coupling between a leader and its follower, made by avc-casadi; do not edit. One source for both ends.
 *
 * Coupling {id} for {problem}{title}
 * at the leader: spring {stiffness:.9g} {N_PER_M}, damper {damping:.9g} {NS_PER_M}{local}
 * at the follower: spring {far_stiffness:.9g} {N_PER_M}, damper {far_damping:.9g} {NS_PER_M}{far_local}
 * {architecture}; {scales}
 * link: {link}
 * {FORCE}: {force}
 * {verdict}
 * sample times: leader {leader_t:.9g} s, follower {follower_t:.9g} s, and no other: the gains mean another loop then
 *
 * Each end, once:     avc_coupling_init(&coupling, &AVC_COUPLING_LEADER), or AVC_COUPLING_FOLLOWER
 * in each sample:     avc_coupling_receive for each message that has arrived, in any order (the last may go with step);
 *                     {FORCE} = avc_coupling_step(&coupling, own_position, NULL or a message);
 *                     message = avc_coupling_message(&coupling), sent to the other end.
 * A message holds each end's own units and scales are applied here by who receives it. How it is packed into bytes is
 * yours; number is what tells old from new.{measured}
 *
 * What goes wrong ends in less {FORCE}, never in a kick:
 * - The {FORCE} comes in over {fade_s:.3g} s, at the beginning and after every fault, wherever both ends are.
 * - Old messages and duplicates are ignored. So are those with a number that is none (NaN, infinite), or that is
 *   farther from the last good one than {fastest} would bring it, as no hand does.
 * - No new message for more than {leader_silence:.4g} s at the leader, {follower_silence:.4g} s at the follower: the
 *   {FORCE} fades to 0 over {fade_s:.3g} s. Once nothing is left, any sound message but the last one again is believed:
 *   the other end may have started anew, and then counts from 1. The {FORCE} comes back as slowly. So the link may
 *   repeat its newest message for ever, but must never hand out older ones again.
 * - An own position that is none, or jumps, by that speed or by a movement that differs from the one before by more
 *   than {accelerations}: the last good one is held, the dampers are left out, the {FORCE}
 *   fades while it lasts, and no new message is made: the other end fades too.
 * - While it fades the {FORCE} neither grows nor turns, and it comes back from where it was.
 *
 * One thread at a time. C99, also C++11 and later; no heap, no library. IEEE {precision} precision. -ffast-math is
 * refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#include <stdint.h>

#define AVC_COUPLING_ID "{id}"
#define AVC_COUPLING_LEADER_SAMPLE_TIME_S {leader_t_literal}
#define AVC_COUPLING_FOLLOWER_SAMPLE_TIME_S {follower_t_literal}

#ifdef __cplusplus
extern "C" {{
#endif

typedef {real} avc_coupling_real_t;

/* What goes over the link, as the sender counts. */
typedef struct {{
    /* 0: nothing was measured yet, and nobody believes it. */
    uint32_t number;
    {real} position_m, velocity_m_per_s;
    /* With which the follower presses; means nothing in a message of the leader, nor in position-position. */
    {real} force_n;
}} avc_coupling_message_t;

/* What one end knows; AVC_COUPLING_LEADER and AVC_COUPLING_FOLLOWER are the two. */
typedef struct {{
    {real} sample_time_s;
    /* Own metres and newtons for one of the other end. */
    {real} position_scale, force_scale;
    {real} stiffness_n_per_m, damping_ns_per_m, local_damping_ns_per_m;
    {real} max_force_n;
    /* The farthest that the own position goes in a sample, that its movement changes by, and that the other's goes from
     * one message to the next; what its encoder adds; its fastest. */
    {real} jump_m, change_m, far_jump_m, far_step_m, far_fastest_m_per_s;
    /* In own samples: until a link is silent, and in which a {FORCE} fades; messages that may lie between two. */
    unsigned long watchdog, fade;
    uint32_t most;
    /* Whether a {FORCE} of the other end is felt in place of spring and damper. */
    unsigned char feels_force;
}} avc_coupling_end_t;

extern const avc_coupling_end_t AVC_COUPLING_LEADER;
extern const avc_coupling_end_t AVC_COUPLING_FOLLOWER;

/* What an end remembers between two samples. */
typedef struct {{
    const avc_coupling_end_t *end;
    /* Of the newest good sample, and what goes with it. */
    avc_coupling_message_t own;
    /* The newest good message. */
    avc_coupling_message_t far;
    /* Samples since the last good position, and since the last good message. */
    unsigned long missed, silent;
    /* How far the {FORCE} has faded; 0 is all of it. */
    unsigned long faded;
    /* That was given last. */
    {real} force_n;
    /* Known of the own position: 0 nothing, 1 the last one, 2 its velocity too; whether the other end is heard, and
     * whether something was wrong in the last sample. */
    unsigned char started, given, fading;
}} avc_coupling_t;

/* Forget everything. Call it once before the first sample, and whenever sampling has paused. */
void avc_coupling_init(avc_coupling_t *coupling, const avc_coupling_end_t *end);

/* One sample; returns the {FORCE} on the own device, {NEWTON}, along its positions; never NaN.
 * own_position_m: as measured. message: one that has arrived, or NULL. */
{real} avc_coupling_step(
    avc_coupling_t *coupling, {real} own_position_m, const avc_coupling_message_t *message);

/* What to send after the step. */
avc_coupling_message_t avc_coupling_message(const avc_coupling_t *coupling);

/* Take a message, and return whether it was newer and sound. */
int avc_coupling_receive(avc_coupling_t *coupling, const avc_coupling_message_t *message);

/* The two halves of avc_coupling_step round what arrives; a message of positions may be sent between them. */
void avc_coupling_sample(avc_coupling_t *coupling, {real} own_position_m);
{real} avc_coupling_force(avc_coupling_t *coupling);

#ifdef __cplusplus
}}
#endif

#endif
"""

_SOURCE = """\
/* Coupling {id}: spring and damper between a leader and its follower; do not edit. */
#include "avc_coupling.h"

#ifdef __FAST_MATH__
#error "compile without -ffast-math: a position that is not a number must be seen"
#endif
{check}
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


@in_its_units
def export_teleoperator_c(
    coupling: TeleoperatorCoupling, *, precision: str = "single", name: str = NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return a coupling between two devices as C, ``avc_coupling.h`` and ``avc_coupling.c``, by file name.

    Both ends: spring, dampers, force limit, scales, plausibility of a message, watchdog of the link.

    Args:
        coupling: of a problem with [follower].
        precision: ``single`` (float) or ``double``.
        name: prefix of the files, functions, types and macros (in capitals).
        unsafe: whether a coupling that is not stable is written too.

    Raises:
        NotDeployableError: a loop of the problem is not stable with it.
        InputError: another precision, or a name invalid in C.
    """
    chosen = checked(precision, name)
    judged = verdict(
        coupling.problem,
        BilateralLoops(coupling.problem),
        coupling.gains,
        unsafe=unsafe,
        also=", the follower free and in contact",
    )
    numbers = _numbers(coupling, chosen)
    files = {
        HEADER: _HEADER.format(**WORDS, **numbers, **_told(coupling, judged)),
        SOURCE: _SOURCE.format(**WORDS, **numbers, ends=_ends(coupling, chosen)),
    }
    return named(coupling.problem, files, name)


def _numbers(coupling: TeleoperatorCoupling, precision: Precision) -> dict[str, str]:
    """Return the literals of a coupling for both files."""
    literal = precision.literal
    return {
        "id": coupling.id,
        "precision": precision.name,
        "check": WIDE_ENOUGH if precision is DOUBLE else "",
        "real": precision.c_type,
        "zero": literal(0.0),
        "farthest": literal(FARTHEST_M),
        "believed": believed_c(precision),
        "eased": eased_c(precision),
        "leader_t_literal": literal(coupling.problem.device.sample_time_s),
        "follower_t_literal": literal(coupling.follower.sample_time_s),
    }


def _silence_samples(coupling: TeleoperatorCoupling, own: Device, far: Device, delay_s: float) -> int:
    """Return the number of samples without a new message after which the link to one end is silent."""
    late = 2 * coupling.follower.jitter * delay_s
    return math.ceil((_MESSAGES * max(own.sample_time_s, far.sample_time_s) + late) / own.sample_time_s - 1e-9)


def _fade_samples(own: Device) -> int:
    return max(1, round(FADE_S / own.sample_time_s))


def _delays(coupling: TeleoperatorCoupling) -> tuple[float, float]:
    """Return the longest delay to the leader, and to the follower."""
    there, back = coupling.follower.delays_s[-1]
    return back, there


def _ends(coupling: TeleoperatorCoupling, precision: Precision) -> str:
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
    coupling: TeleoperatorCoupling,
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


def _told(coupling: TeleoperatorCoupling, verdict: str) -> dict[str, object]:
    """Return the comments of the header; every text passes the allow-list of comments."""
    problem, follower, gains, far = coupling.problem, coupling.follower, coupling.gains, coupling.at_follower
    device = problem.device
    to_leader, to_follower = _delays(coupling)
    limits = [
        f"{who} {'no limit is known, limit it yourself' if force is None else f'limited at {force:.9g} {NEWTON}'}"
        for who, force in (("leader", device.max_force_n), ("follower", follower.max_force_n))
    ]
    measured = follower.architecture == "position-force" and follower.force == "measured"
    bounds = {"leader": SensorBounds.of(device), "follower": SensorBounds.of(follower)}
    return {
        "problem": comment(problem.name or "a problem"),
        "title": comment(f": {problem.title}") if problem.title else "",
        "stiffness": gains.stiffness_n_per_m,
        "damping": gains.damping_ns_per_m,
        "local": _local(gains),
        "far_stiffness": far.stiffness_n_per_m,
        "far_damping": far.damping_ns_per_m,
        "far_local": _local(far),
        "architecture": comment(
            follower.architecture + (f", {FORCE} {follower.force}" if follower.architecture == "position-force" else "")
        ),
        "scales": comment(f"position scale {follower.position_scale:.9g}, {FORCE} scale {follower.force_scale:.9g}"),
        "link": comment(
            f"up to {to_follower:.9g} s to the follower, {to_leader:.9g} s back; jitter {follower.jitter:.9g}, "
            f"lost {follower.lost_share:.9g}"
        ),
        "force": comment("; ".join(limits)),
        "verdict": comment_lines(verdict),
        "leader_t": device.sample_time_s,
        "follower_t": follower.sample_time_s,
        "measured": (
            f"\n * The follower puts the {FORCE} with which it presses, as measured, into message.force_n before "
            "it sends."
            if measured
            else ""
        ),
        "fade_s": FADE_S,
        "fastest": " and ".join(f"{one.fastest_m_per_s:.4g} {M_PER_S} ({who})" for who, one in bounds.items()),
        "accelerations": " and ".join(
            f"{one.acceleration_m_per_s2:.4g} {M_PER_S} in a second ({who})" for who, one in bounds.items()
        ),
        "leader_silence": _silence_samples(coupling, device, follower, to_leader) * device.sample_time_s,
        "follower_silence": _silence_samples(coupling, follower, device, to_follower) * follower.sample_time_s,
    }


def _local(gains: ToolGains) -> str:
    own = gains.local_damping_ns_per_m
    return f", damper of its own loop {own:.9g} {NS_PER_M}" if own else ""
