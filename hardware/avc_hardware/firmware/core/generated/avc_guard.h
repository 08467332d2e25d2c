/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_GUARD_H
#define AVC_GUARD_H

#include <stdbool.h>

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
static inline void avc_guard_start(avc_guard_state_t *state, float position_m)
{
    state->held_force_n = 0.0f;
    state->guard_started = 0.0f;
    state->guard_position_m = 0.0f;
    state->guard_stored_j = 0.0f;
    state->guard_reserve_j = 0.0f;
    (void)position_m;
}

/* What depends on sample time, encoder and settings. */
extern const float avc_guard_constants[1];

/* The first tick. */
static inline void avc_guard_first(avc_guard_state_t *state, const avc_guard_in_t *in, avc_guard_out_t *out)
{
    const float v13 = 0.0f - 0.0f;
    const float v14 = state->guard_reserve_j + v13;
    const float v16 = v14 < 0.0f ? v14 : 0.0f;
    const float v18 = v16 > (-0.01f) ? v16 : (-0.01f);
    const float v37 = in->force_n + 0.0f;
    const float r4 = in->position_m;
    const float r5 = in->stored_j;
    out->guarded_n = v37;
    out->reserve_j = v18;
    state->held_force_n = v37;
    state->guard_started = 1.0f;
    state->guard_position_m = r4;
    state->guard_stored_j = r5;
    state->guard_reserve_j = v18;
}

/* A tick after the first. */
static inline void avc_guard_later(avc_guard_state_t *state, const avc_guard_in_t *in, avc_guard_out_t *out)
{
    const float v6 = in->position_m - state->guard_position_m;
    const float v7 = state->held_force_n * v6;
    const float v11 = in->stored_j - state->guard_stored_j;
    const float v13 = v7 - v11;
    const float v14 = state->guard_reserve_j + v13;
    const float v16 = v14 < 0.0f ? v14 : 0.0f;
    const float v18 = v16 > (-0.01f) ? v16 : (-0.01f);
    const bool v19 = v18 < 0.0f;
    const float v20 = v6 * v6;
    const bool v23 = 0.0f < v20;
    const bool v24 = v19 && v23;
    const float v29 = v24 ? v20 : 1.0f;
    const float v30 = v18 / v29;
    const float v31 = -v30;
    const float v33 = v31 < avc_guard_constants[0] ? v31 : avc_guard_constants[0];
    const float v34 = v33 * v6;
    const float v35 = v24 ? v34 : 0.0f;
    const float v37 = in->force_n + v35;
    const float r4 = in->position_m;
    const float r5 = in->stored_j;
    out->guarded_n = v37;
    out->reserve_j = v18;
    state->held_force_n = v37;
    state->guard_position_m = r4;
    state->guard_stored_j = r5;
    state->guard_reserve_j = v18;
}

/* One tick. */
static inline void avc_guard_step(avc_guard_state_t *state, const avc_guard_in_t *in, avc_guard_out_t *out)
{
    if (state->guard_started != 0.0f) {
        avc_guard_later(state, in, out);
    } else {
        avc_guard_first(state, in, out);
    }
}

#endif
