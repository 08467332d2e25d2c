#include "avc_feedback.h"

float avc_feedback_step(avc_feedback_state_t *state, const avc_image_t *image, float position_m, float force_n)
{
    const avc_feedback_t *feedback = &image->feedback;
    const uint32_t n = avc_states(&image->header);
    const float *a = feedback->number;
    const float *b = &a[n * n];
    const float *gain = &b[n];
    const float *weight = &gain[n];
    const float half = feedback->dead_zone_m;
    const float seen = position_m + feedback->face_m;
    float believed[AVC_STATES_MAX];
    if (state->started) {
        for (uint32_t row = 0; row < n; row++) {
            float sum = a[row * n] * state->s_m[0];
            for (uint32_t column = 1; column < n; column++) {
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
    for (uint32_t row = 0; row < n; row++) {
        const float value = believed[row] + gain[row] * error;
        state->s_m[row] = value;
        position = row == 0u ? weight[0] * value : position + weight[row] * value;
    }
    return position;
}
