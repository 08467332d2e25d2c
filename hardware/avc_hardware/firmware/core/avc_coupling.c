/* Coupling and wall in series at one sample: generated from the scene's CasADi expressions, do not edit.
 * Made by python -m avc_hardware.firmware_build generate */
#include "avc_coupling.h"

float avc_coupling_step(avc_coupling_t *state, float position_m, const avc_gains_t *gains,
                        float wall_damping_ns_per_m, float wall_stiffness_n_per_m, float sample_time_s)
{
    const float v3 = gains->damping_ns_per_m / sample_time_s;
    const float v4 = gains->stiffness_n_per_m + v3;
    const float v7 = wall_damping_ns_per_m / sample_time_s;
    const float v8 = wall_stiffness_n_per_m + v7;
    const float v9 = v4 + v8;
    const float v10 = v8 / v9;
    const float v11 = v4 * v10;
    const float v14 = 0.0e+00f < v4 ? 1.0f : 0.0f;
    const float v15 = gains->damping_ns_per_m / v4;
    const float v17 = state->coupling_deflection_before_m / sample_time_s;
    const float v18 = v15 * v17;
    const float v19 = v14 > 0.0f ? v18 : 0.0f;
    const float v20 = position_m - v19;
    const float v21 = wall_damping_ns_per_m / v8;
    const float v23 = state->environment_deflection_before_m / sample_time_s;
    const float v24 = v21 * v23;
    const float v25 = v20 - v24;
    const float v26 = v11 * v25;
    const float v27 = v26 > 0.0e+00f ? v26 : 0.0e+00f;
    const float v29 = position_m > 0.0e+00f ? position_m : 0.0e+00f;
    const float v30 = v29 / sample_time_s;
    const float v32 = state->contact_depth_before_m / sample_time_s;
    const float v33 = v30 - v32;
    const float v34 = gains->contact_damping_ns_per_m * v33;
    const float v35 = v27 + v34;
    const float v36 = v35 > 0.0e+00f ? v35 : 0.0e+00f;
    const float v38 = v27 / v4;
    const float v39 = v14 > 0.0f ? v38 : 0.0f;
    const float v40 = v20 - v39;
    const float v42 = position_m - v40;
    const float v44 = v40 > 0.0e+00f ? v40 : 0.0e+00f;
    const float force_n = v36;
    state->tool_m = v40;
    state->coupling_deflection_before_m = v42;
    state->environment_deflection_before_m = v44;
    state->contact_depth_before_m = v29;
    return force_n;
}
