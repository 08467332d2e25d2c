/* Telemetry: records made at the device's own tick, every so many ticks, and pushed to the host that asked for them.
 *
 * A subscription holds for a time and is renewed by the host. What the line is too slow for is dropped and counted. */
#ifndef AVC_TELEMETRY_H
#define AVC_TELEMETRY_H

#include <stdint.h>

enum { AVC_SAMPLES_KEPT = 8 }; /* a power of two */

/* As it travels: little-endian, no padding. */
typedef struct {
    uint32_t ticks;
    int32_t encoder_count;
    float velocity_m_per_s;
    float force_n;
    float frequency_hz;
    float damping_ns_per_m;
    float stiffness_n_per_m;
    float contact_damping_ns_per_m;
    float energy_j;
    uint32_t faults;
    uint8_t mode;
    uint8_t streaming;
    uint8_t contact;
    uint8_t has_table;
} avc_sample_t;

typedef struct {
    volatile uint32_t left;  /* ticks that the subscription holds; set by the link, counted down by the tick */
    volatile uint32_t every; /* ticks; 0 before the first subscription */
    volatile uint32_t wait;  /* ticks until the next record */
    volatile uint32_t made;  /* records put into the ring */
    volatile uint32_t sent;  /* of these, taken out again */
    volatile uint32_t dropped;
    uint32_t number; /* of the next message */
    avc_sample_t kept[AVC_SAMPLES_KEPT];
} avc_telemetry_t;

#endif
