#include <stdatomic.h>

#include "avc_link.h"

static const uint32_t most_counts = 0x3FFFFFFFu;

/* Odd polynomial of a quarter turn, 30 bits after the point; within 1e-6 of the sine. */
static int32_t sine(uint32_t phase)
{
    static const int64_t c[4] = {1686624950, 693528462, 85303417, 4658781};
    const uint32_t quarter = 0x40000000u;
    const uint32_t within = phase & (quarter - 1u);
    const int64_t x = (phase & quarter) != 0u ? quarter - within : within;
    const int64_t square = x * x >> 30;
    const int64_t inner = c[1] - (square * (c[2] - (square * c[3] >> 30)) >> 30);
    const int64_t value = x * (c[0] - (square * inner >> 30)) >> 30;
    const int32_t rounded = (int32_t)((value * AVC_FULL + (quarter >> 1)) >> 30);
    return (phase & 0x80000000u) != 0u ? -rounded : rounded;
}

static bool allowed(float x, float most)
{
    return avc_is_finite(x) && x > 0.0f && x <= most;
}

/* N, or N.m: of a smaller limit no unit of force is left in single precision. */
static const float least_force_n = 1e-6f;

static avc_reason_t plan_check(const avc_plan_t *plan, const avc_limits_t *limits)
{
    const float numbers[] = {plan->max_force_n,    plan->max_speed_m_per_s, plan->max_travel_m,
                             plan->spring_n_per_m, plan->damper_ns_per_m};
    for (uint32_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        if (!avc_is_finite(numbers[i])) {
            return AVC_REFUSED_NOT_FINITE;
        }
    }
    bool good = allowed(plan->max_force_n, limits->max_force_n) && plan->max_force_n >= least_force_n &&
                allowed(plan->max_speed_m_per_s, 10.0f) && allowed(plan->max_travel_m, 10.0f) &&
                plan->spring_n_per_m >= 0.0f && plan->damper_ns_per_m >= 0.0f &&
                plan->spring_n_per_m <= limits->max_stiffness_n_per_m &&
                plan->damper_ns_per_m <= limits->max_damping_ns_per_m;
    good = good && plan->number != 0u && plan->ramp_ticks >= 1u && plan->ramp_ticks <= 0xFFFFu &&
           plan->ticks >= 2u * plan->ramp_ticks && plan->ticks <= 0x7FFFFFFFu;
    const float silence_s = (float)plan->silent_ticks * limits->sample_time_s;
    good = good && plan->silent_ticks >= 1u && silence_s <= 2.0f;
    good = good && plan->window >= 1u && plan->window <= AVC_SPEED_WINDOW_MAX;
    good = good && plan->tones >= 1u && plan->tones <= AVC_TONES_MAX;
    for (uint32_t i = 0; i < AVC_KNOTS; i++) {
        good = good && plan->knot[i] <= 0x8000u;
    }
    return good ? AVC_OK : AVC_REFUSED_LIMIT;
}

static uint32_t counts_of(float counts)
{
    return counts < (float)most_counts ? (uint32_t)counts : most_counts;
}

void avc_excite_start(avc_excite_t *e, const avc_limits_t *limits, int32_t encoder_count, uint32_t tick)
{
    atomic_signal_fence(memory_order_acquire);
    const avc_plan_t *plan = &e->plan;
    const float window_s = (float)plan->window * limits->sample_time_s;
    const float a_count = limits->metres_per_count;
    e->most_away = counts_of(plan->max_travel_m / a_count);
    e->most_moved = counts_of(plan->max_speed_m_per_s * window_s / a_count);
    e->most_at_once = counts_of(plan->max_speed_m_per_s * limits->sample_time_s / a_count) + 1u; /* an encoder steps early */
    e->unit_n = plan->max_force_n / (float)AVC_FULL;
    e->spring_units = plan->spring_n_per_m * a_count / e->unit_n;
    e->damper_units = plan->damper_ns_per_m * a_count / window_s / e->unit_n;
    e->envelope_at = 0u;
    e->envelope_step = 0xFFFFFFFFu / plan->ticks;
    for (uint32_t i = 0; i < plan->tones; i++) {
        e->step[i] = (uint64_t)plan->tone[i].step << 32;
        e->phase[i] = (uint32_t)plan->tone[i].phase << 16;
    }
    for (uint32_t i = 0; i < AVC_SPEED_WINDOW_MAX; i++) {
        e->passed[i] = 0;
    }
    e->centre = encoder_count;
    e->last = 0;
    e->left = plan->silent_ticks;
    e->start_tick = tick;
    e->made = 0u;
    e->state = AVC_EXCITE_RUNS;
}

