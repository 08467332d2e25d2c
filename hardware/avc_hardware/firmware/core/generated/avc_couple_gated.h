/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_COUPLE_GATED_H
#define AVC_COUPLE_GATED_H

#include <stdbool.h>

#include "avc_couple.h"

/* What depends on sample time, encoder and settings. */
extern const float avc_couple_gated_constants[4];

/* The first tick. */
static inline void avc_couple_gated_first(avc_couple_state_t *state, const avc_couple_in_t *in, avc_couple_out_t *out)
{
    const bool v2 = 0.0f < in->position_m;
    const float v11 = in->wanted_stiffness_n_per_m > in->wanted_stiffness_n_per_m ? in->wanted_stiffness_n_per_m : in->wanted_stiffness_n_per_m;
    const float v12 = avc_couple_gated_constants[0] * v11;
    const float v13 = in->wanted_stiffness_n_per_m - v12;
    const float v14 = in->wanted_stiffness_n_per_m > v13 ? in->wanted_stiffness_n_per_m : v13;
    const float v15 = in->wanted_stiffness_n_per_m + v12;
    const float v16 = v14 < v15 ? v14 : v15;
    const float v23 = in->wanted_damping_ns_per_m > in->wanted_damping_ns_per_m ? in->wanted_damping_ns_per_m : in->wanted_damping_ns_per_m;
    const float v24 = avc_couple_gated_constants[0] * v23;
    const float v25 = in->wanted_damping_ns_per_m - v24;
    const float v26 = in->wanted_damping_ns_per_m > v25 ? in->wanted_damping_ns_per_m : v25;
    const float v27 = in->wanted_damping_ns_per_m + v24;
    const float v28 = v26 < v27 ? v26 : v27;
    const float v29 = avc_couple_gated_constants[1] * v28;
    const float v30 = v16 + v29;
    const float v33 = avc_couple_gated_constants[1] * in->wall_damping_ns_per_m;
    const float v34 = in->wall_stiffness_n_per_m + v33;
    const float v35 = v30 + v34;
    const float v36 = v34 / v35;
    const float v37 = v30 * v36;
    const float v39 = v30 + 1.0e-20f;
    const float v40 = v28 / v39;
    const float v42 = avc_couple_gated_constants[1] * state->coupling_deflection_before_m;
    const float v48 = (in->relaxes != 0.0f) ? (v2 ? 1.0f : 0.0f) : 1.0f;
    const float v49 = v42 * v48;
    const float v50 = v40 * v49;
    const float v51 = in->position_m - v50;
    const float v52 = v16 / v39;
    const float v54 = state->coupling_deflection_before_m - state->adaptation_anchor_m;
    const float v55 = in->wanted_stiffness_n_per_m > v16 ? in->wanted_stiffness_n_per_m : v16;
    const float v57 = v55 + 1.0e-30f;
    const float v58 = in->wanted_stiffness_n_per_m / v57;
    const float v59 = v54 * v58;
    const float v60 = state->coupling_deflection_before_m - v59;
    const float v65 = state->asked_force_n + state->adaptation_held_force_n;
    const float v66 = 0.5f * v65;
    const float v68 = v66 * state->adaptation_moved_m;
    const float v69 = state->adaptation_tank_j + v68;
    const float v70 = 0.5f * in->wanted_stiffness_n_per_m;
    const float v71 = v70 * v54;
    const float v72 = v71 * v54;
    const float v74 = v72 + state->environment_energy_j;
    const float v76 = v74 - state->adaptation_stored_j;
    const float v77 = v69 - v76;
    const float v79 = v77 < 0.01f ? v77 : 0.01f;
    const float v81 = v79 > (-0.01f) ? v79 : (-0.01f);
    const float v82 = v81 > 0.0f ? v81 : 0.0f;
    const float v83 = 0.5f * v16;
    const float v86 = state->coupling_deflection_before_m - state->adaptation_mean_deflection_m;
    const float v87 = avc_couple_gated_constants[2] * v86;
    const float v88 = state->adaptation_mean_deflection_m + v87;
    const float v90 = v16 + 1.0f;
    const float v91 = in->rest_stiffness_n_per_m / v90;
    const float v92 = v91 - 1.0f;
    const float v93 = v92 > 0.0f ? v92 : 0.0f;
    const float v95 = v93 - state->adaptation_missing;
    const float v96 = v95 > 0.0f ? v95 : 0.0f;
    const float v97 = v88 * v96;
    const float v99 = v60 - v97;
    const float v100 = v88 * v93;
    const float v101 = v99 + v100;
    const float v102 = avc_couple_gated_constants[3] * v101;
    const float v103 = v97 + v102;
    const float v104 = v83 * v103;
    const float v105 = v59 + v59;
    const float v106 = v103 + v105;
    const float v107 = v104 * v106;
    const bool v108 = v82 < v107;
    const float v109 = v107 + 1.0e-30f;
    const float v110 = v82 / v109;
    const float v114 = v108 ? v110 : 1.0f;
    const float v115 = v114 * v103;
    const float v116 = v60 - v115;
    const float v117 = v52 * v116;
    const float v118 = v2 ? v117 : 0.0f;
    const float v119 = v51 - v118;
    const float v120 = in->wall_damping_ns_per_m / v34;
    const float v122 = avc_couple_gated_constants[1] * state->environment_deflection_before_m;
    const float v123 = v120 * v122;
    const float v124 = v119 - v123;
    const float v125 = v37 * v124;
    const float v126 = v125 > 0.0f ? v125 : 0.0f;
    const float v132 = in->wanted_contact_damping_ns_per_m > in->wanted_contact_damping_ns_per_m ? in->wanted_contact_damping_ns_per_m : in->wanted_contact_damping_ns_per_m;
    const float v133 = avc_couple_gated_constants[0] * v132;
    const float v134 = in->wanted_contact_damping_ns_per_m - v133;
    const float v135 = in->wanted_contact_damping_ns_per_m > v134 ? in->wanted_contact_damping_ns_per_m : v134;
    const float v136 = in->wanted_contact_damping_ns_per_m + v133;
    const float v137 = v135 < v136 ? v135 : v136;
    const float v138 = avc_couple_gated_constants[1] * in->position_m;
    const float v140 = avc_couple_gated_constants[1] * state->contact_position_before_m;
    const float v141 = v138 - v140;
    const float v142 = v137 * v141;
    const float v143 = v126 + v142;
    const float v144 = v143 > 0.0f ? v143 : 0.0f;
    const float v145 = v2 ? v144 : 0.0f;
    const float v146 = v126 / v39;
    const float v147 = v119 - v146;
    const float v148 = v2 ? v116 : 0.0f;
    const float v149 = 0.5f * in->wall_stiffness_n_per_m;
    const float v150 = v147 > 0.0f ? v147 : 0.0f;
    const float v151 = v149 * v150;
    const float v152 = v151 * v150;
    const float v153 = in->position_m - v147;
    const float v154 = v153 - v148;
    const float v155 = v83 * v154;
    const float v156 = v155 * v154;
    const float v157 = v152 + v156;
    const float v158 = in->position_m > 0.0f ? in->position_m : 0.0f;
    const float v160 = v158 - state->adaptation_position_m;
    const float v161 = v2 ? v88 : 0.0f;
    const float r18 = state->asked_force_n;
    const float r23 = in->position_m;
    out->force_n = v145;
    out->tool_m = v147;
    out->damping_ns_per_m = v28;
    out->stiffness_n_per_m = v16;
    out->contact_damping_ns_per_m = v137;
    out->anchor_m = v148;
    out->stored_j = v157;
    state->environment_deflection_before_m = v150;
    state->coupling_deflection_before_m = v153;
    state->environment_energy_j = v152;
    state->asked_force_n = v145;
    state->adaptation_started = 1.0f;
    state->adaptation_damping_ns_per_m = v28;
    state->adaptation_stiffness_n_per_m = v16;
    state->adaptation_contact_damping_ns_per_m = v137;
    state->adaptation_tank_j = v81;
    state->adaptation_stored_j = v74;
    state->adaptation_anchor_m = v148;
    state->adaptation_held_force_n = r18;
    state->adaptation_moved_m = v160;
    state->adaptation_position_m = v158;
    state->adaptation_mean_deflection_m = v161;
    state->adaptation_missing = v93;
    state->contact_position_before_m = r23;
}

