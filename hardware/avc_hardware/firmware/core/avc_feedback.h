/* What the wall sees in place of the measured position: a weighted sum of what an observer with a dead zone believes. */
#ifndef AVC_FEEDBACK_H
#define AVC_FEEDBACK_H

#include <stdbool.h>

#include "avc_table.h"

typedef struct {
    bool started;
    float s_m[AVC_STATES_MAX];
} avc_feedback_state_t;

/* One tick, in the order of operations of the scene's step; force_n is that of the tick before, as the actuator gives it.
 * The first tick takes the position as it is, the device at rest. Returns the position that the wall sees. */
float avc_feedback_step(avc_feedback_state_t *state, const avc_image_t *image, float position_m, float force_n);

#endif
