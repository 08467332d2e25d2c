#include "avc_attend.h"

#include <stdatomic.h>

#include "avc_takeover.h"

static bool free_of_wall(const avc_control_t *c)
{
    return c->state.has_table == 0u || (c->state.contact == 0u && c->state.position_m <= 0.0f);
}

/* Here, without a table: what ran before knew another place of the wall. */
static void set_zero(avc_control_t *c, int32_t raw_count)
{
    const uint32_t by = (uint32_t)raw_count - (uint32_t)c->zero;
    c->zero_wanted = 0u;
    c->zero = raw_count;
    c->state.encoder_count = (int32_t)((uint32_t)c->state.encoder_count - by);
    c->state.has_table = 0u;
    c->state.contact = 0u;
    c->estimates = false;
    c->has_zero = 1u;
}

/* A lower force limit at once; a higher one out of contact, where no spring is held back by the old one. */
static void adopt_limits(avc_control_t *c)
{
    if (c->wanted.force_n > c->lowered.force_n && !free_of_wall(c)) {
        return;
    }
    c->lowered = c->wanted;
    avc_limit_force(c);
    avc_fault_limit(&c->fault, &c->limits, c->wanted.speed_m_per_s, c->wanted.energy_j);
    c->limits_wanted = 0u;
}

void avc_attend(avc_control_t *c, int32_t raw_count)
{
    c->asked = 0u;
    atomic_signal_fence(memory_order_acquire);
    if (c->zero_wanted != 0u) {
        set_zero(c, raw_count);
    }
    if (c->latch_wanted != 0u) {
        avc_control_fault(c, c->latch_wanted);
        c->latch_wanted = 0u;
    }
    if (c->limits_wanted != 0u) {
        adopt_limits(c);
        c->asked = c->limits_wanted;
    }
    if (c->pause_wanted != 0u && free_of_wall(c)) {
        c->paused = 1u;
    }
    if (c->pause_wanted != 0u || c->paused != 0u) {
        c->asked = 1u;
    }
}

void avc_idle(avc_control_t *c, int32_t encoder_count)
{
    avc_state_t *s = &c->state;
    c->fault.moved = (int32_t)((uint32_t)encoder_count - (uint32_t)s->encoder_count);
    s->encoder_count = encoder_count;
    s->position_m = (float)encoder_count * c->limits.metres_per_count;
    s->force_n = 0.0f;
    c->previous_force = 0.0f;
    avc_rest(c, s->position_m);
    if (c->pause_wanted == 0u) {
        c->paused = 0u;
        if (s->mode == AVC_MODE_TABLE || s->mode == AVC_MODE_RAMP) {
            s->mode = AVC_MODE_SAFE;
        }
        c->scale = 0.0f;
    }
    s->ticks++;
}
