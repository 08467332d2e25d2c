/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_COUPLE_CLIPS_H
#define AVC_COUPLE_CLIPS_H

#include <stdbool.h>

#include "avc_couple.h"

/* What depends on sample time, encoder and settings. */
extern const float avc_couple_clips_constants[4];

/* The first tick. */
static inline void avc_couple_clips_first(avc_couple_state_t *state, const avc_couple_in_t *in, avc_couple_out_t *out)
{
    const float v8 = in->wanted_stiffness_n_per_m > in->wanted_stiffness_n_per_m ? in->wanted_stiffness_n_per_m : in->wanted_stiffness_n_per_m;
    const float v9 = avc_couple_clips_constants[0] * v8;
    const float v10 = in->wanted_stiffness_n_per_m - v9;
    const float v11 = in->wanted_stiffness_n_per_m > v10 ? in->wanted_stiffness_n_per_m : v10;
    const float v12 = in->wanted_stiffness_n_per_m + v9;
    const float v13 = v11 < v12 ? v11 : v12;
    const float v20 = in->wanted_damping_ns_per_m > in->wanted_damping_ns_per_m ? in->wanted_damping_ns_per_m : in->wanted_damping_ns_per_m;
    const float v21 = avc_couple_clips_constants[0] * v20;
    const float v22 = in->wanted_damping_ns_per_m - v21;
    const float v23 = in->wanted_damping_ns_per_m > v22 ? in->wanted_damping_ns_per_m : v22;
    const float v24 = in->wanted_damping_ns_per_m + v21;
    const float v25 = v23 < v24 ? v23 : v24;
    const float v26 = avc_couple_clips_constants[1] * v25;
    const float v27 = v13 + v26;
    const float v30 = avc_couple_clips_constants[1] * in->wall_damping_ns_per_m;
    const float v31 = in->wall_stiffness_n_per_m + v30;
    const float v32 = v27 + v31;
    const float v33 = v31 / v32;
    const float v34 = v27 * v33;
    const float v37 = v27 + 1.0e-20f;
    const float v38 = v25 / v37;
    const float v40 = avc_couple_clips_constants[1] * state->coupling_deflection_before_m;
    const float v41 = v38 * v40;
    const float v42 = in->position_m - v41;
    const bool v44 = 0.0f < in->position_m;
    const float v45 = v13 / v37;
    const float v46 = state->coupling_deflection_before_m > 0.0f ? state->coupling_deflection_before_m : 0.0f;
    const float v48 = v46 - state->adaptation_anchor_m;
    const float v49 = in->wanted_stiffness_n_per_m > v13 ? in->wanted_stiffness_n_per_m : v13;
    const float v51 = v49 + 1.0e-30f;
    const float v52 = in->wanted_stiffness_n_per_m / v51;
    const float v53 = v48 * v52;
    const float v54 = v46 - v53;
    const float v59 = state->asked_force_n + state->adaptation_held_force_n;
    const float v60 = 0.5f * v59;
    const float v62 = v60 * state->adaptation_moved_m;
    const float v63 = state->adaptation_tank_j + v62;
    const float v64 = 0.5f * in->wanted_stiffness_n_per_m;
    const float v65 = v64 * v48;
    const float v66 = v65 * v48;
    const float v68 = v66 + state->environment_energy_j;
    const float v70 = v68 - state->adaptation_stored_j;
    const float v71 = v63 - v70;
    const float v73 = v71 < 0.01f ? v71 : 0.01f;
    const float v75 = v73 > (-0.01f) ? v73 : (-0.01f);
    const float v76 = v75 > 0.0f ? v75 : 0.0f;
    const float v77 = 0.5f * v13;
    const float v80 = v46 - state->adaptation_mean_deflection_m;
    const float v81 = avc_couple_clips_constants[2] * v80;
    const float v82 = state->adaptation_mean_deflection_m + v81;
    const float v85 = v13 + 1.0f;
    const float v86 = in->rest_stiffness_n_per_m / v85;
    const float v87 = v86 - 1.0f;
    const float v88 = v87 > 0.0f ? v87 : 0.0f;
    const float v90 = v88 - state->adaptation_missing;
    const float v91 = v90 > 0.0f ? v90 : 0.0f;
    const float v92 = v82 * v91;
    const float v94 = v54 - v92;
    const float v95 = v82 * v88;
    const float v96 = v94 + v95;
    const float v97 = avc_couple_clips_constants[3] * v96;
    const float v98 = v92 + v97;
    const float v99 = v77 * v98;
    const float v100 = v53 + v53;
    const float v101 = v98 + v100;
    const float v102 = v99 * v101;
    const bool v103 = v76 < v102;
    const float v104 = v102 + 1.0e-30f;
    const float v105 = v76 / v104;
    const float v109 = v103 ? v105 : 1.0f;
    const float v110 = v109 * v98;
    const float v111 = v54 - v110;
    const float v112 = v45 * v111;
    const float v113 = v44 ? v112 : 0.0f;
    const float v114 = v42 - v113;
    const float v115 = in->wall_damping_ns_per_m / v31;
    const float v117 = avc_couple_clips_constants[1] * state->environment_deflection_before_m;
    const float v118 = v115 * v117;
    const float v119 = v114 - v118;
    const float v120 = v34 * v119;
    const float v126 = in->wanted_contact_damping_ns_per_m > in->wanted_contact_damping_ns_per_m ? in->wanted_contact_damping_ns_per_m : in->wanted_contact_damping_ns_per_m;
    const float v127 = avc_couple_clips_constants[0] * v126;
    const float v128 = in->wanted_contact_damping_ns_per_m - v127;
    const float v129 = in->wanted_contact_damping_ns_per_m > v128 ? in->wanted_contact_damping_ns_per_m : v128;
    const float v130 = in->wanted_contact_damping_ns_per_m + v127;
    const float v131 = v129 < v130 ? v129 : v130;
    const float v132 = avc_couple_clips_constants[1] * in->position_m;
    const float v134 = avc_couple_clips_constants[1] * state->contact_position_before_m;
    const float v135 = v132 - v134;
    const float v136 = v131 * v135;
    const float v137 = v120 + v136;
    const float v138 = v137 > 0.0f ? v137 : 0.0f;
    const float v139 = v120 / v37;
    const float v140 = v114 - v139;
    const float v141 = v44 ? v111 : 0.0f;
    const float v142 = 0.5f * in->wall_stiffness_n_per_m;
    const float v143 = v140 > 0.0f ? v140 : 0.0f;
    const float v144 = v142 * v143;
    const float v145 = v144 * v143;
    const float v146 = in->position_m - v140;
    const float v147 = v146 > 0.0f ? v146 : 0.0f;
    const float v148 = v147 - v141;
    const float v149 = v77 * v148;
    const float v150 = v149 * v148;
    const float v151 = v145 + v150;
    const float v152 = in->position_m > 0.0f ? in->position_m : 0.0f;
    const float v154 = v152 - state->adaptation_position_m;
    const float v155 = v44 ? v82 : 0.0f;
    const float r18 = state->asked_force_n;
    const float r23 = in->position_m;
    out->force_n = v138;
    out->tool_m = v140;
    out->damping_ns_per_m = v25;
    out->stiffness_n_per_m = v13;
    out->contact_damping_ns_per_m = v131;
    out->anchor_m = v141;
    out->stored_j = v151;
    state->environment_deflection_before_m = v140;
    state->coupling_deflection_before_m = v146;
    state->environment_energy_j = v145;
    state->asked_force_n = v138;
    state->adaptation_started = 1.0f;
    state->adaptation_damping_ns_per_m = v25;
    state->adaptation_stiffness_n_per_m = v13;
    state->adaptation_contact_damping_ns_per_m = v131;
    state->adaptation_tank_j = v75;
    state->adaptation_stored_j = v68;
    state->adaptation_anchor_m = v141;
    state->adaptation_held_force_n = r18;
    state->adaptation_moved_m = v154;
    state->adaptation_position_m = v152;
    state->adaptation_mean_deflection_m = v155;
    state->adaptation_missing = v88;
    state->contact_position_before_m = r23;
}

