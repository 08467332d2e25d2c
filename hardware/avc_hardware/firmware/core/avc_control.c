#include "avc_control.h"

#include <stdatomic.h>
#include <string.h>

static const float ramp_s = 0.1f;
static const float longest_hold_s = 5.0f;
static const uint32_t ticks_away = 10u;

static float not_a_number(void)
{
    const uint32_t bits = 0x7FC00000u;
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

void avc_control_init(avc_control_t *control, const avc_limits_t *limits)
{
    memset(control, 0, sizeof *control);
    control->limits = *limits;
    control->rate_hz = 1.0f / limits->sample_time_s;
    control->scale = 1.0f;
    control->state.frequency_hz = not_a_number();
    control->lowered = (avc_lowered_t){limits->max_force_n, limits->max_speed_m_per_s, limits->max_energy_j};
    avc_fault_init(&control->fault, limits);
    if (AVC_IS_BUILT_IN) { /* it waits for the device to be out of contact, as after a lost heartbeat */
        avc_table_t *table = &control->tables[control->active];
        table->image.header = avc_built_in;
        table->id = avc_built_in.coupling_id;
        control->state.has_table = 1u;
        control->state.mode = AVC_MODE_SAFE;
        control->scale = 0.0f;
        control->most_n = avc_force_limit(&avc_built_in, limits);
    }
}

void avc_control_fault(avc_control_t *c, uint32_t codes)
{
    if (codes != 0u) {
        avc_fault_raise(&c->fault, codes, c->state.ticks, c->previous_force, c->limits.sample_time_s);
        c->state.mode = AVC_MODE_FAULT;
    }
}

uint32_t avc_faults(const avc_control_t *c)
{
    const bool silent = c->state.mode == AVC_MODE_RAMP || (c->state.mode == AVC_MODE_SAFE && c->silent);
    return c->fault.codes | (silent ? (uint32_t)AVC_FAULT_HEARTBEAT : 0u);
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

static bool within(float *limit, float boards)
{
    if (*limit == 0.0f) {
        *limit = boards;
    }
    return avc_is_finite(*limit) && *limit >= 0.0f && (boards <= 0.0f || *limit <= boards);
}

bool avc_lowered_check(avc_lowered_t *lowered, const avc_limits_t *boards)
{
    return within(&lowered->force_n, boards->max_force_n) && within(&lowered->speed_m_per_s, boards->max_speed_m_per_s) &&
           within(&lowered->energy_j, boards->max_energy_j);
}

float avc_most_force(const avc_control_t *c)
{
    const bool falls = c->limits_wanted != 0u && c->wanted.force_n < c->lowered.force_n;
    return falls ? c->wanted.force_n : c->lowered.force_n;
}

static void rest(avc_control_t *c, float x)
{
    avc_couple_start(&c->couple, x);
    avc_guard_start(&c->guard, x);
    c->feedback.started = false;
    if (AVC_IS_BUILT_IN) {
        avc_coupling_start(&c->built_in);
    }
    c->fault.settled = false;
    c->begun = false;
    c->steadies = false;
}

static bool varies(const avc_table_t *table)
{
    return (table->image.header.flags & AVC_TABLE_VARIES) != 0u;
}

static float at_least_0(float x)
{
    return x > 0.0f ? x : 0.0f;
}

/* What the gated law remembers of the wall: where the other one, or a start, has left a place before it, there is none. */
static void see_penetration(avc_control_t *c)
{
    c->couple.environment_deflection_before_m = at_least_0(c->couple.environment_deflection_before_m);
}

/* The coupling begins, out of contact: with gains that stay where they may, and none of another kind are on the way. */
static void begin(avc_control_t *c, const avc_table_t *table)
{
    c->begun = true;
    if (varies(table) || c->state.mode == AVC_MODE_SAFE || c->stream_fresh != 0u) {
        return;
    }
    const avc_row_t *row = &table->image.row[0];
    c->steadies = true;
    c->steady = table->steady;
    c->state.gains = (avc_gains_t){row->damping_ns_per_m, row->stiffness_n_per_m, row->contact_damping_ns_per_m};
    c->state.streaming = 0u;
    if ((table->image.header.flags & AVC_TABLE_CLIPS) == 0u) {
        see_penetration(c);
    }
}

/* Other gains come: they are slewed to from those that stayed, with nothing in the tank that pays for a change. */
static void adapt(avc_control_t *c, const avc_table_t *table)
{
    const avc_table_header_t *header = &table->image.header;
    avc_couple_state_t *state = &c->couple;
    const float depth = at_least_0(state->environment_deflection_before_m);
    const float spring = state->coupling_deflection_before_m;
    const float stretch = (header->flags & AVC_TABLE_CLIPS) != 0u ? at_least_0(spring) : spring;
    c->steadies = false;
    state->environment_energy_j = 0.5f * header->wall_stiffness_n_per_m * depth * depth;
    state->asked_force_n = c->previous_force;
    state->adaptation_started = 1.0f;
    state->adaptation_damping_ns_per_m = c->state.gains.damping_ns_per_m;
    state->adaptation_stiffness_n_per_m = c->state.gains.stiffness_n_per_m;
    state->adaptation_contact_damping_ns_per_m = c->state.gains.contact_damping_ns_per_m;
    state->adaptation_stored_j =
        0.5f * c->state.gains.stiffness_n_per_m * stretch * stretch + state->environment_energy_j;
    state->adaptation_held_force_n = c->previous_force;
    state->adaptation_position_m = at_least_0(state->contact_position_before_m);
}

/* Whether a table that begins here gives no force and stores no energy. */
static bool out_of_wall(const avc_table_t *table, float x)
{
    float seen = x;
    if (AVC_IS_BUILT_IN) {
        avc_coupling_t begun;
        avc_coupling_start(&begun);
        seen = avc_coupling_step(&begun, x);
    } else if (avc_states(&table->image.header) != 0u) {
        avc_feedback_state_t begun = {.started = false};
        seen = avc_feedback_step(&begun, &table->image, x, 0.0f);
    }
    return x <= 0.0f && seen <= 0.0f;
}

/* Heartbeat: missed, the force ramps to zero; then static safe gains, from the next time out of contact. */
static void supervise(avc_control_t *c, float x)
{
    if (c->heartbeat_seen != 0u) {
        c->heartbeat_seen = 0u;
        atomic_signal_fence(memory_order_acquire);
        c->heartbeat_ticks = c->heartbeat_wanted;
        c->heartbeat_left = c->heartbeat_ticks;
        c->silent = false;
    }
    const bool watched = c->heartbeat_ticks != 0u;
    const bool alive = !watched || c->heartbeat_left != 0u;
    if (watched) {
        c->silent = !alive;
        c->heartbeat_left -= alive ? 1u : 0u;
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
    } else if (c->state.mode == AVC_MODE_FAULT) {
        return; /* only the host leads out */
    } else if (c->state.has_table == 0u || (c->state.contact == 0u && x <= 0.0f)) {
        if (c->scale == 0.0f) { /* the gains of before are gone, not slewed away */
            rest(c, x);
            c->scale = 1.0f;
        }
        if (alive && (c->state.has_table == 0u || out_of_wall(&c->tables[c->active], x))) {
            rest(c, x);
            c->state.mode = AVC_MODE_TABLE;
        }
    }
}

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
        goal = avc_table_lookup(table, c->state.lookup_hz, &c->near);
        *rest_stiffness_n_per_m = table->image.row[0].stiffness_n_per_m;
    }
    return goal;
}

