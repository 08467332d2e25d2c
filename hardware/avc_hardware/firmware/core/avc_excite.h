/* Excitation: a signal played at the device's own ticks beside a weak spring and damper that hold it near where it began,
 * within limits that every tick checks; a record of every tick waits for the host.
 *
 * The signal is made of a few numbers by integers alone: the same on every machine, as long as one likes. A force is a whole
 * number of units of max_force_n/32767, so that what is told is what was put out. */
#ifndef AVC_EXCITE_H
#define AVC_EXCITE_H

#include <stdbool.h>
#include <stdint.h>

#include "avc_table.h"

/* What a board with less memory defines otherwise: a power of two. */
#ifndef AVC_CAPACITY_RECORDS
#define AVC_CAPACITY_RECORDS 4096
#endif

enum {
    AVC_TONES_MAX = 64,
    AVC_KNOTS = 33,                        /* of the envelope, evenly spread over the time played */
    AVC_FULL = 32767,                      /* units of the largest force */
    AVC_RECORDS = AVC_CAPACITY_RECORDS,
    AVC_RECORDS_KEPT = AVC_RECORDS - 64,   /* older ones may be overwritten while they are copied */
    AVC_SPEED_WINDOW_MAX = 32
};

_Static_assert(AVC_RECORDS >= 128 && (AVC_RECORDS & (AVC_RECORDS - 1)) == 0, "records: a power of two, 128 or more");

typedef enum {
    AVC_EXCITE_NEVER = 0,
    AVC_EXCITE_RUNS = 1,
    AVC_EXCITE_PLAYED = 2, /* to the end */
    AVC_EXCITE_STOPPED = 3,
    AVC_EXCITE_SILENT = 4, /* the host was not heard in time */
    AVC_EXCITE_TRAVEL = 5, /* a limit was exceeded */
    AVC_EXCITE_SPEED = 6,
    AVC_EXCITE_FAULT = 7 /* of the device */
} avc_excite_end_t;

/* As it travels: little-endian, no padding. */
typedef struct {
    uint32_t step;    /* of the phase, a tick, in turns of 2^32 */
    uint16_t phase;   /* at the beginning, in turns of 2^16 */
    int16_t amplitude; /* units */
} avc_tone_t;

typedef struct {
    uint32_t number; /* not 0; names the excitation */
    uint32_t ticks;
    uint32_t ramp_ticks;   /* in and out */
    uint32_t silent_ticks; /* without a word from the host: stop */
    uint32_t growth;       /* of every step, a tick, in 2^-32 */
    float max_force_n, max_speed_m_per_s, max_travel_m; /* from where it began */
    float spring_n_per_m, damper_ns_per_m;
    uint16_t window; /* ticks over which a velocity is taken */
    uint16_t none, tones, none_either; /* none: always 0 */
    uint16_t knot[AVC_KNOTS]; /* envelope of the signal, of 2^15 */
    uint16_t also_none;
    avc_tone_t tone[AVC_TONES_MAX];
} avc_plan_t;

enum { AVC_PLAN_HEAD = 48 + 2 * (AVC_KNOTS + 1) };

typedef struct {
    avc_plan_t plan; /* changes while nothing runs */
    volatile uint32_t busy; /* set by the link, cleared by the tick that ends it */
    volatile uint32_t stop_wanted;
    volatile uint32_t heard;
    volatile uint32_t state;
    volatile uint32_t made; /* records */
    uint32_t start_tick;
    uint32_t left; /* ticks until the host counts as silent */
    int32_t centre, last;
    uint32_t most_moved, most_at_once, most_away; /* counts in a window, in a tick, from the centre */
    float unit_n;
    float spring_units, damper_units; /* a count; a count moved in a window */
    uint32_t envelope_at, envelope_step;
    uint64_t step[AVC_TONES_MAX]; /* 32 bits after the point */
    uint32_t phase[AVC_TONES_MAX];
    int32_t passed[AVC_SPEED_WINDOW_MAX];
    int32_t count[AVC_RECORDS];
    int16_t force[AVC_RECORDS];
} avc_excite_t;

/* From the first tick of an excitation. */
void avc_excite_start(avc_excite_t *excite, const avc_limits_t *limits, int32_t encoder_count, uint32_t tick);

/* One tick of a running excitation; returns the force along +position. */
float avc_excite_tick(avc_excite_t *excite, int32_t encoder_count);

#endif
