/* Configuration: what a board is told, with a table or alone; one struct with a checksum, as it travels and is read back. */
#ifndef AVC_CONFIG_H
#define AVC_CONFIG_H

#include <stdbool.h>
#include <stdint.h>

#include "avc_tick.h"

typedef struct {
    float sample_time_s;
    float metres_per_count;
    float max_force_n; /* full scale of the output */
    float max_damping_ns_per_m;
    float max_stiffness_n_per_m;
    float max_contact_damping_ns_per_m;
    /* Beyond these a fault is latched; 0: not watched. */
    float max_speed_m_per_s;
    float max_acceleration_m_per_s2;
    float max_energy_j;  /* that a coupling may give out, a second, without having got it */
    float stuck_swing_n; /* of a force under which an encoder moves */
    float max_overruns;  /* in a row */
} avc_limits_t;

typedef struct {
    float hold_s;                 /* how long a lost estimate is kept */
    float slew_per_s;             /* largest relative change of a gain, a second */
    float guard_damping_ns_per_m; /* most that the guard adds */
    float hand_m_per_unit;        /* how far the hand moves for a unit of the position: 1, or a handle's radius */
    uint16_t estimator;           /* 0 zero-crossing, 1 spectral-peak, 2 adaptive-notch, 3 fused */
    uint16_t passive;             /* 1: gains change without creating energy */
} avc_figures_t;

/* Little-endian, no padding. The numbers are what the expressions of the tick make of the figures. */
typedef struct {
    uint32_t crc32; /* of all that follows */
    avc_limits_t limits;
    avc_figures_t figures;
    float number[AVC_NUMBERS];
} avc_config_t;

/* In a source of its own, which a build makes. A bound board keeps its limits and its handle, whatever is sent. */
extern const avc_config_t avc_built_in;
extern const bool avc_bound;

#endif
