/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_COUPLE_H
#define AVC_COUPLE_H

typedef struct {
    float environment_deflection_before_m;
    float coupling_deflection_before_m;
    float environment_energy_j;
    float asked_force_n;
    float adaptation_started;
    float adaptation_damping_ns_per_m;
    float adaptation_stiffness_n_per_m;
    float adaptation_contact_damping_ns_per_m;
    float adaptation_tank_j;
    float adaptation_stored_j;
    float adaptation_anchor_m;
    float adaptation_held_force_n;
    float adaptation_moved_m;
    float adaptation_position_m;
    float adaptation_mean_deflection_m;
    float adaptation_missing;
    float contact_position_before_m;
} avc_couple_state_t;

typedef struct {
    float position_m;
    float wanted_damping_ns_per_m;
    float wanted_stiffness_n_per_m;
    float wanted_contact_damping_ns_per_m;
    float rest_stiffness_n_per_m;
    float wall_stiffness_n_per_m;
    float wall_damping_ns_per_m;
    float relaxes;
} avc_couple_in_t;

typedef struct {
    float force_n;
    float tool_m;
    float damping_ns_per_m;
    float stiffness_n_per_m;
    float contact_damping_ns_per_m;
    float anchor_m;
    float stored_j;
} avc_couple_out_t;

/* The state of a device that has always rested at a position. */
static inline void avc_couple_start(avc_couple_state_t *state, float position_m)
{
    state->environment_deflection_before_m = position_m;
    state->coupling_deflection_before_m = 0.0f;
    state->environment_energy_j = 0.0f;
    state->asked_force_n = 0.0f;
    state->adaptation_started = 0.0f;
    state->adaptation_damping_ns_per_m = 0.0f;
    state->adaptation_stiffness_n_per_m = 0.0f;
    state->adaptation_contact_damping_ns_per_m = 0.0f;
    state->adaptation_tank_j = 0.0f;
    state->adaptation_stored_j = 0.0f;
    state->adaptation_anchor_m = 0.0f;
    state->adaptation_held_force_n = 0.0f;
    state->adaptation_moved_m = 0.0f;
    state->adaptation_position_m = 0.0f;
    state->adaptation_mean_deflection_m = 0.0f;
    state->adaptation_missing = 0.0f;
    state->contact_position_before_m = position_m;
}

#endif
