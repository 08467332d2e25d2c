/* Generated from the scene's CasADi expressions, do not edit:
 * python -m avc_hardware.firmware_build generate */
#include "avc_figures.h"

const avc_figures_t avc_figures = {
    .hold_s = 0.2f,
    .slew_per_s = 20.0f,
    .guard_damping_ns_per_m = 2.0f,
    .hand_m_per_unit = 1.0f,
    .estimator = 3u,
    .passive = 1u,
};
