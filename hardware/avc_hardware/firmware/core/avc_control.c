#include "avc_control.h"

#include <string.h>

#include "avc_law.h"

static const float longest_hold_s = 5.0f;

static float not_a_number(void)
{
    const uint32_t bits = 0x7FC00000u;
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

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
    control->state.frequency_hz = not_a_number();
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

/* How often the hand moves, as long as gains follow it. */
static void estimate(avc_control_t *c, const avc_table_t *table, float x)
{
    avc_state_t *s = &c->state;
    const float lowest_hz = s->has_table != 0u ? table->image.row[0].frequency_hz : 1.0f;
    if (s->has_table != 0u && !avc_varies(table) && c->stream_left == 0u) {
        c->estimates = false;
        s->frequency_hz = not_a_number();
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
    s->frequency_hz = avc_bits(found.valid) != 0u ? found.estimate_hz : not_a_number();
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
    avc_supervise(c, x);
    float force = 0.0f;
    if ((wrong | c->fault.codes) != 0u) {
        force = avc_fail(c, wrong, x);
    } else if (c->excite.busy != 0u) {
        force = excite(c, x, encoder_count);
    } else if (s->has_table != 0u) {
        force = avc_law(c, table, x, work_j);
    } else {
        avc_rest(c, x);
    }
    s->force_n = force;
    c->previous_force = force;
    s->ticks++;
    if (c->telemetry.left != 0u) {
        avc_telemetry_tick(c);
    }
    return force;
}
