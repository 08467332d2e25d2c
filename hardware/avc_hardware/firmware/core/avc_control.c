#include "avc_control.h"

#include <stdatomic.h>
#include <string.h>

static const float filter_cutoff_hz = 100.0f;
static const float rest_s = 1.0f;
static const float hysteresis_counts = 3.0f; /* a tick, as velocity: less is encoder noise */
static const float ramp_s = 0.1f;

static float not_a_number(void)
{
    const uint32_t bits = 0x7FC00000u;
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

void avc_estimator_reset(avc_estimator_t *estimator)
{
    memset(estimator, 0, sizeof *estimator);
    estimator->frequency_hz = not_a_number();
}

void avc_control_init(avc_control_t *control, const avc_limits_t *limits)
{
    memset(control, 0, sizeof *control);
    control->limits = *limits;
    control->rate_hz = 1.0f / limits->sample_time_s;
    const float omega_t = 6.28318548f * filter_cutoff_hz * limits->sample_time_s;
    control->smoothing = omega_t / (1.0f + omega_t);
    control->hysteresis_m_per_s = hysteresis_counts * limits->metres_per_count * control->rate_hz * control->smoothing;
    control->rest_ticks = rest_s * control->rate_hz;
    control->scale = 1.0f;
    control->wall_damping_ns_per_m = limits->wall_damping_ns_per_m;
    control->wall_stiffness_n_per_m = limits->wall_stiffness_n_per_m;
    avc_estimator_reset(&control->estimator);
    control->state.frequency_hz = not_a_number();
}

float avc_estimator_step(avc_estimator_t *estimator, float velocity, const avc_control_t *settings)
{
    const float before = estimator->velocity;
    const float now = before + settings->smoothing * (velocity - before);
    estimator->velocity = now;
    estimator->age = estimator->age + 1.0f;
    if ((before < 0.0f) != (now < 0.0f)) {
        estimator->crossing = estimator->age - now / (now - before); /* between the two samples */
    }
    int32_t sign = 0;
    if (now > settings->hysteresis_m_per_s) {
        sign = 1;
    } else if (now < -settings->hysteresis_m_per_s) {
        sign = -1;
    }
    if (sign != 0 && sign != estimator->sign) {
        const float half = estimator->crossing;
        if (estimator->sign != 0) {
            estimator->halves += estimator->halves < 3u ? 1u : 0u;
        }
        if (estimator->halves == 3u) { /* the first half wave began at rest and does not count */
            estimator->frequency_hz = settings->rate_hz / (estimator->half + half);
        }
        estimator->sign = sign;
        estimator->half = half;
        estimator->age = estimator->age - half;
        estimator->crossing = 0.0f;
    }
    if (estimator->age > settings->rest_ticks) {
        avc_estimator_reset(estimator);
        estimator->velocity = now;
    }
    return estimator->frequency_hz;
}

/* No memory of another position: nothing is stretched, nothing has moved. */
static void coupling_rest(avc_coupling_t *coupling, float x)
{
    const float depth = x > 0.0f ? x : 0.0f;
    *coupling = (avc_coupling_t){0.0f, depth, depth, x};
}

static bool in_contact(const avc_coupling_t *coupling)
{
    return coupling->tool_m > 0.0f;
}

static float approach(float now, float goal, float share)
{
    const float step = share * (now > goal ? now : goal);
    if (goal > now + step) {
        return now + step;
    }
    if (goal < now - step) {
        return now - step;
    }
    return goal;
}

/* Heartbeat: missed, the force ramps to zero; then static safe gains, from the next time out of contact. */
static void supervise(avc_control_t *c)
{
    if (c->heartbeat_seen != 0u) {
        c->heartbeat_seen = 0u;
        atomic_signal_fence(memory_order_acquire);
        c->heartbeat_left = c->heartbeat_ticks;
    }
    const bool watched = c->heartbeat_ticks != 0u;
    const bool alive = !watched || c->heartbeat_left != 0u;
    if (watched && c->heartbeat_left != 0u) {
        c->heartbeat_left--;
    }
    if (c->state.mode == AVC_MODE_TABLE) {
        if (!alive) {
            c->state.mode = AVC_MODE_RAMP;
            c->state.heartbeats_missed++;
        }
    } else if (c->state.mode == AVC_MODE_RAMP) {
        c->scale = c->scale - c->limits.sample_time_s / ramp_s;
        if (c->scale <= 0.0f) {
            c->scale = 0.0f;
            c->state.mode = AVC_MODE_SAFE;
        }
    } else if (!in_contact(&c->coupling)) {
        c->scale = 1.0f;
        if (alive) {
            c->state.mode = AVC_MODE_TABLE;
        }
    }
}

static bool streamed(avc_control_t *c, avc_gains_t *goal)
{
    if (c->stream_fresh != 0u) {
        c->stream_fresh = 0u;
        atomic_signal_fence(memory_order_acquire);
        c->stream_left = c->stream[c->stream_slot].ticks;
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

static void choose_gains(avc_control_t *c, const avc_table_t *table)
{
    const avc_table_header_t *header = &table->image.header;
    avc_gains_t goal;
    c->state.streaming = 0u;
    if (c->state.mode == AVC_MODE_SAFE) {
        goal = (avc_gains_t){header->safe_damping_ns_per_m, header->safe_stiffness_n_per_m, 0.0f};
    } else if (streamed(c, &goal)) {
        c->state.streaming = 1u;
    } else {
        goal = avc_table_lookup(table, c->state.frequency_hz);
    }
    avc_gains_t *gains = &c->state.gains;
    if (header->slew_per_s > 0.0f && in_contact(&c->coupling)) {
        const float share = header->slew_per_s * c->limits.sample_time_s;
        gains->damping_ns_per_m = approach(gains->damping_ns_per_m, goal.damping_ns_per_m, share);
        gains->stiffness_n_per_m = approach(gains->stiffness_n_per_m, goal.stiffness_n_per_m, share);
        gains->contact_damping_ns_per_m =
            approach(gains->contact_damping_ns_per_m, goal.contact_damping_ns_per_m, share);
    } else {
        *gains = goal;
    }
}

float avc_control_tick(avc_control_t *c, int32_t encoder_count)
{
    avc_state_t *s = &c->state;
    if (c->swap_wanted != 0u) { /* the only place where the table changes */
        atomic_signal_fence(memory_order_acquire);
        c->active = 1u - c->active;
        s->has_table = 1u;
        const avc_table_header_t *fresh = &c->tables[c->active].image.header;
        if ((fresh->flags & AVC_TABLE_WALL) != 0u) {
            c->wall_damping_ns_per_m = fresh->wall_damping_ns_per_m;
            c->wall_stiffness_n_per_m = fresh->wall_stiffness_n_per_m;
        }
        s->swaps++;
        c->swap_wanted = 0u;
    }
    const int32_t moved = (int32_t)((uint32_t)encoder_count - (uint32_t)s->encoder_count); /* wraps rightly */
    const float step = c->started ? (float)moved * c->limits.metres_per_count : 0.0f;
    const float x = (float)encoder_count * c->limits.metres_per_count;
    c->started = true;
    s->encoder_count = encoder_count;
    s->position_m = x;
    s->velocity_m_per_s = step * c->rate_hz;
    s->energy_j = s->energy_j + c->previous_force * step;
    s->frequency_hz = avc_estimator_step(&c->estimator, s->velocity_m_per_s, c);
    supervise(c);

    float force = 0.0f;
    if (s->has_table != 0u) {
        choose_gains(c, &c->tables[c->active]);
        force = avc_coupling_step(&c->coupling, x, &s->gains, c->wall_damping_ns_per_m, c->wall_stiffness_n_per_m,
                                  c->limits.sample_time_s) *
                c->scale;
    } else {
        coupling_rest(&c->coupling, x);
    }
    if (!avc_is_finite(force) || !avc_is_finite(c->coupling.tool_m)) {
        force = 0.0f;
        s->not_finite++;
        coupling_rest(&c->coupling, x);
    }
    if (force > c->limits.max_force_n) { /* a wall pushes only: there is no other limit */
        force = c->limits.max_force_n;
        s->saturated++;
    }
    s->contact = in_contact(&c->coupling) ? 1u : 0u;
    s->force_n = force;
    c->previous_force = force;
    s->ticks++;
    return force;
}
