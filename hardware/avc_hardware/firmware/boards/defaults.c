/* A board without enable line, amplifier enable, watchdog, reset cause, a number of its own, a timer that tells of a
 * tick too late and one that can be set anew. */
#include "hal.h"

#define WEAK __attribute__((weak))

WEAK bool hal_enabled(void) { return true; }
WEAK void hal_drive(bool on) { (void)on; }
WEAK uint32_t hal_reset_faults(void) { return 0u; }
WEAK void hal_feed_watchdog(void) {}
WEAK void hal_unique(uint8_t id[12]) { (void)id; }
WEAK bool hal_tick_is_due(void) { return false; }
WEAK void hal_set_sample_time(void) {}
