/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_ESTIMATE_H
#define AVC_ESTIMATE_H

typedef struct {
    float estimator_position_m;
    float estimator_mean_m_per_s;
    float estimator_smoothed_m_per_s;
    float estimator_twice_smoothed_m_per_s;
    float estimator_turn_rad;
    float estimator_inphase_m_per_s;
    float estimator_quadrature_m_per_s;
    float estimator_left_over_power;
    float estimator_power;
    float estimator_envelope_m_per_s;
    float hold_frequency_hz;
    float hold_age_s;
} avc_estimate_state_t;

typedef struct {
    float position_m;
    float rest_hz;
} avc_estimate_in_t;

typedef struct {
    float estimate_hz;
    float valid;
    float frequency_hz;
} avc_estimate_out_t;

/* What depends on sample time, encoder and settings. */
extern const float avc_estimate_constants[16];

/* The state of a device that has always rested at a position. */
void avc_estimate_start(avc_estimate_state_t *state, float position_m);

/* One tick. */
void avc_estimate_step(avc_estimate_state_t *state, const avc_estimate_in_t *in, avc_estimate_out_t *out);

#endif