/* A tick after the first. */
static inline void avc_couple_clips_later(avc_couple_state_t *state, const avc_couple_in_t *in, avc_couple_out_t *out)
{
    const float v8 = state->adaptation_stiffness_n_per_m > in->wanted_stiffness_n_per_m ? state->adaptation_stiffness_n_per_m : in->wanted_stiffness_n_per_m;
    const float v9 = avc_couple_clips_constants[0] * v8;
    const float v10 = state->adaptation_stiffness_n_per_m - v9;
    const float v11 = in->wanted_stiffness_n_per_m > v10 ? in->wanted_stiffness_n_per_m : v10;
    const float v12 = state->adaptation_stiffness_n_per_m + v9;
    const float v13 = v11 < v12 ? v11 : v12;
    const float v20 = state->adaptation_damping_ns_per_m > in->wanted_damping_ns_per_m ? state->adaptation_damping_ns_per_m : in->wanted_damping_ns_per_m;
    const float v21 = avc_couple_clips_constants[0] * v20;
    const float v22 = state->adaptation_damping_ns_per_m - v21;
    const float v23 = in->wanted_damping_ns_per_m > v22 ? in->wanted_damping_ns_per_m : v22;
    const float v24 = state->adaptation_damping_ns_per_m + v21;
    const float v25 = v23 < v24 ? v23 : v24;
    const float v26 = avc_couple_clips_constants[1] * v25;
    const float v27 = v13 + v26;
    const float v30 = avc_couple_clips_constants[1] * in->wall_damping_ns_per_m;
    const float v31 = in->wall_stiffness_n_per_m + v30;
    const float v32 = v27 + v31;
    const float v33 = v31 / v32;
    const float v34 = v27 * v33;
    const float v37 = v27 + 1.0e-20f;
    const float v38 = v25 / v37;
    const float v40 = avc_couple_clips_constants[1] * state->coupling_deflection_before_m;
    const float v41 = v38 * v40;
    const float v42 = in->position_m - v41;
    const bool v44 = 0.0f < in->position_m;
    const float v45 = v13 / v37;
    const float v46 = state->coupling_deflection_before_m > 0.0f ? state->coupling_deflection_before_m : 0.0f;
    const float v48 = v46 - state->adaptation_anchor_m;
    const float v49 = state->adaptation_stiffness_n_per_m > v13 ? state->adaptation_stiffness_n_per_m : v13;
    const float v51 = v49 + 1.0e-30f;
    const float v52 = state->adaptation_stiffness_n_per_m / v51;
    const float v53 = v48 * v52;
    const float v54 = v46 - v53;
    const float v59 = state->asked_force_n + state->adaptation_held_force_n;
    const float v60 = 0.5f * v59;
    const float v62 = v60 * state->adaptation_moved_m;
    const float v63 = state->adaptation_tank_j + v62;
    const float v64 = 0.5f * state->adaptation_stiffness_n_per_m;
    const float v65 = v64 * v48;
    const float v66 = v65 * v48;
    const float v68 = v66 + state->environment_energy_j;
    const float v70 = v68 - state->adaptation_stored_j;
    const float v71 = v63 - v70;
    const float v73 = v71 < 0.01f ? v71 : 0.01f;
    const float v75 = v73 > (-0.01f) ? v73 : (-0.01f);
    const float v76 = v75 > 0.0f ? v75 : 0.0f;
    const float v77 = 0.5f * v13;
    const float v80 = v46 - state->adaptation_mean_deflection_m;
    const float v81 = avc_couple_clips_constants[2] * v80;
    const float v82 = state->adaptation_mean_deflection_m + v81;
    const float v85 = v13 + 1.0f;
    const float v86 = in->rest_stiffness_n_per_m / v85;
    const float v87 = v86 - 1.0f;
    const float v88 = v87 > 0.0f ? v87 : 0.0f;
    const float v90 = v88 - state->adaptation_missing;
    const float v91 = v90 > 0.0f ? v90 : 0.0f;
    const float v92 = v82 * v91;
    const float v94 = v54 - v92;
    const float v95 = v82 * v88;
    const float v96 = v94 + v95;
    const float v97 = avc_couple_clips_constants[3] * v96;
    const float v98 = v92 + v97;
    const float v99 = v77 * v98;
    const float v100 = v53 + v53;
    const float v101 = v98 + v100;
    const float v102 = v99 * v101;
    const bool v103 = v76 < v102;
    const float v104 = v102 + 1.0e-30f;
    const float v105 = v76 / v104;
    const float v109 = v103 ? v105 : 1.0f;
    const float v110 = v109 * v98;
    const float v111 = v54 - v110;
    const float v112 = v45 * v111;
    const float v113 = v44 ? v112 : 0.0f;
    const float v114 = v42 - v113;
    const float v115 = in->wall_damping_ns_per_m / v31;
    const float v117 = avc_couple_clips_constants[1] * state->environment_deflection_before_m;
    const float v118 = v115 * v117;
    const float v119 = v114 - v118;
    const float v120 = v34 * v119;
    const float v126 = state->adaptation_contact_damping_ns_per_m > in->wanted_contact_damping_ns_per_m ? state->adaptation_contact_damping_ns_per_m : in->wanted_contact_damping_ns_per_m;
    const float v127 = avc_couple_clips_constants[0] * v126;
    const float v128 = state->adaptation_contact_damping_ns_per_m - v127;
    const float v129 = in->wanted_contact_damping_ns_per_m > v128 ? in->wanted_contact_damping_ns_per_m : v128;
    const float v130 = state->adaptation_contact_damping_ns_per_m + v127;
    const float v131 = v129 < v130 ? v129 : v130;
    const float v132 = avc_couple_clips_constants[1] * in->position_m;
    const float v134 = avc_couple_clips_constants[1] * state->contact_position_before_m;
    const float v135 = v132 - v134;
    const float v136 = v131 * v135;
    const float v137 = v120 + v136;
    const float v138 = v137 > 0.0f ? v137 : 0.0f;
    const float v139 = v120 / v37;
    const float v140 = v114 - v139;
    const float v141 = v44 ? v111 : 0.0f;
    const float v142 = 0.5f * in->wall_stiffness_n_per_m;
    const float v143 = v140 > 0.0f ? v140 : 0.0f;
    const float v144 = v142 * v143;
    const float v145 = v144 * v143;
    const float v146 = in->position_m - v140;
    const float v147 = v146 > 0.0f ? v146 : 0.0f;
    const float v148 = v147 - v141;
    const float v149 = v77 * v148;
    const float v150 = v149 * v148;
    const float v151 = v145 + v150;
    const float v152 = in->position_m > 0.0f ? in->position_m : 0.0f;
    const float v154 = v152 - state->adaptation_position_m;
    const float v155 = v44 ? v82 : 0.0f;
    const float r18 = state->asked_force_n;
    const float r23 = in->position_m;
    out->force_n = v138;
    out->tool_m = v140;
    out->damping_ns_per_m = v25;
    out->stiffness_n_per_m = v13;
    out->contact_damping_ns_per_m = v131;
    out->anchor_m = v141;
    out->stored_j = v151;
    state->environment_deflection_before_m = v140;
    state->coupling_deflection_before_m = v146;
    state->environment_energy_j = v145;
    state->asked_force_n = v138;
    state->adaptation_damping_ns_per_m = v25;
    state->adaptation_stiffness_n_per_m = v13;
    state->adaptation_contact_damping_ns_per_m = v131;
    state->adaptation_tank_j = v75;
    state->adaptation_stored_j = v68;
    state->adaptation_anchor_m = v141;
    state->adaptation_held_force_n = r18;
    state->adaptation_moved_m = v154;
    state->adaptation_position_m = v152;
    state->adaptation_mean_deflection_m = v155;
    state->adaptation_missing = v88;
    state->contact_position_before_m = r23;
}

/* One tick. */
static inline void avc_couple_clips_step(avc_couple_state_t *state, const avc_couple_in_t *in, avc_couple_out_t *out)
{
    if (state->adaptation_started != 0.0f) {
        avc_couple_clips_later(state, in, out);
    } else {
        avc_couple_clips_first(state, in, out);
    }
}

#endif
