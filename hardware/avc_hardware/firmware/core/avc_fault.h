/* Faults: what must not go on. Each is latched until the host clears it; the force falls to 0 by a ramp and stays there. */
#ifndef AVC_FAULT_H
#define AVC_FAULT_H

#include <stdbool.h>
#include <stdint.h>

#include "avc_table.h"

typedef enum {
    AVC_FAULT_JUMP = 1,         /* the encoder moved as nothing of this mass can */
    AVC_FAULT_STUCK = 2,        /* it does not move while the force swings */
    AVC_FAULT_SPEED = 4,
    AVC_FAULT_ENERGY = 8,       /* the coupling gives out energy that nobody gave it */
    AVC_FAULT_NOT_FINITE = 16,  /* a force that is not a number */
    AVC_FAULT_OVERRUN = 32,     /* ticks in a row took longer than a sample time */
    AVC_FAULT_DISABLED = 64,    /* the enable line is open */
    AVC_FAULT_WATCHDOG = 128,   /* the last start was a reset by the watchdog */
    AVC_FAULT_BROWN_OUT = 256,  /* or by a supply that sank */
    AVC_FAULT_HEARTBEAT = 512   /* the host is silent; alone not latched: told in ramp and safe */
} avc_fault_code_t;

typedef struct {
    uint32_t codes; /* latched */
    uint32_t first; /* of them the first ones */
    uint32_t first_tick;
    volatile uint32_t clear_wanted; /* codes; set by the link, cleared by the tick */
    volatile uint32_t disabled;     /* set by the board before each tick: AVC_FAULT_DISABLED, or 0 */
    uint32_t most_change; /* counts by which a tick's movement may differ from that of the tick before */
    uint32_t most_moved;  /* counts in a tick */
    int32_t moved;
    uint32_t overruns, overruns_in_a_row, most_overruns;
    float swing_n; /* how far a force swings to count; 0: not watched */
    float extreme_n;
    uint32_t swings;
    uint32_t swing_ticks; /* since the last turn */
    uint32_t slow_ticks;  /* a swing that lasts so long moves a device by many counts */
    bool rising;
    bool settled; /* a stored energy of the tick before is known */
    float stored_j;
    float keep;      /* share of what is lacking that a tick leaves */
    float least_j;
    float lacking_j; /* energy given out and never taken in, forgotten within a second; never above 0 */
    float fading_n, fade_n; /* what is left of the force, and what it loses in a tick */
} avc_fault_t;

void avc_fault_init(avc_fault_t *fault, const avc_limits_t *limits);

/* What follows runs in every tick, and is compiled into it. */

/* Swings of the force without a single count: two may be a force that settles after a blow. */
enum { AVC_FAULT_SWINGS = 4 };

static inline bool avc_fault_beyond(int32_t counts, uint32_t most)
{
    return (uint32_t)counts + most > 2u * most; /* on either side */
}

/* Slow turns of the force by more than a swing since the last count. */
static inline bool avc_fault_stuck(avc_fault_t *fault, int32_t moved, float force_n)
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
    return fault->swings >= AVC_FAULT_SWINGS;
}

/* What is wrong with a tick before its force is computed: codes. moved: counts since the last one; force_n: held since then. */
static inline uint32_t avc_fault_watch(avc_fault_t *fault, int32_t moved, float force_n, uint32_t overruns)
{
    uint32_t codes = fault->disabled;
    const int32_t change = (int32_t)((uint32_t)moved - (uint32_t)fault->moved);
    fault->moved = moved;
    if (avc_fault_beyond(change, fault->most_change)) {
        codes |= AVC_FAULT_JUMP;
    }
    if (avc_fault_beyond(moved, fault->most_moved)) {
        codes |= AVC_FAULT_SPEED;
    }
    if ((int32_t)avc_bits(fault->swing_n) > 0 && avc_fault_stuck(fault, moved, force_n)) {
        codes |= AVC_FAULT_STUCK;
    }
    if (overruns == fault->overruns) {
        fault->overruns_in_a_row = 0u;
    } else {
        fault->overruns = overruns;
        fault->overruns_in_a_row++;
        if (fault->overruns_in_a_row >= fault->most_overruns) {
            codes |= AVC_FAULT_OVERRUN;
        }
    }
    return codes;
}

/* Whether the coupling has given out too much: work_j taken in since the last tick, stored_j held now. */
static inline bool avc_fault_energy(avc_fault_t *fault, float work_j, float stored_j)
{
    const float gained = stored_j - fault->stored_j;
    fault->stored_j = stored_j;
    if (fault->settled) {
        const float lacking = fault->lacking_j * fault->keep + (work_j - gained);
        fault->lacking_j = lacking < 0.0f ? lacking : 0.0f;
    } else {
        fault->settled = true;
    }
    return fault->lacking_j < fault->least_j;
}

#endif