/* Why to stop at this tick; AVC_EXCITE_RUNS to go on. */
static avc_excite_end_t judge(avc_excite_t *e, int32_t away, int32_t moved)
{
    if (e->heard != 0u) {
        e->heard = 0u;
        e->left = e->plan.silent_ticks;
    }
    if (e->stop_wanted != 0u) {
        return AVC_EXCITE_STOPPED;
    }
    if (avc_fault_beyond(away, e->most_away)) {
        return AVC_EXCITE_TRAVEL;
    }
    if (avc_fault_beyond(moved, e->most_moved) || avc_fault_beyond(away - e->last, e->most_at_once)) {
        return AVC_EXCITE_SPEED;
    }
    if (e->left == 0u) {
        return AVC_EXCITE_SILENT;
    }
    e->left--;
    return e->made == e->plan.ticks ? AVC_EXCITE_PLAYED : AVC_EXCITE_RUNS;
}

/* The signal at this tick, units, under its envelope; the oscillators go on to the next. */
static int32_t signal(avc_excite_t *e)
{
    const avc_plan_t *plan = &e->plan;
    int64_t sum = 0;
    for (uint32_t i = 0; i < plan->tones; i++) {
        const uint32_t step = (uint32_t)(e->step[i] >> 32);
        sum += plan->tone[i].amplitude * sine(e->phase[i]);
        e->phase[i] += step;
        e->step[i] += (uint64_t)step * plan->growth;
    }
    const uint32_t at = e->envelope_at >> 27;
    const int32_t share = (int32_t)(e->envelope_at >> 12 & 0x7FFFu);
    const int32_t low = plan->knot[at];
    const int32_t high = plan->knot[at + 1u];
    e->envelope_at += e->envelope_step;
    const int64_t envelope = low + (high - low) * share / 0x8000;
    return (int32_t)(sum / AVC_FULL * envelope / 0x8000);
}

static int32_t units_of(float units)
{
    const float full = (float)AVC_FULL;
    const float limited = units > full ? full : units < -full ? -full : units;
    return (int32_t)(limited < 0.0f ? limited - 0.5f : limited + 0.5f);
}

static int32_t force_units(avc_excite_t *e, int32_t away, int32_t moved)
{
    const avc_plan_t *plan = &e->plan;
    const float hold = e->spring_units * (float)away + e->damper_units * (float)moved;
    const uint32_t gone = e->made + 1u;
    const uint32_t left = plan->ticks - e->made;
    const uint32_t near = gone < left ? gone : left;
    const uint32_t ramp = near < plan->ramp_ticks ? (near << 15) / plan->ramp_ticks : 0x8000u;
    const int32_t made = signal(e);
    const int64_t whole = (int64_t)(made - units_of(hold)) * (int64_t)ramp / 0x8000;
    return (int32_t)(whole > AVC_FULL ? AVC_FULL : whole < -AVC_FULL ? -AVC_FULL : whole);
}

float avc_excite_tick(avc_excite_t *e, int32_t encoder_count)
{
    const int32_t away = (int32_t)((uint32_t)encoder_count - (uint32_t)e->centre);
    const uint32_t slot = e->made % e->plan.window;
    const int32_t moved = (int32_t)((uint32_t)away - (uint32_t)e->passed[slot]);
    const avc_excite_end_t end = judge(e, away, moved);
    const int32_t units = end == AVC_EXCITE_RUNS ? force_units(e, away, moved) : 0;
    e->passed[slot] = away;
    e->last = away;
    const uint32_t at = e->made % AVC_RECORDS;
    e->count[at] = encoder_count;
    e->force[at] = (int16_t)units;
    atomic_signal_fence(memory_order_release);
    e->made++;
    e->state = (uint32_t)end;
    e->busy = end == AVC_EXCITE_RUNS ? 1u : 0u;
    return (float)units * e->unit_n;
}

/* The messages of an excitation. */

static avc_verdict_t tell(avc_device_t *device, const avc_request_t *request)
{
    const avc_excite_t *e = &device->control.excite;
    return avc_acknowledge(device, request, e->plan.number, e->busy != 0u ? (uint32_t)AVC_EXCITE_RUNS : e->state);
}

