/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
/* sample_time_s 0.001, metres_per_count 2e-06, estimator any, hold_s 0.2, slew_per_s 20.0, passive True, guard_damping_ns_per_m 2.0 */
#ifndef AVC_GUARD_H
#define AVC_GUARD_H

typedef struct {
    float held_force_n;
    float guard_started;
    float guard_position_m;
    float guard_stored_j;
    float guard_reserve_j;
} avc_guard_state_t;

typedef struct {
    float position_m;
    float force_n;
    float stored_j;
} avc_guard_in_t;

typedef struct {
    float guarded_n;
    float reserve_j;
} avc_guard_out_t;

/* The state of a device that has always rested at a position. */
void avc_guard_start(avc_guard_state_t *state, float position_m);

/* One tick. */
void avc_guard_step(avc_guard_state_t *state, const avc_guard_in_t *in, avc_guard_out_t *out);

#endif
