/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
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

/* What depends on sample time, encoder and settings. */
extern const float avc_guard_constants[1];

/* The state of a device that has always rested at a position. */
void avc_guard_start(avc_guard_state_t *state, float position_m);

/* One tick. */
void avc_guard_step(avc_guard_state_t *state, const avc_guard_in_t *in, avc_guard_out_t *out);

#endif
