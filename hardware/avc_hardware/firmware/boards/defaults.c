/* A board without enable line, amplifier enable, watchdog, reset cause and a number of its own. */
#include "hal.h"

#define WEAK __attribute__((weak))

WEAK bool hal_enabled(void) { return true; }
WEAK void hal_drive(bool on) { (void)on; }
WEAK uint32_t hal_reset_faults(void) { return 0u; }
WEAK void hal_feed_watchdog(void) {}
WEAK void hal_unique(uint8_t id[12]) { (void)id; }