avc_verdict_t avc_on_excite(avc_device_t *device, const avc_request_t *request)
{
    avc_excite_t *e = &device->control.excite;
    const uint32_t number = request->word[0];
    if (number == e->plan.number && number != 0u) { /* its answer was lost; it is not played again */
        return tell(device, request);
    }
    if (e->busy != 0u) {
        return avc_no(AVC_REFUSED_EXCITED, e->plan.number);
    }
    if (device->control.fault.codes != 0u) {
        return avc_no(AVC_REFUSED_FAULT, device->control.fault.codes);
    }
    if (device->transfer.committing) {
        return avc_no(AVC_REFUSED_BUSY, device->transfer.session);
    }
    avc_plan_t plan;
    memset(&plan, 0, sizeof plan);
    memcpy(&plan, request->payload, request->size);
    avc_reason_t reason = plan_check(&plan, &device->control.config.limits);
    const avc_control_t *c = &device->control;
    const bool lowers = c->limits_wanted != 0u && c->wanted.force_n < c->lowered.force_n; /* from the next tick on */
    if (reason == AVC_OK && plan.max_force_n > (lowers ? c->wanted.force_n : c->lowered.force_n)) {
        reason = AVC_REFUSED_LIMIT;
    }
    if (reason != AVC_OK) {
        return avc_no(reason, AVC_AT_EXCITATION);
    }
    if (request->size != AVC_PLAN_HEAD + plan.tones * sizeof(avc_tone_t)) {
        return avc_no(AVC_REFUSED_SIZE, (uint32_t)request->size);
    }
    e->plan = plan;
    e->stop_wanted = 0u;
    e->heard = 0u;
    e->made = 0u;
    e->state = AVC_EXCITE_NEVER;
    atomic_signal_fence(memory_order_release);
    e->busy = 1u;
    return tell(device, request);
}

static avc_verdict_t is_of(const avc_excite_t *e, const avc_request_t *request)
{
    const bool its = e->plan.number != 0u && request->word[0] == e->plan.number;
    return avc_no(its ? AVC_OK : AVC_REFUSED_NO_EXCITATION, e->plan.number);
}

/* Records from an index on, the oldest that is kept where that one is gone. */
avc_verdict_t avc_on_records(avc_device_t *device, const avc_request_t *request)
{
    avc_excite_t *e = &device->control.excite;
    const avc_verdict_t its = is_of(e, request);
    if (its.reason != AVC_OK) {
        return its;
    }
    e->heard = 1u;
    const uint32_t state = e->busy != 0u ? (uint32_t)AVC_EXCITE_RUNS : e->state;
    atomic_signal_fence(memory_order_acquire); /* the end is told with the last record or after it */
    const uint32_t made = e->made;
    const uint32_t oldest = made > AVC_RECORDS_KEPT ? made - AVC_RECORDS_KEPT : 0u;
    uint32_t first = request->word[1];
    first = first > made ? made : first < oldest ? oldest : first;
    uint32_t past = first;
    int32_t before = first < made ? e->count[first % AVC_RECORDS] : 0;
    avc_answer_t a = avc_answer(device, AVC_MESSAGE_RECORDS | AVC_MESSAGE_REPLY, request->sequence);
    const uint32_t head[6] = {e->plan.number, state, e->start_tick, made, first, (uint32_t)before};
    avc_put(&a, head, sizeof head);
    while (past < made && past - first < (AVC_PAYLOAD_MAX - sizeof head) / 4u) {
        const int32_t count = e->count[past % AVC_RECORDS];
        const int32_t step = (int32_t)((uint32_t)count - (uint32_t)before);
        if (step > INT16_MAX || step < INT16_MIN) {
            break; /* the next answer begins with it */
        }
        const int16_t record[2] = {(int16_t)step, e->force[past % AVC_RECORDS]};
        avc_put(&a, record, sizeof record);
        before = count;
        past++;
    }
    avc_send(&a);
    return avc_no(AVC_OK, 0u);
}

avc_verdict_t avc_on_stop(avc_device_t *device, const avc_request_t *request)
{
    const avc_verdict_t its = is_of(&device->control.excite, request);
    if (its.reason != AVC_OK) {
        return its;
    }
    device->control.excite.stop_wanted = 1u;
    return tell(device, request);
}
