#include "avc_control.h"

#include <stdatomic.h>
#include <string.h>

#include "avc_lookup.h"
#include "avc_takeover.h"

static const float longest_hold_s = 5.0f;

void avc_control_relimit(avc_control_t *control)
{
    const avc_limits_t *limits = &control->config.limits;
    control->rate_hz = 1.0f / limits->sample_time_s;
    control->lowered = (avc_lowered_t){limits->max_force_n, limits->max_speed_m_per_s, limits->max_energy_j};
    control->blind = 2u;
    avc_fault_init(&control->fault, limits);
}

void avc_control_init(avc_control_t *control, const avc_config_t *config, bool bound)
{
    memset(control, 0, sizeof *control);
    control->config = *config;
    control->next = *config;
    control->bound = bound;
    control->scale = 1.0f;
    control->state.frequency_hz = __builtin_nanf("");
    avc_control_relimit(control);
}

bool avc_control_drives(const avc_control_t *c)
{
    const bool runs = c->state.has_table != 0u && c->state.mode != AVC_MODE_FAULT;
    return runs || c->excite.busy != 0u || c->state.force_n != 0.0f;
}

uint32_t avc_longest_hold(const avc_control_t *control)
{
    return (uint32_t)(longest_hold_s * control->rate_hz + 0.5f);
}

/* How often the hand moves, as long as gains follow it. */
static void estimate(avc_control_t *c, const avc_table_t *table, float x)
{
    avc_state_t *s = &c->state;
    const float lowest_hz = s->has_table != 0u ? table->image.row[0].frequency_hz : 1.0f;
    if (s->has_table != 0u && !avc_varies(table) && c->stream_left == 0u) {
        c->estimates = false;
        s->frequency_hz = __builtin_nanf("");
        s->lookup_hz = lowest_hz;
        return;
    }
    if (!c->estimates) {
        c->estimates = true;
        avc_estimate_start(&c->estimate, x, c->config.number);
    }
    const avc_estimate_in_t seen = {x, lowest_hz};
    avc_estimate_out_t found;
    avc_estimate_step(&c->estimate, &seen, &found, c->config.number);
    s->frequency_hz = avc_bits(found.valid) != 0u ? found.estimate_hz : __builtin_nanf("");
    s->lookup_hz = found.frequency_hz;
}

static float excite(avc_control_t *c, float x, int32_t encoder_count)
{
    if (c->excite.state != AVC_EXCITE_RUNS) {
        avc_excite_start(&c->excite, &c->config.limits, encoder_count, c->state.ticks);
        c->state.has_table = 0u; /* no force after it until a table is pushed anew */
        c->state.contact = 0u;
    }
    avc_rest(c, x);
    return -avc_excite_tick(&c->excite, encoder_count);
}

/* N/m and N.s/m: slewed to 0 a gain is small at last, and gives a force that nothing tells from none. */
static const float no_gains = 1e-12f;

static bool streamed(avc_control_t *c, avc_gains_t *goal)
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
static avc_gains_t choose_gains(avc_control_t *c, const avc_table_t *table, float *rest_stiffness_n_per_m)
{
    const avc_table_header_t *header = &table->image.header;
    avc_gains_t goal;
    c->state.streaming = 0u;
    *rest_stiffness_n_per_m = 0.0f;
    if (c->state.mode == AVC_MODE_SAFE) {
        goal = (avc_gains_t){header->safe_damping_ns_per_m, header->safe_stiffness_n_per_m, 0.0f};
        c->stream_fresh = 0u;
        c->stream_left = 0u;
    } else if (streamed(c, &goal)) {
        c->state.streaming = 1u;
    } else {
        goal = avc_table_lookup(table, c->state.lookup_hz);
        *rest_stiffness_n_per_m = table->image.row[0].stiffness_n_per_m;
    }
    return goal;
}

