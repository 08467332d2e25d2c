/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#ifndef AVC_ESTIMATE_H
#define AVC_ESTIMATE_H

typedef struct {
    float estimator_position_m;
    float estimator_fast_mean_m_per_s;
    float estimator_fast_smoothed_m_per_s;
    float estimator_fast_twice_smoothed_m_per_s;
    float estimator_fast_before_m_per_s;
    float estimator_fast_side;
    float estimator_fast_halves;
    float estimator_fast_age_ticks;
    float estimator_fast_crossing_ticks;
    float estimator_fast_last_half_ticks;
    float estimator_fast_earlier_half_ticks;
    float estimator_fast_earliest_half_ticks;
    float estimator_robust_mean_m_per_s;
    float estimator_robust_smoothed_m_per_s;
    float estimator_robust_twice_smoothed_m_per_s;
    float estimator_robust_bin0_inner_re;
    float estimator_robust_bin0_inner_im;
    float estimator_robust_bin0_outer_re;
    float estimator_robust_bin0_outer_im;
    float estimator_robust_bin1_inner_re;
    float estimator_robust_bin1_inner_im;
    float estimator_robust_bin1_outer_re;
    float estimator_robust_bin1_outer_im;
    float estimator_robust_bin2_inner_re;
    float estimator_robust_bin2_inner_im;
    float estimator_robust_bin2_outer_re;
    float estimator_robust_bin2_outer_im;
    float estimator_robust_bin3_inner_re;
    float estimator_robust_bin3_inner_im;
    float estimator_robust_bin3_outer_re;
    float estimator_robust_bin3_outer_im;
    float estimator_robust_bin4_inner_re;
    float estimator_robust_bin4_inner_im;
    float estimator_robust_bin4_outer_re;
    float estimator_robust_bin4_outer_im;
    float estimator_robust_bin5_inner_re;
    float estimator_robust_bin5_inner_im;
    float estimator_robust_bin5_outer_re;
    float estimator_robust_bin5_outer_im;
    float estimator_robust_bin6_inner_re;
    float estimator_robust_bin6_inner_im;
    float estimator_robust_bin6_outer_re;
    float estimator_robust_bin6_outer_im;
    float estimator_robust_bin7_inner_re;
    float estimator_robust_bin7_inner_im;
    float estimator_robust_bin7_outer_re;
    float estimator_robust_bin7_outer_im;
    float estimator_robust_bin8_inner_re;
    float estimator_robust_bin8_inner_im;
    float estimator_robust_bin8_outer_re;
    float estimator_robust_bin8_outer_im;
    float estimator_robust_bin9_inner_re;
    float estimator_robust_bin9_inner_im;
    float estimator_robust_bin9_outer_re;
    float estimator_robust_bin9_outer_im;
    float estimator_robust_bin10_inner_re;
    float estimator_robust_bin10_inner_im;
    float estimator_robust_bin10_outer_re;
    float estimator_robust_bin10_outer_im;
    float estimator_robust_bin11_inner_re;
    float estimator_robust_bin11_inner_im;
    float estimator_robust_bin11_outer_re;
    float estimator_robust_bin11_outer_im;
    float estimator_robust_bin12_inner_re;
    float estimator_robust_bin12_inner_im;
    float estimator_robust_bin12_outer_re;
    float estimator_robust_bin12_outer_im;
    float estimator_robust_bin13_inner_re;
    float estimator_robust_bin13_inner_im;
    float estimator_robust_bin13_outer_re;
    float estimator_robust_bin13_outer_im;
    float estimator_robust_bin14_inner_re;
    float estimator_robust_bin14_inner_im;
    float estimator_robust_bin14_outer_re;
    float estimator_robust_bin14_outer_im;
    float estimator_robust_bin15_inner_re;
    float estimator_robust_bin15_inner_im;
    float estimator_robust_bin15_outer_re;
    float estimator_robust_bin15_outer_im;
    float estimator_robust_bin16_inner_re;
    float estimator_robust_bin16_inner_im;
    float estimator_robust_bin16_outer_re;
    float estimator_robust_bin16_outer_im;
    float estimator_robust_bin17_inner_re;
    float estimator_robust_bin17_inner_im;
    float estimator_robust_bin17_outer_re;
    float estimator_robust_bin17_outer_im;
    float estimator_robust_smooth_hz;
    float estimator_robust_turns;
    float estimator_robust_envelope_m_per_s;
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
extern const float avc_estimate_constants[85];

/* The state of a device that has always rested at a position. */
void avc_estimate_start(avc_estimate_state_t *state, float position_m);

/* One tick. */
void avc_estimate_step(avc_estimate_state_t *state, const avc_estimate_in_t *in, avc_estimate_out_t *out);

#endif
