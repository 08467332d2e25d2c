#include "avc_fault.h"

static const float fade_s = 0.02f;
static const float forget_s = 1.0f;
static const float slow_s = 0.02f;
/* Swings of the force without a single count: two may be a force that settles after a blow. */
static const uint32_t most_swings = 4u;
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
    fault->most_moved = counts_of(limits->max_speed_m_per_s * time, limits->metres_per_count);
    fault->most_overruns = limits->max_overruns > 0.0f ? (uint32_t)limits->max_overruns : 0xFFFFFFFFu;
    fault->swing_n = limits->stuck_swing_n;
    fault->slow_ticks = (uint32_t)(slow_s / time);
    fault->keep = 1.0f - time / forget_s;
    fault->least_j = limits->max_energy_j > 0.0f ? -limits->max_energy_j : -3e38f;
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

static bool beyond(int32_t counts, uint32_t most)
{
    return (uint32_t)counts + most > 2u * most; /* on either side */
}

/* Slow turns of the force by more than a swing since the last count. */
static bool stuck(avc_fault_t *fault, int32_t moved, float force_n)
{
    if (moved != 0) {
        fault->swings = 0u;
        fault->extreme_n = force_n;
        return false;
    }
    const float away = fault->rising ? fault->extreme_n - force_n : force_n - fault->extreme_n;
    fault->swing_ticks++;
    if (away > fault->swing_n) {
        fault->rising = !fault->rising;
        fault->swings = fault->swing_ticks >= fault->slow_ticks ? fault->swings + 1u : 0u;
        fault->swing_ticks = 0u;
    }
    if (away > fault->swing_n || away < 0.0f) {
        fault->extreme_n = force_n;
    }
    return fault->swings >= most_swings;
}

uint32_t avc_fault_watch(avc_fault_t *fault, int32_t moved, float force_n, uint32_t overruns)
{
    uint32_t codes = fault->disabled != 0u ? (uint32_t)AVC_FAULT_DISABLED : 0u;
    const int32_t change = (int32_t)((uint32_t)moved - (uint32_t)fault->moved);
    fault->moved = moved;
    if (beyond(change, fault->most_change)) {
        codes |= AVC_FAULT_JUMP;
    }
    if (beyond(moved, fault->most_moved)) {
        codes |= AVC_FAULT_SPEED;
    }
    if (fault->swing_n > 0.0f && stuck(fault, moved, force_n)) {
        codes |= AVC_FAULT_STUCK;
    }
    fault->overruns_in_a_row = overruns != fault->overruns ? fault->overruns_in_a_row + 1u : 0u;
    fault->overruns = overruns;
    if (fault->overruns_in_a_row >= fault->most_overruns) {
        codes |= AVC_FAULT_OVERRUN;
    }
    return codes;
}

bool avc_fault_energy(avc_fault_t *fault, float work_j, float stored_j)
{
    const float gained = stored_j - fault->stored_j;
    fault->stored_j = stored_j;
    if (fault->settled) {
        const float lacking = fault->lacking_j * fault->keep + (work_j - gained);
        fault->lacking_j = lacking < 0.0f ? lacking : 0.0f;
    }
    fault->settled = true;
    return fault->lacking_j < fault->least_j;
}

float avc_fault_fade(avc_fault_t *fault)
{
    const float left = (fault->fading_n < 0.0f ? -fault->fading_n : fault->fading_n) - fault->fade_n;
    const float size = left > 0.0f ? left : 0.0f;
    fault->fading_n = fault->fading_n < 0.0f ? -size : size;
    return fault->fading_n;
}