/* A tick after the first. */
static inline void avc_couple_gated_later(avc_couple_state_t *state, const avc_couple_in_t *in, avc_couple_out_t *out)
{
    const bool v2 = 0.0f < in->position_m;
    const float v11 = state->adaptation_stiffness_n_per_m > in->wanted_stiffness_n_per_m ? state->adaptation_stiffness_n_per_m : in->wanted_stiffness_n_per_m;
    const float v12 = avc_couple_gated_constants[0] * v11;
    const float v13 = state->adaptation_stiffness_n_per_m - v12;
    const float v14 = in->wanted_stiffness_n_per_m > v13 ? in->wanted_stiffness_n_per_m : v13;
    const float v15 = state->adaptation_stiffness_n_per_m + v12;
    const float v16 = v14 < v15 ? v14 : v15;
    const float v23 = state->adaptation_damping_ns_per_m > in->wanted_damping_ns_per_m ? state->adaptation_damping_ns_per_m : in->wanted_damping_ns_per_m;
    const float v24 = avc_couple_gated_constants[0] * v23;
    const float v25 = state->adaptation_damping_ns_per_m - v24;
    const float v26 = in->wanted_damping_ns_per_m > v25 ? in->wanted_damping_ns_per_m : v25;
    const float v27 = state->adaptation_damping_ns_per_m + v24;
    const float v28 = v26 < v27 ? v26 : v27;
    const float v29 = avc_couple_gated_constants[1] * v28;
    const float v30 = v16 + v29;
    const float v33 = avc_couple_gated_constants[1] * in->wall_damping_ns_per_m;
    const float v34 = in->wall_stiffness_n_per_m + v33;
    const float v35 = v30 + v34;
    const float v36 = v34 / v35;
    const float v37 = v30 * v36;
    const float v39 = v30 + 1.0e-20f;
    const float v40 = v28 / v39;
    const float v42 = avc_couple_gated_constants[1] * state->coupling_deflection_before_m;
    const float v48 = (in->relaxes != 0.0f) ? (v2 ? 1.0f : 0.0f) : 1.0f;
    const float v49 = v42 * v48;
    const float v50 = v40 * v49;
    const float v51 = in->position_m - v50;
    const float v52 = v16 / v39;
    const float v54 = state->coupling_deflection_before_m - state->adaptation_anchor_m;
    const float v55 = state->adaptation_stiffness_n_per_m > v16 ? state->adaptation_stiffness_n_per_m : v16;
    const float v57 = v55 + 1.0e-30f;
    const float v58 = state->adaptation_stiffness_n_per_m / v57;
    const float v59 = v54 * v58;
    const float v60 = state->coupling_deflection_before_m - v59;
    const float v65 = state->asked_force_n + state->adaptation_held_force_n;
    const float v66 = 0.5f * v65;
    const float v68 = v66 * state->adaptation_moved_m;
    const float v69 = state->adaptation_tank_j + v68;
    const float v70 = 0.5f * state->adaptation_stiffness_n_per_m;
    const float v71 = v70 * v54;
    const float v72 = v71 * v54;
    const float v74 = v72 + state->environment_energy_j;
    const float v76 = v74 - state->adaptation_stored_j;
    const float v77 = v69 - v76;
    const float v79 = v77 < 0.01f ? v77 : 0.01f;
    const float v81 = v79 > (-0.01f) ? v79 : (-0.01f);
    const float v82 = v81 > 0.0f ? v81 : 0.0f;
    const float v83 = 0.5f * v16;
    const float v86 = state->coupling_deflection_before_m - state->adaptation_mean_deflection_m;
    const float v87 = avc_couple_gated_constants[2] * v86;
    const float v88 = state->adaptation_mean_deflection_m + v87;
    const float v90 = v16 + 1.0f;
    const float v91 = in->rest_stiffness_n_per_m / v90;
    const float v92 = v91 - 1.0f;
    const float v93 = v92 > 0.0f ? v92 : 0.0f;
    const float v95 = v93 - state->adaptation_missing;
    const float v96 = v95 > 0.0f ? v95 : 0.0f;
    const float v97 = v88 * v96;
    const float v99 = v60 - v97;
    const float v100 = v88 * v93;
    const float v101 = v99 + v100;
    const float v102 = avc_couple_gated_constants[3] * v101;
    const float v103 = v97 + v102;
    const float v104 = v83 * v103;
    const float v105 = v59 + v59;
    const float v106 = v103 + v105;
    const float v107 = v104 * v106;
    const bool v108 = v82 < v107;
    const float v109 = v107 + 1.0e-30f;
    const float v110 = v82 / v109;
    const float v114 = v108 ? v110 : 1.0f;
    const float v115 = v114 * v103;
    const float v116 = v60 - v115;
    const float v117 = v52 * v116;
    const float v118 = v2 ? v117 : 0.0f;
    const float v119 = v51 - v118;
    const float v120 = in->wall_damping_ns_per_m / v34;
    const float v122 = avc_couple_gated_constants[1] * state->environment_deflection_before_m;
    const float v123 = v120 * v122;
    const float v124 = v119 - v123;
    const float v125 = v37 * v124;
    const float v126 = v125 > 0.0f ? v125 : 0.0f;
    const float v132 = state->adaptation_contact_damping_ns_per_m > in->wanted_contact_damping_ns_per_m ? state->adaptation_contact_damping_ns_per_m : in->wanted_contact_damping_ns_per_m;
    const float v133 = avc_couple_gated_constants[0] * v132;
    const float v134 = state->adaptation_contact_damping_ns_per_m - v133;
    const float v135 = in->wanted_contact_damping_ns_per_m > v134 ? in->wanted_contact_damping_ns_per_m : v134;
    const float v136 = state->adaptation_contact_damping_ns_per_m + v133;
    const float v137 = v135 < v136 ? v135 : v136;
    const float v138 = avc_couple_gated_constants[1] * in->position_m;
    const float v140 = avc_couple_gated_constants[1] * state->contact_position_before_m;
    const float v141 = v138 - v140;
    const float v142 = v137 * v141;
    const float v143 = v126 + v142;
    const float v144 = v143 > 0.0f ? v143 : 0.0f;
    const float v145 = v2 ? v144 : 0.0f;
    const float v146 = v126 / v39;
    const float v147 = v119 - v146;
    const float v148 = v2 ? v116 : 0.0f;
    const float v149 = 0.5f * in->wall_stiffness_n_per_m;
    const float v150 = v147 > 0.0f ? v147 : 0.0f;
    const float v151 = v149 * v150;
    const float v152 = v151 * v150;
    const float v153 = in->position_m - v147;
    const float v154 = v153 - v148;
    const float v155 = v83 * v154;
    const float v156 = v155 * v154;
    const float v157 = v152 + v156;
    const float v158 = in->position_m > 0.0f ? in->position_m : 0.0f;
    const float v160 = v158 - state->adaptation_position_m;
    const float v161 = v2 ? v88 : 0.0f;
    const float r18 = state->asked_force_n;
    const float r23 = in->position_m;
    out->force_n = v145;
    out->tool_m = v147;
    out->damping_ns_per_m = v28;
    out->stiffness_n_per_m = v16;
    out->contact_damping_ns_per_m = v137;
    out->anchor_m = v148;
    out->stored_j = v157;
    state->environment_deflection_before_m = v150;
    state->coupling_deflection_before_m = v153;
    state->environment_energy_j = v152;
    state->asked_force_n = v145;
    state->adaptation_damping_ns_per_m = v28;
    state->adaptation_stiffness_n_per_m = v16;
    state->adaptation_contact_damping_ns_per_m = v137;
    state->adaptation_tank_j = v81;
    state->adaptation_stored_j = v74;
    state->adaptation_anchor_m = v148;
    state->adaptation_held_force_n = r18;
    state->adaptation_moved_m = v160;
    state->adaptation_position_m = v158;
    state->adaptation_mean_deflection_m = v161;
    state->adaptation_missing = v93;
    state->contact_position_before_m = r23;
}

/* One tick. */
static inline void avc_couple_gated_step(avc_couple_state_t *state, const avc_couple_in_t *in, avc_couple_out_t *out)
{
    if (state->adaptation_started != 0.0f) {
        avc_couple_gated_later(state, in, out);
    } else {
        avc_couple_gated_first(state, in, out);
    }
}

#endif