/* A fault has ended it: nothing of the coupling is left, the force falls. */
static float fail(avc_control_t *c, uint32_t codes, float x)
{
    avc_control_fault(c, codes);
    rest(c, x);
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

/* The coupling's force with gains that may change. */
static avc_steady_gated_out_t couple(avc_control_t *c, const avc_table_t *table, float position_m)
{
    avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    float rest_stiffness_n_per_m;
    const avc_gains_t goal = choose_gains(c, table, &rest_stiffness_n_per_m);
    /* Safe gains mean the same whatever the table, and may be a damper alone, which clip-last would feel everywhere. */
    const bool clips = (header->flags & AVC_TABLE_CLIPS) != 0u && s->mode != AVC_MODE_SAFE;
    const avc_couple_in_t in = {
        .position_m = position_m,
        .wanted_damping_ns_per_m = goal.damping_ns_per_m,
        .wanted_stiffness_n_per_m = goal.stiffness_n_per_m,
        .wanted_contact_damping_ns_per_m = goal.contact_damping_ns_per_m,
        .rest_stiffness_n_per_m = rest_stiffness_n_per_m,
        .wall_damping_ns_per_m = header->wall_damping_ns_per_m,
        .wall_stiffness_n_per_m = header->wall_stiffness_n_per_m,
        .relaxes = varies(table) || s->streaming != 0u ? 1.0f : 0.0f,
    };
    avc_couple_out_t out;
    if (clips) {
        avc_couple_clips_step(&c->couple, &in, &out);
    } else {
        see_penetration(c);
        avc_couple_gated_step(&c->couple, &in, &out);
    }
    s->gains = (avc_gains_t){out.damping_ns_per_m, out.stiffness_n_per_m, out.contact_damping_ns_per_m};
    return (avc_steady_gated_out_t){out.force_n, out.tool_m, out.stored_j};
}

/* The force of the exported coupling; none in safe mode, since it has no safe gains. It tells nothing of tool and energy. */
static avc_steady_gated_out_t built_in(avc_control_t *c, float x)
{
    const float force = c->state.mode == AVC_MODE_SAFE ? 0.0f : avc_coupling_step(&c->built_in, x);
    c->fault.settled = false;
    return (avc_steady_gated_out_t){force, x, 0.0f};
}

/* The force of the coupling that was pushed; the position becomes the one that the wall sees. */
static inline avc_steady_gated_out_t pushed(avc_control_t *c, const avc_table_t *table, float *position_m)
{
    const avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    if (!c->steadies) {
        if (!c->begun) {
            begin(c, table);
        }
    } else if (c->stream_fresh != 0u || s->mode == AVC_MODE_SAFE) {
        adapt(c, table);
    }
    if (avc_states(header) != 0u && s->mode != AVC_MODE_SAFE) { /* safe gains mean the same whatever the table */
        *position_m = avc_feedback_step(&c->feedback, &table->image, *position_m, c->previous_force);
    }
    avc_steady_gated_out_t out;
    if (!c->steadies) {
        out = couple(c, table, *position_m);
    } else if ((header->flags & AVC_TABLE_CLIPS) == 0u) {
        avc_steady_gated_step(&c->couple, &c->steady.gated, *position_m, &out);
    } else {
        avc_steady_clips_out_t made;
        avc_steady_clips_step(&c->couple, &c->steady.clips, *position_m, &made);
        out = (avc_steady_gated_out_t){made.force_n, made.tool_m, made.stored_j};
    }
    return out;
}

/* The coupling's force, guarded where the table asks for it, scaled by the supervision. */
static float push(avc_control_t *c, const avc_table_t *table, float x, float work_j)
{
    avc_state_t *s = &c->state;
    const avc_table_header_t *header = &table->image.header;
    float position_m = x;
    const avc_steady_gated_out_t out = AVC_IS_BUILT_IN ? built_in(c, x) : pushed(c, table, &position_m);
    s->contact = out.tool_m > 0.0f || out.force_n > 0.0f ? 1u : 0u; /* clip-last pushes before the surface */
    float force = out.force_n;
    if ((header->flags & AVC_TABLE_GUARD) != 0u) {
        const avc_guard_in_t watched = {.position_m = position_m, .force_n = force, .stored_j = out.stored_j};
        avc_guard_out_t guarded;
        avc_guard_step(&c->guard, &watched, &guarded);
        force = guarded.guarded_n;
    }
    force = force * c->scale;
    if (!avc_is_finite(force + out.tool_m)) { /* neither where one of them is not */
        s->not_finite++;
        return fail(c, AVC_FAULT_NOT_FINITE, x);
    }
    const float most = c->most_n;
    bool clipped = c->scale != 1.0f;
    if (force > most || force < -most) {
        s->saturated++;
        force = force > most ? most : -most;
        clipped = true;
    }
    if (clipped || c->clipped) {
        c->clipped = clipped;
        c->fault.settled = false;
    }
    if (avc_fault_energy(&c->fault, work_j, out.stored_j)) {
        return fail(c, AVC_FAULT_ENERGY, x);
    }
    c->couple.asked_force_n = force; /* what the actuator holds, not what was wanted */
    c->guard.held_force_n = force;
    return force;
}

static void limit_force(avc_control_t *c)
{
    const float tables = avc_force_limit(&c->tables[c->active].image.header, &c->limits);
    c->most_n = c->lowered.force_n < tables ? c->lowered.force_n : tables;
}

/* Out of the wall of the new table, and of the old one too: nothing of it is left. Where an observer goes on believing in
 * contact, being measured out of it for some ticks is enough. */
static void swap(avc_control_t *c, float x)
{
    atomic_signal_fence(memory_order_acquire);
    c->away = out_of_wall(&c->tables[1u - c->active], x) ? c->away + 1u : 0u;
    if (c->away == 0u || (c->state.contact != 0u && c->away < ticks_away)) {
        c->waited++;
        return;
    }
    c->swap_tick = c->state.ticks;
    c->swap_waited = c->waited;
    c->waited = 0u;
    c->away = 0u;
    c->active = 1u - c->active;
    limit_force(c);
    c->near = 0u;
    c->stream_fresh = 0u;
    c->stream_left = 0u;
    rest(c, x);
    c->state.has_table = 1u;
    c->state.swaps++;
    c->swap_wanted = 0u;
}

/* How often the hand moves, as long as gains follow it. */
static void estimate(avc_control_t *c, const avc_table_t *table, float x)
{
    avc_state_t *s = &c->state;
    const float lowest_hz = s->has_table != 0u ? table->image.row[0].frequency_hz : 1.0f;
    if (s->has_table != 0u && !varies(table) && c->stream_left == 0u) {
        c->estimates = false;
        s->frequency_hz = not_a_number();
        s->lookup_hz = lowest_hz;
        return;
    }
    if (!c->estimates) {
        c->estimates = true;
        avc_estimate_start(&c->estimate, x);
    }
    const avc_estimate_in_t seen = {x, lowest_hz};
    avc_estimate_out_t found;
    avc_estimate_step(&c->estimate, &seen, &found);
    s->frequency_hz = found.valid != 0.0f ? found.estimate_hz : not_a_number();
    s->lookup_hz = found.frequency_hz;
}

static float excite(avc_control_t *c, float x, int32_t encoder_count)
{
    if (c->excite.state != AVC_EXCITE_RUNS) {
        avc_excite_start(&c->excite, &c->limits, encoder_count, c->state.ticks);
        c->state.has_table = 0u; /* no force after it until a table is pushed anew */
        c->state.contact = 0u;
    }
    rest(c, x);
    return -avc_excite_tick(&c->excite, encoder_count);
}

/* What is latched, less what the host has cleared; from there on as after a lost heartbeat: force only after contact. */
static void clear(avc_control_t *c)
{
    c->fault.codes &= ~c->fault.clear_wanted;
    c->fault.clear_wanted = 0u;
    if (c->fault.codes == 0u && c->state.mode == AVC_MODE_FAULT) {
        c->state.mode = AVC_MODE_SAFE;
        c->scale = 0.0f;
    }
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
    const bool free = c->state.has_table == 0u || (c->state.contact == 0u && c->state.position_m <= 0.0f);
    if (c->wanted.force_n > c->lowered.force_n && !free) {
        return;
    }
    c->lowered = c->wanted;
    limit_force(c);
    avc_fault_limit(&c->fault, &c->limits, c->wanted.speed_m_per_s, c->wanted.energy_j);
    c->limits_wanted = 0u;
}

/* What the link asks of a tick, beside its table. */
static void attend(avc_control_t *c, int32_t raw_count)
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
    if (c->pause_wanted != 0u && (c->state.has_table == 0u || (c->state.contact == 0u && c->state.position_m <= 0.0f))) {
        c->paused = 1u;
    }
    if (c->pause_wanted != 0u || c->paused != 0u) {
        c->asked = 1u;
    }
}

