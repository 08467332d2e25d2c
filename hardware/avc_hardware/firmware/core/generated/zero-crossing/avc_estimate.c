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
    state->estimator_before_m_per_s = 0.0f;
    state->estimator_side = 0.0f;
    state->estimator_halves = 0.0f;
    state->estimator_age_ticks = 0.0f;
    state->estimator_crossing_ticks = 0.0f;
    state->estimator_last_half_ticks = 0.0f;
    state->estimator_earlier_half_ticks = 0.0f;
    state->estimator_earliest_half_ticks = 0.0f;
    state->hold_frequency_hz = 0.0f;
    state->hold_age_s = avc_estimate_constants[10];
}

void avc_estimate_step(avc_estimate_state_t *state, const avc_estimate_in_t *in, avc_estimate_out_t *out)
{
    const float v7 = in->position_m - state->estimator_position_m;
    const float v9 = v7 / avc_estimate_constants[2];
    const float v11 = v9 > avc_estimate_constants[3] ? v9 : avc_estimate_constants[3];
    const float v13 = v11 < avc_estimate_constants[4] ? v11 : avc_estimate_constants[4];
    const float v15 = v13 - state->estimator_mean_m_per_s;
    const float v16 = v15 - state->estimator_smoothed_m_per_s;
    const float v17 = avc_estimate_constants[1] * v16;
    const float v18 = state->estimator_smoothed_m_per_s + v17;
    const float v19 = v18 - state->estimator_twice_smoothed_m_per_s;
    const float v20 = avc_estimate_constants[1] * v19;
    const float v21 = state->estimator_twice_smoothed_m_per_s + v20;
    const bool v22 = avc_estimate_constants[0] < v21;
    const bool v27 = v21 < avc_estimate_constants[5];
    const float v29 = v27 ? (-1.0f) : 0.0f;
    const float v31 = v22 ? 1.0f : v29;
    const bool v33 = v31 != 0.0f;
    const bool v35 = v31 != state->estimator_side;
    const bool v36 = v33 && v35;
    const bool v38 = state->estimator_side != 0.0f;
    const float v39 = state->estimator_halves + (v38 ? 1.0f : 0.0f);
    const float v40 = v39 < 3.0f ? v39 : 3.0f;
    const bool v42 = !v36;
    const float v44 = v36 ? v40 : state->estimator_halves;
    const bool v45 = 3.0f <= v44;
    const float v48 = state->estimator_age_ticks + 1.0f;
    const bool v49 = avc_estimate_constants[6] < v48;
    const bool v50 = v42 && v49;
    const bool v51 = !v50;
    const bool v52 = v45 && v51;
    const bool v54 = state->estimator_before_m_per_s < 0.0f;
    const bool v55 = v21 < 0.0f;
    const bool v56 = (v54 ? 1.0f : 0.0f) != (v55 ? 1.0f : 0.0f);
    const float v57 = v21 - state->estimator_before_m_per_s;
    const float v61 = v56 ? v57 : 1.0f;
    const float v62 = v21 / v61;
    const float v63 = v48 - v62;
    const float v67 = v56 ? v63 : state->estimator_crossing_ticks;
    const float v71 = v36 ? v67 : state->estimator_last_half_ticks;
    const float v72 = v48 - v67;
    const float v73 = v38 ? v72 : 0.0f;
    const float v76 = v36 ? v73 : v48;
    const float v77 = v71 > v76 ? v71 : v76;
    const float v81 = v36 ? state->estimator_last_half_ticks : state->estimator_earlier_half_ticks;
    const float v82 = v76 < v71 ? v76 : v71;
    const float v83 = v81 > v82 ? v81 : v82;
    const float v84 = v77 + v83;
    const bool v86 = !v52;
    const float v88 = v52 ? v84 : 1.0f;
    const float v89 = avc_estimate_constants[2] * v88;
    const float v90 = 1.0f / v89;
    const float v91 = v52 ? v90 : 0.0f;
    const bool v95 = state->hold_age_s < avc_estimate_constants[7];
    const bool v97 = 0.0f < state->hold_frequency_hz;
    const float v102 = v97 ? state->hold_frequency_hz : in->rest_hz;
    const float v106 = in->rest_hz - v102;
    const float v107 = avc_estimate_constants[8] * v106;
    const float v108 = v102 + v107;
    const float v110 = v95 ? v102 : v108;
    const float v112 = v52 ? v91 : v110;
    const float v114 = avc_estimate_constants[9] * v15;
    const float v115 = state->estimator_mean_m_per_s + v114;
    const float v118 = v36 ? v31 : state->estimator_side;
    const float v119 = v51 ? v118 : 0.0f;
    const float v120 = v51 ? v44 : 0.0f;
    const float v121 = v51 ? v76 : 0.0f;
    const bool v122 = v50 || v36;
    const bool v123 = !v122;
    const float v124 = v123 ? v67 : 0.0f;
    const float v128 = v36 ? state->estimator_earlier_half_ticks : state->estimator_earliest_half_ticks;
    const float v129 = state->hold_age_s + avc_estimate_constants[2];
    const float v130 = v129 < avc_estimate_constants[7] ? v129 : avc_estimate_constants[7];
    const float v131 = v86 ? v130 : 0.0f;
    const float r3 = in->position_m;
    out->estimate_hz = v91;
    out->valid = (v52 ? 1.0f : 0.0f);
    out->frequency_hz = v112;
    state->estimator_position_m = r3;
    state->estimator_mean_m_per_s = v115;
    state->estimator_smoothed_m_per_s = v18;
    state->estimator_twice_smoothed_m_per_s = v21;
    state->estimator_before_m_per_s = v21;
    state->estimator_side = v119;
    state->estimator_halves = v120;
    state->estimator_age_ticks = v121;
    state->estimator_crossing_ticks = v124;
    state->estimator_last_half_ticks = v71;
    state->estimator_earlier_half_ticks = v81;
    state->estimator_earliest_half_ticks = v128;
    state->hold_frequency_hz = v112;
    state->hold_age_s = v131;
}
