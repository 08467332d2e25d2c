/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
/* sample_time_s 0.001, metres_per_count 2e-06, estimator any, hold_s 0.2, slew_per_s 20.0, passive True, guard_damping_ns_per_m 2.0, hand_m_per_unit 1.0 */
#include "avc_guard.h"
#include "avc_made_for.h"

_Static_assert(AVC_MADE_FOR_SAMPLE_TIME_NS == 1000000 &&
                   AVC_MADE_FOR_COUNT_PM == 2000000,
               "these numbers are made for another sample time or encoder");

const float avc_guard_constants[1] = {
    2000.0f,
};
