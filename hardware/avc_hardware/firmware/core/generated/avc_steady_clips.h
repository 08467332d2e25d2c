/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_STEADY_CLIPS_H
#define AVC_STEADY_CLIPS_H

#include "avc_couple.h"

/* What gains and wall come to, computed once. */
typedef struct {
    float v1;
    float v11;
    float v14;
    float v15;
    float v20;
    float v26;
    float v38;
    float v42;
} avc_steady_clips_t;

typedef struct {
    float wanted_damping_ns_per_m;
    float wanted_stiffness_n_per_m;
    float wanted_contact_damping_ns_per_m;
    float wall_stiffness_n_per_m;
    float wall_damping_ns_per_m;
} avc_steady_clips_in_t;

typedef struct {
    float force_n;
    float tool_m;
    float stored_j;
} avc_steady_clips_out_t;

/* What depends on sample time, encoder and settings. */
extern const float avc_steady_clips_constants[1];

static inline void avc_steady_clips_settle(avc_steady_clips_t *steady, const avc_steady_clips_in_t *in)
{
    const float v3 = avc_steady_clips_constants[0] * in->wanted_damping_ns_per_m;
    const float v4 = in->wanted_stiffness_n_per_m + v3;
    const float v7 = avc_steady_clips_constants[0] * in->wall_damping_ns_per_m;
    const float v8 = in->wall_stiffness_n_per_m + v7;
    const float v9 = v4 + v8;
    const float v10 = v8 / v9;
    const float v11 = v4 * v10;
    const float v14 = v4 + 1.0e-20f;
    const float v15 = in->wanted_damping_ns_per_m / v14;
    const float v20 = in->wall_damping_ns_per_m / v8;
    const float v38 = 0.5f * in->wall_stiffness_n_per_m;
    const float v42 = 0.5f * in->wanted_stiffness_n_per_m;
    steady->v1 = avc_steady_clips_constants[0];
    steady->v11 = v11;
    steady->v14 = v14;
    steady->v15 = v15;
    steady->v20 = v20;
    steady->v26 = in->wanted_contact_damping_ns_per_m;
    steady->v38 = v38;
    steady->v42 = v42;
}

/* One tick; of the coupling's states only those that gains which stay have. */
static inline void avc_steady_clips_step(avc_couple_state_t *state, const avc_steady_clips_t *steady, float position_m,
                                avc_steady_clips_out_t *out)
{
    const float v17 = steady->v1 * state->coupling_deflection_before_m;
    const float v18 = steady->v15 * v17;
    const float v19 = position_m - v18;
    const float v22 = steady->v1 * state->environment_deflection_before_m;
    const float v23 = steady->v20 * v22;
    const float v24 = v19 - v23;
    const float v25 = steady->v11 * v24;
    const float v27 = steady->v1 * position_m;
    const float v29 = steady->v1 * state->contact_position_before_m;
    const float v30 = v27 - v29;
    const float v31 = steady->v26 * v30;
    const float v32 = v25 + v31;
    const float v34 = v32 > 0.0f ? v32 : 0.0f;
    const float v35 = v25 / steady->v14;
    const float v36 = v19 - v35;
    const float v39 = v36 > 0.0f ? v36 : 0.0f;
    const float v40 = steady->v38 * v39;
    const float v41 = v40 * v39;
    const float v43 = position_m - v36;
    const float v44 = v43 > 0.0f ? v43 : 0.0f;
    const float v45 = steady->v42 * v44;
    const float v46 = v45 * v44;
    const float v47 = v41 + v46;
    out->force_n = v34;
    out->tool_m = v36;
    out->stored_j = v47;
    state->environment_deflection_before_m = v36;
    state->coupling_deflection_before_m = v43;
    state->contact_position_before_m = position_m;
}

#endif
