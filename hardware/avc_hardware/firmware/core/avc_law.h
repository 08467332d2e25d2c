/* The law of a tick: from the position that the wall sees to the force, by the coupling that runs. Compiled into the tick. */
#ifndef AVC_LAW_H
#define AVC_LAW_H

#include <stdatomic.h>

#include "avc_lookup.h"
#include "avc_takeover.h"

/* N/m and N.s/m: slewed to 0 a gain is small at last, and gives a force that nothing tells from none. */
static const float no_gains = 1e-12f;

static inline bool avc_streamed(avc_control_t *c, avc_gains_t *goal)
{
    if (c->stream_fresh != 0u) {
        c->stream_fresh = 0u;
        atomic_signal_fence(memory_order_acquire);
        if (c->state.mode == AVC_MODE_TABLE) { /* else they came too late, and are not kept */
            c->stream_left = c->stream[c->stream_slot].ticks;
        }
    }
    if (c->stream_left == 0u) {
        return false;
    }
    *goal = c->stream[c->stream_slot].gains;
    c->stream_left--;
    if (c->stream_left == 0u) {
        c->state.stream_expired++;
    }
    return true;
}

/* The gains that are wanted: safe, streamed, or from the table, which alone has a row of rest. */
static inline avc_gains_t avc_choose_gains(avc_control_t *c, const avc_table_t *table, float *rest_stiffness_n_per_m)
{
    const avc_table_header_t *header = &table->image.header;
    avc_gains_t goal;
    c->state.streaming = 0u;
    *rest_stiffness_n_per_m = 0.0f;
    if (c->state.mode == AVC_MODE_SAFE) {
        goal = (avc_gains_t){header->safe_damping_ns_per_m, header->safe_stiffness_n_per_m, 0.0f};
        c->stream_fresh = 0u;
        c->stream_left = 0u;
    } else if (avc_streamed(c, &goal)) {
        c->state.streaming = 1u;
    } else {
        goal = avc_table_lookup(table, c->state.lookup_hz, &c->near);
        *rest_stiffness_n_per_m = table->image.row[0].stiffness_n_per_m;
    }
    return goal;
}

/* The coupling's force; gains that stay run without adaptation. */
static inline avc_couple_out_t avc_couple(avc_control_t *c, const avc_table_t *table, float position_m, bool clips)
{
    avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    float rest_stiffness_n_per_m;
    const avc_gains_t goal = avc_choose_gains(c, table, &rest_stiffness_n_per_m);
    const avc_couple_in_t in = {
        .position_m = position_m,
        .wanted_damping_ns_per_m = goal.damping_ns_per_m,
        .wanted_stiffness_n_per_m = goal.stiffness_n_per_m,
        .wanted_contact_damping_ns_per_m = goal.contact_damping_ns_per_m,
        .rest_stiffness_n_per_m = rest_stiffness_n_per_m,
        .wall_damping_ns_per_m = header->wall_damping_ns_per_m,
        .wall_stiffness_n_per_m = header->wall_stiffness_n_per_m,
        .relaxes = avc_varies(table) || s->streaming != 0u ? 1.0f : 0.0f,
    };
    avc_couple_out_t out;
    if (clips) {
        avc_couple_clips_step(&c->couple, &in, &out, c->config.number);
    } else {
        avc_couple_gated_step(&c->couple, &in, &out, c->config.number);
    }
    s->gains = (avc_gains_t){out.damping_ns_per_m, out.stiffness_n_per_m, out.contact_damping_ns_per_m};
    return out;
}

/* The force of the coupling that was pushed; the position becomes the one that the wall sees. */
static inline avc_couple_out_t avc_pushed_step(avc_control_t *c, const avc_table_t *table, float *position_m)
{
    /* Safe gains mean the same whatever the table, and may be a damper alone, which clip-last would feel everywhere. */
    const bool safe = c->state.mode == AVC_MODE_SAFE;
    const bool clips = (table->image.header.flags & AVC_TABLE_CLIPS) != 0u && !safe;
    bool begins = !c->begun;
    c->begun = true;
    if (avc_states(&table->image.header) != 0u && !safe) {
        begins = begins || !c->feedback.started;
        *position_m = avc_feedback_step(&c->feedback, &table->image, *position_m, c->previous_force);
        if (begins) { /* from the measured position to the one that the wall sees nothing has moved */
            avc_couple_start(&c->couple, *position_m);
        }
    }
    if (begins && !clips) {
        avc_see_penetration(c);
    }
    return avc_couple(c, table, *position_m, clips);
}

/* The coupling's force, guarded where the table asks for it, scaled by the supervision, limited last. */
static inline float avc_law(avc_control_t *c, const avc_table_t *table, float x, float work_j)
{
    avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    float position_m = x;
    const avc_couple_out_t out = avc_pushed_step(c, table, &position_m);
    s->contact = out.tool_m > 0.0f || out.force_n > 0.0f ? 1u : 0u; /* clip-last pushes before the surface */
    float force = out.force_n;
    if ((header->flags & AVC_TABLE_GUARD) != 0u) {
        const avc_guard_in_t watched = {.position_m = position_m, .force_n = force, .stored_j = out.stored_j};
        avc_guard_out_t guarded;
        avc_guard_step(&c->guard, &watched, &guarded, c->config.number);
        force = guarded.guarded_n;
    }
    force = force * c->scale;
    if (!avc_is_finite(force + out.tool_m)) { /* neither where one of them is not */
        s->not_finite++;
        return avc_fail(c, AVC_FAULT_NOT_FINITE, x);
    }
    const float most = c->most_n;
    bool clipped = avc_bits(c->scale) != avc_bits(1.0f);
    if ((avc_bits(force) & 0x7FFFFFFFu) > avc_bits(most)) { /* its size */
        s->saturated++;
        force = force > most ? most : -most;
        clipped = true;
    }
    if (clipped || c->clipped) {
        c->clipped = clipped;
        c->fault.settled = false;
    }
    if ((s->mode | s->streaming) != 0u && /* safe or streamed: a table has gains */
        s->gains.stiffness_n_per_m + s->gains.damping_ns_per_m < no_gains) {
        c->fault.settled = false; /* nothing joins the device to the wall: what its spring holds nobody gets */
    }
    if (avc_fault_energy(&c->fault, work_j, out.stored_j)) {
        return avc_fail(c, AVC_FAULT_ENERGY, x);
    }
    c->couple.asked_force_n = force; /* what the actuator holds, not what was wanted */
    c->guard.held_force_n = force;
    return force;
}

#endif
