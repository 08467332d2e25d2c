#include "avc_feedback.h"

/* 1: a step for each number of states, without loops: half of the instructions, 4 KB of flash; of no use for floats
 * in software. */
#ifndef AVC_UNROLLED
#if defined(__SOFTFP__) || defined(__riscv_float_abi_soft)
#define AVC_UNROLLED 0
#else
#define AVC_UNROLLED 1
#endif
#endif

#if AVC_UNROLLED && defined(__GNUC__) && !defined(__clang__)
#define UNROLLED _Pragma("GCC unroll 8")
#else
#define UNROLLED
#endif

static inline float step_of(const uint32_t n, avc_feedback_state_t *state, const avc_feedback_t *feedback,
                            float position_m, float force_n)
{
    const float *a = feedback->number;
    const float *b = &a[n * n];
    const float *gain = &b[n];
    const float *weight = &gain[n];
    const float half = feedback->dead_zone_m;
    const float seen = position_m + feedback->face_m;
    float believed[AVC_STATES_MAX];
    if (state->started) {
        UNROLLED for (uint32_t row = 0; row < n; row++) {
            float sum = a[row * n] * state->s_m[0];
            UNROLLED for (uint32_t column = 1; column < n; column++) {
                sum = sum + a[row * n + column] * state->s_m[column];
            }
            believed[row] = b[row] * force_n + sum;
        }
    } else {
        for (uint32_t row = 0; row < n; row++) {
            believed[row] = ((uint32_t)feedback->positions >> row & 1u) != 0u ? seen : 0.0f;
        }
        state->started = true;
    }
    float error = seen - believed[feedback->measures];
    const float above = error > -half ? error : -half;
    error = error - (above < half ? above : half);
    float position = 0.0f;
    UNROLLED for (uint32_t row = 0; row < n; row++) {
        const float value = believed[row] + gain[row] * error;
        state->s_m[row] = value;
        position = row == 0u ? weight[0] * value : position + weight[row] * value;
    }
    return position;
}

float avc_feedback_step(avc_feedback_state_t *state, const avc_image_t *image, float position_m, float force_n)
{
    const avc_feedback_t *feedback = &image->feedback;
    const uint32_t n = avc_states(&image->header);
#if AVC_UNROLLED
    switch (n) {
    case 1:
        return step_of(1, state, feedback, position_m, force_n);
    case 2:
        return step_of(2, state, feedback, position_m, force_n);
    case 3:
        return step_of(3, state, feedback, position_m, force_n);
    case 4:
        return step_of(4, state, feedback, position_m, force_n);
    case 5:
        return step_of(5, state, feedback, position_m, force_n);
    case 6:
        return step_of(6, state, feedback, position_m, force_n);
    case 7:
        return step_of(7, state, feedback, position_m, force_n);
    default:
        return step_of(8, state, feedback, position_m, force_n);
    }
#else
    return step_of(n, state, feedback, position_m, force_n);
#endif
}