/* A tick without force; the last of them leads back as after a lost heartbeat, out of contact. */
static float idle(avc_control_t *c, int32_t encoder_count)
{
    avc_state_t *s = &c->state;
    c->fault.moved = (int32_t)((uint32_t)encoder_count - (uint32_t)s->encoder_count);
    s->encoder_count = encoder_count;
    s->position_m = (float)encoder_count * c->limits.metres_per_count;
    s->force_n = 0.0f;
    c->previous_force = 0.0f;
    rest(c, s->position_m);
    if (c->pause_wanted == 0u) {
        c->paused = 0u;
        if (s->mode == AVC_MODE_TABLE || s->mode == AVC_MODE_RAMP) {
            s->mode = AVC_MODE_SAFE;
        }
        c->scale = 0.0f;
    }
    s->ticks++;
    return 0.0f;
}

float avc_control_tick(avc_control_t *c, int32_t raw_count)
{
    if (c->asked != 0u) {
        attend(c, raw_count);
        if (c->paused != 0u) {
            return idle(c, (int32_t)((uint32_t)raw_count - (uint32_t)c->zero));
        }
    }
    avc_state_t *s = &c->state;
    const int32_t encoder_count = (int32_t)((uint32_t)raw_count - (uint32_t)c->zero);
    int32_t moved = (int32_t)((uint32_t)encoder_count - (uint32_t)s->encoder_count); /* wraps rightly */
    const float x = (float)encoder_count * c->limits.metres_per_count;
    if (c->swap_wanted != 0u) {
        swap(c, x); /* the only place where the table changes */
    }
    int32_t watched = moved;
    if (s->ticks < 2u) {
        watched = 0;
        moved = c->started ? moved : 0;
        c->started = true;
    }
    const avc_table_t *table = &c->tables[c->active];
    const float step = (float)moved * c->limits.metres_per_count;
    s->encoder_count = encoder_count;
    s->position_m = x;
    s->velocity_m_per_s = step * c->rate_hz;
    const float work_j = c->previous_force * step;
    s->energy_j = s->energy_j + work_j;
    const uint32_t wrong = avc_fault_watch(&c->fault, watched, c->previous_force, s->overruns);
    if (!c->steadies && !AVC_IS_BUILT_IN) {
        estimate(c, table, x);
    }
    supervise(c, x);
    if (c->fault.clear_wanted != 0u) {
        clear(c);
    }
    float force = 0.0f;
    if ((wrong | c->fault.codes) != 0u) {
        force = fail(c, wrong, x);
    } else if (c->excite.busy != 0u) {
        force = excite(c, x, encoder_count);
    } else if (s->has_table != 0u) {
        force = push(c, table, x, work_j);
    } else {
        rest(c, x);
    }
    s->force_n = force;
    c->previous_force = force;
    s->ticks++;
    if (c->telemetry.left != 0u) {
        avc_telemetry_tick(c);
    }
    return force;
}
