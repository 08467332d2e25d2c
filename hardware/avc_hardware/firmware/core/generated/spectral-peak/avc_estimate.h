/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_ESTIMATE_H
#define AVC_ESTIMATE_H

typedef struct {
    float estimator_position_m;
    float estimator_mean_m_per_s;
    float estimator_smoothed_m_per_s;
    float estimator_twice_smoothed_m_per_s;
    float estimator_bin0_inner_re;
    float estimator_bin0_inner_im;
    float estimator_bin0_outer_re;
    float estimator_bin0_outer_im;
    float estimator_bin1_inner_re;
    float estimator_bin1_inner_im;
    float estimator_bin1_outer_re;
    float estimator_bin1_outer_im;
    float estimator_bin2_inner_re;
    float estimator_bin2_inner_im;
    float estimator_bin2_outer_re;
    float estimator_bin2_outer_im;
    float estimator_bin3_inner_re;
    float estimator_bin3_inner_im;
    float estimator_bin3_outer_re;
    float estimator_bin3_outer_im;
    float estimator_bin4_inner_re;
    float estimator_bin4_inner_im;
    float estimator_bin4_outer_re;
    float estimator_bin4_outer_im;
    float estimator_bin5_inner_re;
    float estimator_bin5_inner_im;
    float estimator_bin5_outer_re;
    float estimator_bin5_outer_im;
    float estimator_bin6_inner_re;
    float estimator_bin6_inner_im;
    float estimator_bin6_outer_re;
    float estimator_bin6_outer_im;
    float estimator_bin7_inner_re;
    float estimator_bin7_inner_im;
    float estimator_bin7_outer_re;
    float estimator_bin7_outer_im;
    float estimator_bin8_inner_re;
    float estimator_bin8_inner_im;
    float estimator_bin8_outer_re;
    float estimator_bin8_outer_im;
    float estimator_bin9_inner_re;
    float estimator_bin9_inner_im;
    float estimator_bin9_outer_re;
    float estimator_bin9_outer_im;
    float estimator_bin10_inner_re;
    float estimator_bin10_inner_im;
    float estimator_bin10_outer_re;
    float estimator_bin10_outer_im;
    float estimator_bin11_inner_re;
    float estimator_bin11_inner_im;
    float estimator_bin11_outer_re;
    float estimator_bin11_outer_im;
    float estimator_bin12_inner_re;
    float estimator_bin12_inner_im;
    float estimator_bin12_outer_re;
    float estimator_bin12_outer_im;
    float estimator_bin13_inner_re;
    float estimator_bin13_inner_im;
    float estimator_bin13_outer_re;
    float estimator_bin13_outer_im;
    float estimator_bin14_inner_re;
    float estimator_bin14_inner_im;
    float estimator_bin14_outer_re;
    float estimator_bin14_outer_im;
    float estimator_bin15_inner_re;
    float estimator_bin15_inner_im;
    float estimator_bin15_outer_re;
    float estimator_bin15_outer_im;
    float estimator_bin16_inner_re;
    float estimator_bin16_inner_im;
    float estimator_bin16_outer_re;
    float estimator_bin16_outer_im;
    float estimator_bin17_inner_re;
    float estimator_bin17_inner_im;
    float estimator_bin17_outer_re;
    float estimator_bin17_outer_im;
    float estimator_smooth_hz;
    float estimator_turns;
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
extern const float avc_estimate_constants[83];

/* The state of a device that has always rested at a position. */
void avc_estimate_start(avc_estimate_state_t *state, float position_m);

/* One tick. */
void avc_estimate_step(avc_estimate_state_t *state, const avc_estimate_in_t *in, avc_estimate_out_t *out);

#endif
