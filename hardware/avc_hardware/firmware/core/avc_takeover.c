#include "avc_takeover.h"

#include <stdatomic.h>

static const uint32_t ticks_away = 10u;
static const float ramp_s = 0.1f;
static const float fade_s = 0.02f;
static const float forget_s = 1.0f;
static const float slow_s = 0.02f;
/* Counts that quantisation adds to a movement, and to the difference of two. */
static const float quantised = 2.0f;

/* As many as no movement has where there is no limit. */
static uint32_t counts_of(float metres, float metres_per_count)
{
    const float counts = metres / metres_per_count;
    return metres > 0.0f && counts < 5e8f ? (uint32_t)(counts + quantised) : 0x7FFFFFFFu;
}

/* Limits of speed and energy; 0: not watched. */
static void limit_motion(avc_fault_t *fault, const avc_limits_t *limits, float speed_m_per_s, float energy_j)
{
    fault->most_moved = counts_of(speed_m_per_s * limits->sample_time_s, limits->metres_per_count);
    fault->least_j = energy_j > 0.0f ? -energy_j : -3e38f;
}

void avc_fault_init(avc_fault_t *fault, const avc_limits_t *limits)
{
    const float time = limits->sample_time_s;
    fault->most_change = counts_of(limits->max_acceleration_m_per_s2 * time * time, limits->metres_per_count);
    fault->most_overruns = limits->max_overruns > 0.0f ? (uint32_t)limits->max_overruns : 0xFFFFFFFFu;
    fault->swing_n = limits->stuck_swing_n;
    fault->slow_ticks = (uint32_t)(slow_s / time);
    fault->keep = 1.0f - time / forget_s;
    limit_motion(fault, limits, limits->max_speed_m_per_s, limits->max_energy_j);
}

static float within(float x, float low, float high)
{
    const float above = x > low ? x : low;
    return above < high ? above : high;
}

/* How far the dead zone is closed: 1 at rest, 0 where the device has moved of late. */
static float closed_share(avc_feedback_state_t *state, const avc_feedback_t *feedback, float position_m)
{
    if (!state->started) {
        state->lag_m = 0.0f;
        state->above_m = 0.0f;
        state->below_m = 0.0f;
        state->measured_m = position_m;
    }
    const float moved = position_m - state->measured_m;
    const float lag = feedback->smoothing * (state->lag_m + moved);
    const float smoothly = state->lag_m + moved - lag;
    const float above = within(feedback->kept * (state->above_m - smoothly), 0.0f, feedback->open_m);
    const float below = within(feedback->kept * (state->below_m + smoothly), 0.0f, feedback->open_m);
    state->measured_m = position_m;
    state->lag_m = lag;
    state->above_m = above;
    state->below_m = below;
    return 1.0f - within((above + below - feedback->opens_m) * feedback->opening_per_m, 0.0f, 1.0f);
}

float avc_feedback_step(avc_feedback_state_t *state, const avc_image_t *image, float position_m, float force_n)
{
    const avc_feedback_t *feedback = &image->feedback;
    const uint32_t n = avc_states(&image->header);
    const float *a = feedback->number;
    const float *b = &a[n * n];
    const float *gain = &b[n];
    const float *weight = &gain[n];
    const float half = feedback->dead_zone_m;
    const float closed = closed_share(state, feedback, position_m);
    const float seen = position_m + closed * feedback->face_m;
    float believed[AVC_STATES_MAX];
    if (state->started) {
        for (uint32_t row = 0; row < n; row++) {
            float sum = a[row * n] * state->s_m[0];
            for (uint32_t column = 1; column < n; column++) {
                sum = sum + a[row * n + column] * state->s_m[column];
            }
            believed[row] = b[row] * force_n + sum;
        }
    } else {
        for (uint32_t row = 0; row < n; row++) {
            believed[row] = ((uint32_t)feedback->positions >> row & 1u) != 0u ? seen : 0.0f;
        }
        state->started = true;
    }
    float error = seen - believed[feedback->measures];
    error = error - closed * within(error, -half, half);
    float position = 0.0f;
    for (uint32_t row = 0; row < n; row++) {
        const float value = believed[row] + gain[row] * error;
        state->s_m[row] = value;
        position = row == 0u ? weight[0] * value : position + weight[row] * value;
    }
    return position;
}

void avc_rest(avc_control_t *c, float x)
{
    avc_couple_start(&c->couple, x);
    avc_guard_start(&c->guard, x);
    c->feedback.started = false;
    c->fault.settled = false;
    c->begun = false;
}

bool avc_out_of_wall(const avc_table_t *table, float x)
{
    float seen = x;
    if (avc_states(&table->image.header) != 0u) {
        avc_feedback_state_t begun = {.started = false};
        seen = avc_feedback_step(&begun, &table->image, x, 0.0f);
    }
    return x <= 0.0f && seen <= 0.0f;
}

static void limit_force(avc_control_t *c)
{
    const float tables = c->tables[c->active].image.header.max_force_n; /* 0: the board's own */
    c->most_n = tables > 0.0f && tables < c->lowered.force_n ? tables : c->lowered.force_n;
}

void avc_adopt_limits(avc_control_t *c)
{
    const bool released = c->state.has_table == 0u || (c->state.contact == 0u && c->state.position_m <= 0.0f);
    atomic_signal_fence(memory_order_acquire);
    if (c->wanted.force_n > c->lowered.force_n && !released) {
        return;
    }
    c->lowered = c->wanted;
    limit_force(c);
    limit_motion(&c->fault, &c->config.limits, c->wanted.speed_m_per_s, c->wanted.energy_j);
    c->limits_wanted = 0u;
}

void avc_swap(avc_control_t *c, float x)
{
    atomic_signal_fence(memory_order_acquire);
    c->away = avc_out_of_wall(&c->tables[1u - c->active], x) ? c->away + 1u : 0u;
    if (c->away == 0u || (c->state.contact != 0u && c->away < ticks_away)) {
        c->waited++;
        return;
    }
    c->swap_tick = c->state.ticks;
    c->swap_waited = c->waited;
    c->waited = 0u;
    c->away = 0u;
    c->active = 1u - c->active;
    if (c->next.crc32 != c->config.crc32) {
        c->config = c->next;
        c->estimates = false;
        if (!c->bound) {
            avc_control_relimit(c);
        }
    }
    limit_force(c);
    c->stream_fresh = 0u;
    c->stream_left = 0u;
    avc_rest(c, x);
    c->state.has_table = c->tables[c->active].image.header.rows != 0u ? 1u : 0u;
    c->state.swaps++;
    c->swap_wanted = 0u;
}

/* The force falls from the last good one. */
void avc_control_fault(avc_control_t *c, uint32_t codes)
{
    avc_fault_t *fault = &c->fault;
    if (codes == 0u) {
        return;
    }
    if (fault->codes == 0u) {
        fault->first = codes;
        fault->first_tick = c->state.ticks;
        fault->fading_n = c->previous_force;
        fault->fade_n = __builtin_fabsf(c->previous_force) * c->config.limits.sample_time_s / fade_s;
    }
    fault->codes |= codes;
    c->state.mode = AVC_MODE_FAULT;
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
    const float left = __builtin_fabsf(c->fault.fading_n) - c->fault.fade_n;
    const float size = left > 0.0f ? left : 0.0f;
    c->fault.fading_n = c->fault.fading_n < 0.0f ? -size : size;
    return c->fault.fading_n;
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
