/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_STEADY_GATED_H
#define AVC_STEADY_GATED_H

#include <stdbool.h>

#include "avc_couple.h"

/* What gains and wall come to, computed once. */
typedef struct {
    float v4;
    float v14;
    float v16;
    float v17;
    float v22;
    float v29;
    float v41;
    float v45;
} avc_steady_gated_t;

typedef struct {
    float wanted_damping_ns_per_m;
    float wanted_stiffness_n_per_m;
    float wanted_contact_damping_ns_per_m;
    float wall_stiffness_n_per_m;
    float wall_damping_ns_per_m;
} avc_steady_gated_in_t;

typedef struct {
    float force_n;
    float tool_m;
    float stored_j;
} avc_steady_gated_out_t;

/* What depends on sample time, encoder and settings. */
extern const float avc_steady_gated_constants[1];

static inline void avc_steady_gated_settle(avc_steady_gated_t *steady, const avc_steady_gated_in_t *in)
{
    const float v6 = avc_steady_gated_constants[0] * in->wanted_damping_ns_per_m;
    const float v7 = in->wanted_stiffness_n_per_m + v6;
    const float v10 = avc_steady_gated_constants[0] * in->wall_damping_ns_per_m;
    const float v11 = in->wall_stiffness_n_per_m + v10;
    const float v12 = v7 + v11;
    const float v13 = v11 / v12;
    const float v14 = v7 * v13;
    const float v16 = v7 + 1.0e-20f;
    const float v17 = in->wanted_damping_ns_per_m / v16;
    const float v22 = in->wall_damping_ns_per_m / v11;
    const float v41 = 0.5f * in->wall_stiffness_n_per_m;
    const float v45 = 0.5f * in->wanted_stiffness_n_per_m;
    steady->v4 = avc_steady_gated_constants[0];
    steady->v14 = v14;
    steady->v16 = v16;
    steady->v17 = v17;
    steady->v22 = v22;
    steady->v29 = in->wanted_contact_damping_ns_per_m;
    steady->v41 = v41;
    steady->v45 = v45;
}

/* One tick; of the coupling's states only those that gains which stay have. */
static inline void avc_steady_gated_step(avc_couple_state_t *state, const avc_steady_gated_t *steady, float position_m,
                                avc_steady_gated_out_t *out)
{
    const bool v2 = 0.0f < position_m;
    const float v19 = steady->v4 * state->coupling_deflection_before_m;
    const float v20 = steady->v17 * v19;
    const float v21 = position_m - v20;
    const float v24 = steady->v4 * state->environment_deflection_before_m;
    const float v25 = steady->v22 * v24;
    const float v26 = v21 - v25;
    const float v27 = steady->v14 * v26;
    const float v28 = v27 > 0.0f ? v27 : 0.0f;
    const float v30 = steady->v4 * position_m;
    const float v32 = steady->v4 * state->contact_position_before_m;
    const float v33 = v30 - v32;
    const float v34 = steady->v29 * v33;
    const float v35 = v28 + v34;
    const float v36 = v35 > 0.0f ? v35 : 0.0f;
    const float v37 = v2 ? v36 : 0.0f;
    const float v38 = v28 / steady->v16;
    const float v39 = v21 - v38;
    const float v42 = v39 > 0.0f ? v39 : 0.0f;
    const float v43 = steady->v41 * v42;
    const float v44 = v43 * v42;
    const float v46 = position_m - v39;
    const float v47 = steady->v45 * v46;
    const float v48 = v47 * v46;
    const float v49 = v44 + v48;
    out->force_n = v37;
    out->tool_m = v39;
    out->stored_j = v49;
    state->environment_deflection_before_m = v42;
    state->coupling_deflection_before_m = v46;
    state->contact_position_before_m = position_m;
}

#endif
