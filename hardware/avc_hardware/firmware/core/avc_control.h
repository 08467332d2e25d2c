/* The control tick: encoder to force, float32 only, the same operations in the same order on every machine.
 *
 * Estimator, adaptation, coupling and guard are generated from the scene's expressions; here are the table between them,
 * the supervision of the host, and the limits. */
#ifndef AVC_CONTROL_H
#define AVC_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "avc_excite.h"
#include "avc_fault.h"
#include "avc_table.h"

typedef enum { AVC_MODE_TABLE = 0, AVC_MODE_RAMP = 1, AVC_MODE_SAFE = 2, AVC_MODE_FAULT = 3 } avc_mode_t;

typedef struct {
    uint32_t number;
    uint32_t ticks; /* how long the gains hold */
    avc_gains_t gains;
} avc_stream_t;

/* What the outside may read of a tick. */
typedef struct {
    uint32_t ticks, overruns, saturated; /* numbers of ticks */
    uint32_t stream_expired, swaps;
    int32_t encoder_count;
    float position_m;
    float velocity_m_per_s;
    float frequency_hz; /* estimate; NaN at rest */
    float lookup_hz;    /* where the table is read: the estimate, held and then falling to the first row's */
    avc_gains_t gains;  /* in force */
    float force_n;
    float energy_j; /* that the hand has given: sum of the held force times the next displacement */
    uint8_t mode, streaming, contact, has_table;
} avc_state_t;

/* Limits at run time, never above those of the board. */
typedef struct {
    float force_n, speed_m_per_s, energy_j;
} avc_lowered_t;

/* What an observer believes. */
typedef struct {
    bool started;
    float measured_m, lag_m; /* position of the tick before, and over the smoothed one */
    float above_m, below_m;  /* highest and lowest late position, over and below the smoothed one */
    float s_m[AVC_STATES_MAX];
} avc_feedback_state_t;

/* Telemetry: records made at the device's own tick, every so many ticks, and pushed to the host that asked for them.
 * A subscription holds for a time and is renewed by the host. What the line is too slow for is a gap in the ticks. */
enum { AVC_SAMPLES_KEPT = 8 }; /* a power of two */

/* As it travels: little-endian, no padding. */
typedef struct {
    uint32_t ticks;
    int32_t encoder_count;
    float velocity_m_per_s, force_n, frequency_hz;
    float damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m;
    float energy_j;
    uint32_t faults;
    uint8_t mode, streaming, contact, has_table;
} avc_sample_t;

typedef struct {
    volatile uint32_t left;  /* ticks that the subscription holds; set by the link, counted down by the tick */
    volatile uint32_t every; /* ticks; 0 before the first subscription */
    volatile uint32_t wait;  /* ticks until the next record */
    volatile uint32_t made;  /* records put into the ring */
    volatile uint32_t sent;  /* of these, taken out again */
    avc_sample_t kept[AVC_SAMPLES_KEPT];
} avc_telemetry_t;

/* What the tick reads every time comes first: near the start a load takes one instruction. */
typedef struct {
    avc_config_t config; /* in force */
    float rate_hz; /* 1/T */
    float scale;   /* of the force: ramps to 0 when the heartbeat is lost */
    float previous_force;
    float most_n;             /* force limit in force: of board, table and run time the lowest */
    volatile uint32_t limits_wanted; /* set by the link, cleared by the tick that takes them */
    avc_state_t state;
    avc_fault_t fault;
    avc_couple_state_t couple;
    avc_guard_state_t guard;
    avc_feedback_state_t feedback;

    volatile uint32_t active;      /* index of the running table */
    volatile uint32_t swap_wanted; /* set by the link, cleared by the tick that swaps, out of contact */
    volatile uint32_t stream_fresh; /* set by the link, cleared by the tick */
    uint32_t stream_left;
    volatile uint32_t heartbeat_wanted; /* ticks to the next at the latest; 0: not supervised */
    volatile uint32_t heartbeat_seen;   /* set by the link after that, cleared by the tick */
    uint32_t heartbeat_ticks;           /* the tick's own, so that no tick sees one without the other */
    uint32_t heartbeat_left;
    bool silent;  /* the host, for longer than it said */
    bool clipped; /* at the tick before, so that the stored energy is not what the force says */
    bool bound;
    bool started;
    uint32_t blind; /* ticks in which no movement is judged yet */
    bool estimates; /* the frequency, as long as gains follow it */
    bool begun;     /* the coupling, since it rested last */

    uint32_t waited;      /* ticks since the tick first saw that a table waits */
    uint32_t away;        /* of these the last ones, out of the new wall */
    uint32_t swap_tick;   /* the tick that took the running table over */
    uint32_t swap_waited; /* ticks that it had waited */
    avc_config_t next; /* of the table that comes */
    avc_stream_t stream[2];
    volatile uint32_t stream_slot;

    avc_lowered_t wanted;
    avc_lowered_t lowered; /* in force */
    avc_telemetry_t telemetry;
    avc_estimate_state_t estimate;
    avc_table_t tables[2];
    avc_excite_t excite;
} avc_control_t;

/* Longest time that streamed gains or a heartbeat may hold, in ticks. */
uint32_t avc_longest_hold(const avc_control_t *control);

void avc_control_init(avc_control_t *control, const avc_config_t *config, bool bound);

/* Other limits are in force: those lowered at run time are gone. */
void avc_control_relimit(avc_control_t *control);

/* Codes of all faults, that of a silent host among them. */
uint32_t avc_faults(const avc_control_t *control);

/* Latch faults that the board knows of, as from a reset. */
void avc_control_fault(avc_control_t *control, uint32_t codes);

/* Whether a force may come, so that the amplifier is to be on. */
bool avc_control_drives(const avc_control_t *control);

/* One tick; returns the force in newtons that the device shall push back with (positive out of the wall). */
float avc_control_tick(avc_control_t *control, int32_t encoder_count);

#endif
