#include "avc_supervision.h"

#include <stdatomic.h>

#include "avc_takeover.h"

static const float ramp_s = 0.1f;

void avc_control_fault(avc_control_t *c, uint32_t codes)
{
    if (codes != 0u) {
        avc_fault_raise(&c->fault, codes, c->state.ticks, c->previous_force, c->config.limits.sample_time_s);
        c->state.mode = AVC_MODE_FAULT;
    }
}

uint32_t avc_faults(const avc_control_t *c)
{
    const bool silent = c->state.mode == AVC_MODE_RAMP || (c->state.mode == AVC_MODE_SAFE && c->silent);
    return c->fault.codes | (silent ? (uint32_t)AVC_FAULT_HEARTBEAT : 0u);
}

float avc_fail(avc_control_t *c, uint32_t codes, float x)
{
    avc_control_fault(c, codes);
    avc_rest(c, x);
    c->fault.lacking_j = 0.0f;
    c->stream_fresh = 0u;
    c->stream_left = 0u;
    c->state.streaming = 0u;
    c->state.contact = x > 0.0f ? 1u : 0u;
    if (c->excite.busy != 0u) {
        c->excite.state = AVC_EXCITE_FAULT;
        c->state.has_table = 0u;
        c->excite.busy = 0u;
    }
    return avc_fault_fade(&c->fault);
}

/* Whether the host has been heard of in time, where it wants to be watched. */
static bool hears(avc_control_t *c)
{
    if (c->heartbeat_seen != 0u) {
        c->heartbeat_seen = 0u;
        atomic_signal_fence(memory_order_acquire);
        c->heartbeat_ticks = c->heartbeat_wanted;
        c->heartbeat_left = c->heartbeat_ticks;
        c->silent = false;
    }
    if (c->heartbeat_ticks == 0u) {
        return true;
    }
    c->silent = c->heartbeat_left == 0u;
    c->heartbeat_left -= c->silent ? 0u : 1u;
    return !c->silent;
}

/* What is latched, less what the host has cleared; from there on as after a lost heartbeat: force only after contact. */
static void clear(avc_control_t *c)
{
    c->fault.codes &= ~c->fault.clear_wanted;
    c->fault.clear_wanted = 0u;
    if (c->fault.codes == 0u) {
        c->state.mode = AVC_MODE_SAFE;
        c->scale = 0.0f;
    }
}

void avc_leave_or_return(avc_control_t *c, float x)
{
    const bool alive = hears(c);
    if (c->state.mode == AVC_MODE_TABLE) {
        if (!alive) {
            c->state.mode = AVC_MODE_RAMP;
            c->state.heartbeats_missed++;
        }
    } else if (c->state.mode == AVC_MODE_RAMP) {
        c->scale = c->scale - c->config.limits.sample_time_s / ramp_s;
        if (c->scale <= 0.0f) {
            c->scale = 0.0f;
            c->state.mode = AVC_MODE_SAFE;
            avc_see_penetration(c); /* the safe gains are gated */
        }
    } else if (c->state.mode == AVC_MODE_FAULT) { /* only the host leads out */
        if (c->fault.clear_wanted != 0u) {
            clear(c);
        }
    } else if (c->state.has_table == 0u || (c->state.contact == 0u && x <= 0.0f)) {
        if (c->scale == 0.0f) { /* the gains of before are gone, not slewed away */
            avc_rest(c, x);
            c->scale = 1.0f;
        }
        if (alive && (c->state.has_table == 0u || avc_out_of_wall(&c->tables[c->active], x))) {
            avc_rest(c, x);
            c->state.mode = AVC_MODE_TABLE;
        }
    }
}
