/* Series coupling between the device and a one-sided wall at position 0, with the contact damper b_p: the force law of
 * the scenes. avc_coupling.c is generated from the scene's expressions. */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#include "avc_table.h"

typedef struct {
    float coupling_deflection_before_m;    /* device minus tool */
    float environment_deflection_before_m; /* of the wall's surface */
    float contact_depth_before_m;          /* of the device, for b_p */
    float tool_m;                          /* inside the wall where > 0 */
} avc_coupling_t;

/* One sample: the force on the device in newtons, positive out of the wall; moves the state. */
float avc_coupling_step(avc_coupling_t *state, float position_m, const avc_gains_t *gains,
                        float wall_damping_ns_per_m, float wall_stiffness_n_per_m, float sample_time_s);

#endif
