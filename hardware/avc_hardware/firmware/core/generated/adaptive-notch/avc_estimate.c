/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#include "avc_estimate.h"

#include <stdbool.h>

void avc_estimate_start(avc_estimate_state_t *state, float position_m)
{
    state->estimator_position_m = position_m;
    state->estimator_mean_m_per_s = 0.0f;
    state->estimator_smoothed_m_per_s = 0.0f;
    state->estimator_twice_smoothed_m_per_s = 0.0f;
    state->estimator_turn_rad = avc_estimate_constants[14];
    state->estimator_inphase_m_per_s = 0.0f;
    state->estimator_quadrature_m_per_s = 0.0f;
    state->estimator_left_over_power = 0.0f;
    state->estimator_power = 0.0f;
    state->estimator_envelope_m_per_s = 0.0f;
    state->hold_frequency_hz = 0.0f;
    state->hold_age_s = avc_estimate_constants[15];
}

void avc_estimate_step(avc_estimate_state_t *state, const avc_estimate_in_t *in, avc_estimate_out_t *out)
{
    const float v4 = state->estimator_turn_rad / 6.2831855f;
    const float v12 = in->position_m - state->estimator_position_m;
    const float v14 = v12 / avc_estimate_constants[2];
    const float v16 = v14 > avc_estimate_constants[3] ? v14 : avc_estimate_constants[3];
    const float v18 = v16 < avc_estimate_constants[4] ? v16 : avc_estimate_constants[4];
    const float v20 = v18 - state->estimator_mean_m_per_s;
    const float v21 = v20 - state->estimator_smoothed_m_per_s;
    const float v22 = avc_estimate_constants[1] * v21;
    const float v23 = state->estimator_smoothed_m_per_s + v22;
    const float v24 = v23 - state->estimator_twice_smoothed_m_per_s;
    const float v25 = avc_estimate_constants[1] * v24;
    const float v26 = state->estimator_twice_smoothed_m_per_s + v25;
    const float v27 = v26 - state->estimator_inphase_m_per_s;
    const float v29 = v27 - state->estimator_quadrature_m_per_s;
    const float v30 = state->estimator_turn_rad * v29;
    const float v31 = state->estimator_inphase_m_per_s + v30;
    const float v32 = v31 * v31;
    const float v33 = state->estimator_turn_rad * v31;
    const float v34 = state->estimator_quadrature_m_per_s + v33;
    const float v35 = v34 * v34;
    const float v36 = v32 + v35;
    const float v37 = v26 * v26;
    const float v38 = v36 + v37;
    const float v39 = 0.5f * v38;
    const float v40 = v39 - state->estimator_power;
    const float v41 = v4 * v40;
    const float v42 = state->estimator_power + v41;
    const bool v43 = avc_estimate_constants[0] < v42;
    const float v45 = v26 < 0.0f ? -v26 : v26;
    const float v50 = 0.6f * state->estimator_turn_rad;
    const float v51 = v27 * v27;
    const float v52 = v36 + v51;
    const float v54 = v52 + avc_estimate_constants[7];
    const float v55 = v50 / v54;
    const float v56 = v55 * v27;
    const float v57 = v56 * v34;
    const float v58 = -v57;
    const float v60 = v58 > (-0.05f) ? v58 : (-0.05f);
    const float v62 = v60 < 0.05f ? v60 : 0.05f;
    const float v63 = 1.0f + v62;
    const float v64 = state->estimator_turn_rad * v63;
    const float v66 = v64 > avc_estimate_constants[8] ? v64 : avc_estimate_constants[8];
    const float v68 = v66 < avc_estimate_constants[9] ? v66 : avc_estimate_constants[9];
    const float v69 = v68 * v68;
    const float v71 = v69 / 24.0f;
    const float v72 = 1.0f + v71;
    const float v73 = v68 * v72;
    const float v74 = v73 / avc_estimate_constants[8];
    const float v75 = v74 > 1.0f ? v74 : 1.0f;
    const float v76 = avc_estimate_constants[6] * v75;
    const float v77 = 1.0f - v76;
    const float v78 = state->estimator_envelope_m_per_s * v77;
    const float v79 = v45 > v78 ? v45 : v78;
    const bool v80 = avc_estimate_constants[5] < v79;
    const bool v81 = v43 && v80;
    const float v83 = v51 - state->estimator_left_over_power;
    const float v84 = v4 * v83;
    const float v85 = state->estimator_left_over_power + v84;
    const float v86 = 0.6f * v42;
    const bool v87 = v85 < v86;
    const bool v88 = v81 && v87;
    const float v89 = v88 ? v74 : 0.0f;
    const bool v91 = !v88;
    const bool v94 = state->hold_age_s < avc_estimate_constants[10];
    const bool v97 = 0.0f < state->hold_frequency_hz;
    const float v102 = v97 ? state->hold_frequency_hz : in->rest_hz;
    const float v106 = in->rest_hz - v102;
    const float v107 = avc_estimate_constants[11] * v106;
    const float v108 = v102 + v107;
    const float v110 = v94 ? v102 : v108;
    const float v112 = v88 ? v89 : v110;
    const float v114 = avc_estimate_constants[12] * v20;
    const float v115 = state->estimator_mean_m_per_s + v114;
    const float v119 = avc_estimate_constants[13] - state->estimator_turn_rad;
    const float v120 = v4 * v119;
    const float v121 = state->estimator_turn_rad + v120;
    const float v123 = v81 ? v68 : v121;
    const float v124 = state->hold_age_s + avc_estimate_constants[2];
    const float v125 = v124 < avc_estimate_constants[10] ? v124 : avc_estimate_constants[10];
    const float v126 = v91 ? v125 : 0.0f;
    const float r3 = in->position_m;
    out->estimate_hz = v89;
    out->valid = (v88 ? 1.0f : 0.0f);
    out->frequency_hz = v112;
    state->estimator_position_m = r3;
    state->estimator_mean_m_per_s = v115;
    state->estimator_smoothed_m_per_s = v23;
    state->estimator_twice_smoothed_m_per_s = v26;
    state->estimator_turn_rad = v123;
    state->estimator_inphase_m_per_s = v31;
    state->estimator_quadrature_m_per_s = v34;
    state->estimator_left_over_power = v85;
    state->estimator_power = v42;
    state->estimator_envelope_m_per_s = v79;
    state->hold_frequency_hz = v112;
    state->hold_age_s = v126;
}
