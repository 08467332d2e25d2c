"""Header of an exported coupling between two devices: message, ends, and what ends in less force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_hardware.codegen.c_frame import FRAME, comment, comment_lines, units_line
from avc_hardware.codegen.other_end_export import FADE_S
from avc_hardware.codegen.sensor_rule import SensorBounds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.virtual_tool import ToolGains

_HEADER = """\
/* The coupling between a leader and its follower, made by avc-casadi; do not edit. One source for both ends.
 *
 * Coupling {id} for {problem}{title}
 * at the leader: spring {stiffness:.9g} N/m, damper {damping:.9g} N.s/m{local}
 * at the follower: spring {far_stiffness:.9g} N/m, damper {far_damping:.9g} N.s/m{far_local}
 * {architecture}; {scales}
 * link: {link}
 * force: {force}
 * {verdict}
 * sample times: leader {leader_t:.9g} s, follower {follower_t:.9g} s, and no other{units}
 *
 * Each end, once:     avc_coupling_init(&coupling, &AVC_COUPLING_LEADER), or AVC_COUPLING_FOLLOWER
 * in each sample:     avc_coupling_receive for each message that has arrived, in any order (the last may go with step);
 *                     force = avc_coupling_step(&coupling, own_position, NULL or a message);
 *                     message = avc_coupling_message(&coupling), sent to the other end.
 * A message holds each end's own units and scales are applied here by who receives it. How it is packed into bytes is
 * yours; number is what tells old from new.{measured}
 *
 * What goes wrong ends in less force, never in a kick:
 * - The force comes in over {fade_s:.3g} s, at the beginning and after every fault, wherever both ends are.
 * - Old messages and duplicates are ignored. So are those with a number that is none (NaN, infinite), or that is
 *   farther from the last good one than {fastest} would bring it, as no hand does.
 * - No new message for more than {leader_silence} s at the leader, {follower_silence} s at the follower: the
 *   force fades to 0 over {fade_s:.3g} s. Once nothing is left, any sound message but the last one again is believed:
 *   the other end may have started anew, and then counts from 1. The force comes back as slowly. So the link may
 *   repeat its newest message for ever, but must never hand out older ones again.
 * - An own position that is none, or jumps, by that speed or by a movement that differs from the one before by more
 *   than {accelerations}: the last good one is held, the dampers are left out, the force
 *   fades while it lasts, and no new message is made: the other end fades too.
 * - While it fades the force neither grows nor turns, and it comes back from where it was.
 * - At the beginning, and after a fault of more than {fade_s:.3g} s, the spring comes in stretched by how far the ends
 *   are apart, and pulls them together with energy that no hand has put in: bring them together first.
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

{begin_c}
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
    /* In own samples: until a link is silent, and in which a force fades; messages that may lie between two. */
    unsigned long watchdog, fade;
    uint32_t most;
    /* Whether a force of the other end is felt in place of spring and damper. */
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
    /* How far the force has faded; 0 is all of it. */
    unsigned long faded;
    /* That was given last. */
    {real} force_n;
    /* Known of the own position: 0 nothing, 1 the last one, 2 its velocity too; whether the other end is heard, and
     * whether something was wrong in the last sample. */
    unsigned char started, given, fading;
}} avc_coupling_t;

/* Forget everything. Call it once before the first sample, and whenever sampling has paused. */
void avc_coupling_init(avc_coupling_t *coupling, const avc_coupling_end_t *end);

/* One sample; returns the force on the own device, N, along its positions; never NaN.
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

{end_c}"""


def teleoperator_header(coupling: Coupling, verdict: str, made: Mapping[str, str]) -> str:
    """Return the header; every text passes the allow-list of comments."""
    problem, follower, gains, far = coupling.problem, coupling.follower, coupling.gains, coupling.at_follower
    device = problem.device
    to_follower, to_leader = follower.delays_s[-1]
    limits = [
        f"{who} {'no limit is known, limit it yourself' if force is None else f'limited at {force:.9g} N'}"
        for who, force in (("leader", device.max_force_n), ("follower", follower.max_force_n))
    ]
    measured = follower.architecture == "position-force" and follower.force == "measured"
    bounds = {"leader": SensorBounds.of(device), "follower": SensorBounds.of(follower)}
    told: dict[str, object] = {
        "problem": comment(problem.name or "a problem"),
        "title": comment(f": {problem.title}") if problem.title else "",
        "stiffness": gains.stiffness_n_per_m,
        "damping": gains.damping_ns_per_m,
        "local": _local(gains),
        "far_stiffness": far.stiffness_n_per_m,
        "far_damping": far.damping_ns_per_m,
        "far_local": _local(far),
        "architecture": comment(
            follower.architecture + (f", force {follower.force}" if follower.architecture == "position-force" else "")
        ),
        "scales": comment(f"position scale {follower.position_scale:.9g}, force scale {follower.force_scale:.9g}"),
        "link": comment(
            f"up to {to_follower:.9g} s to the follower, {to_leader:.9g} s back; jitter {follower.jitter:.9g}, "
            f"lost {follower.lost_share:.9g}"
        ),
        "force": comment("; ".join(limits)),
        "units": units_line(problem),
        "verdict": comment_lines(verdict),
        "leader_t": device.sample_time_s,
        "follower_t": follower.sample_time_s,
        "measured": (
            "\n * The follower puts the force with which it presses, as measured, into message.force_n before it sends."
            if measured
            else ""
        ),
        "fade_s": FADE_S,
        "fastest": " and ".join(f"{one.fastest_m_per_s:.4g} m/s ({who})" for who, one in bounds.items()),
        "accelerations": " and ".join(
            f"{one.acceleration_m_per_s2:.4g} m/s in a second ({who})" for who, one in bounds.items()
        ),
    }
    return _HEADER.format(**FRAME, **made, **told)


def _local(gains: ToolGains) -> str:
    own = gains.local_damping_ns_per_m
    return f", damper of its own loop {own:.9g} N.s/m" if own else ""