/* The coupling's force; gains that stay run without adaptation. */
static avc_couple_out_t couple(avc_control_t *c, const avc_table_t *table, float position_m, bool clips)
{
    avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    float rest_stiffness_n_per_m;
    const avc_gains_t goal = choose_gains(c, table, &rest_stiffness_n_per_m);
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
static avc_couple_out_t pushed_step(avc_control_t *c, const avc_table_t *table, float *position_m)
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
    return couple(c, table, *position_m, clips);
}

/* The coupling's force, guarded where the table asks for it, scaled by the supervision, limited last. */
static float law(avc_control_t *c, const avc_table_t *table, float x, float work_j)
{
    avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    float position_m = x;
    const avc_couple_out_t out = pushed_step(c, table, &position_m);
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

/* Of a tick that has ended, while a host is subscribed. */
static void record(avc_control_t *control)
{
    avc_telemetry_t *t = &control->telemetry;
    const avc_state_t *s = &control->state;
    t->left--;
    if (t->wait != 0u) {
        t->wait--;
        return;
    }
    t->wait = t->every - 1u;
    if (t->made - t->sent >= AVC_SAMPLES_KEPT) {
        return;
    }
    t->kept[t->made % AVC_SAMPLES_KEPT] = (avc_sample_t){
        .ticks = s->ticks,
        .encoder_count = s->encoder_count,
        .velocity_m_per_s = s->velocity_m_per_s,
        .force_n = s->force_n,
        .frequency_hz = s->frequency_hz,
        .damping_ns_per_m = s->gains.damping_ns_per_m,
        .stiffness_n_per_m = s->gains.stiffness_n_per_m,
        .contact_damping_ns_per_m = s->gains.contact_damping_ns_per_m,
        .energy_j = s->energy_j,
        .faults = avc_faults(control),
        .mode = s->mode,
        .streaming = s->streaming,
        .contact = s->contact,
        .has_table = s->has_table,
    };
    atomic_signal_fence(memory_order_release);
    t->made++;
}

float avc_control_tick(avc_control_t *c, int32_t encoder_count)
{
    if (c->limits_wanted != 0u) {
        avc_adopt_limits(c);
    }
    avc_state_t *s = &c->state;
    int32_t moved = (int32_t)((uint32_t)encoder_count - (uint32_t)s->encoder_count); /* wraps rightly */
    if (c->swap_wanted != 0u) { /* the only place where table and configuration change */
        avc_swap(c, (float)encoder_count * c->next.limits.metres_per_count);
    }
    const float x = (float)encoder_count * c->config.limits.metres_per_count;
    int32_t watched = moved;
    if (c->blind != 0u) {
        c->blind--;
        watched = 0;
        moved = c->started ? moved : 0;
        c->started = true;
    }
    const avc_table_t *table = &c->tables[c->active];
    __asm__("" : "+r"(table)); /* otherwise each access begins from c and the index anew: 30 instructions */
    const float step = (float)moved * c->config.limits.metres_per_count;
    s->encoder_count = encoder_count;
    s->position_m = x;
    s->velocity_m_per_s = step * c->rate_hz;
    const float work_j = c->previous_force * step;
    s->energy_j = s->energy_j + work_j;
    const uint32_t wrong = avc_fault_watch(&c->fault, watched, c->previous_force, s->overruns);
    estimate(c, table, x);
    if ((c->heartbeat_seen | c->heartbeat_ticks | s->mode) != 0u) {
        avc_leave_or_return(c, x);
    }
    float force = 0.0f;
    if ((wrong | c->fault.codes) != 0u) {
        force = avc_fail(c, wrong, x);
    } else if (c->excite.busy != 0u) {
        force = excite(c, x, encoder_count);
    } else if (s->has_table != 0u) {
        force = law(c, table, x, work_j);
    } else {
        avc_rest(c, x);
    }
    s->force_n = force;
    c->previous_force = force;
    s->ticks++;
    if (c->telemetry.left != 0u) {
        record(c);
    }
    return force;
}
