/* The board's own figures. In a source of its own: an emulated image is given those of its device here. */
#include "avc_made_for.h"
#include "hal.h"

const avc_limits_t hal_limits = {
    .sample_time_s = AVC_MADE_FOR_SAMPLE_TIME_S,
    .metres_per_count = AVC_MADE_FOR_COUNT_M,
    .max_force_n = AVC_MADE_FOR_MAX_FORCE_N,
    .max_damping_ns_per_m = AVC_MADE_FOR_MAX_DAMPING_NS_PER_M,
    .max_stiffness_n_per_m = AVC_MADE_FOR_MAX_STIFFNESS_N_PER_M,
    .max_contact_damping_ns_per_m = AVC_MADE_FOR_MAX_CONTACT_DAMPING_NS_PER_M,
    .max_speed_m_per_s = AVC_MADE_FOR_MAX_SPEED_M_PER_S,
    .max_acceleration_m_per_s2 = AVC_MADE_FOR_MAX_ACCELERATION_M_PER_S2,
    .max_energy_j = AVC_MADE_FOR_MAX_ENERGY_J,
    .stuck_swing_n = AVC_MADE_FOR_STUCK_SWING_N,
    .max_overruns = AVC_MADE_FOR_MAX_OVERRUNS,
};
