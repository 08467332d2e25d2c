#include "avc_fault.h"

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

void avc_fault_init(avc_fault_t *fault, const avc_limits_t *limits)
{
    const float time = limits->sample_time_s;
    fault->most_change = counts_of(limits->max_acceleration_m_per_s2 * time * time, limits->metres_per_count);
    fault->most_overruns = limits->max_overruns > 0.0f ? (uint32_t)limits->max_overruns : 0xFFFFFFFFu;
    fault->swing_n = limits->stuck_swing_n;
    fault->slow_ticks = (uint32_t)(slow_s / time);
    fault->keep = 1.0f - time / forget_s;
    avc_fault_limit(fault, limits, limits->max_speed_m_per_s, limits->max_energy_j);
}

void avc_fault_limit(avc_fault_t *fault, const avc_limits_t *limits, float speed_m_per_s, float energy_j)
{
    fault->most_moved = counts_of(speed_m_per_s * limits->sample_time_s, limits->metres_per_count);
    fault->least_j = energy_j > 0.0f ? -energy_j : -3e38f;
}

void avc_fault_raise(avc_fault_t *fault, uint32_t codes, uint32_t tick, float force_n, float sample_time_s)
{
    if (fault->codes == 0u) {
        fault->first = codes;
        fault->first_tick = tick;
        fault->fading_n = force_n;
        fault->fade_n = (force_n < 0.0f ? -force_n : force_n) * sample_time_s / fade_s;
    }
    fault->codes |= codes;
}

float avc_fault_fade(avc_fault_t *fault)
{
    const float left = (fault->fading_n < 0.0f ? -fault->fading_n : fault->fading_n) - fault->fade_n;
    const float size = left > 0.0f ? left : 0.0f;
    fault->fading_n = fault->fading_n < 0.0f ? -size : size;
    return fault->fading_n;
}
