/* The figures of the emulated boards. In a source of its own: an emulated image is given those of its device here. */
#include "hal.h"

const avc_limits_t hal_limits = {
    .sample_time_s = 1e-3f,
    .metres_per_count = 2e-6f,
    .max_force_n = 50.0f,
    .max_damping_ns_per_m = 1e5f,
    .max_stiffness_n_per_m = 1e8f,
    .max_contact_damping_ns_per_m = 1e4f,
};
