/* A board without enable line, amplifier enable, watchdog, reset cause, a number of its own, a timer that tells of a
 * tick too late and one that can be set anew. */
#include "hal.h"

__attribute__((weak)) bool hal_enabled(void)
{
    return true;
}

__attribute__((weak)) void hal_drive(bool on)
{
    (void)on;
}

__attribute__((weak)) uint32_t hal_reset_faults(void)
{
    return 0u;
}

__attribute__((weak)) void hal_feed_watchdog(void)
{
}

__attribute__((weak)) void hal_unique(uint8_t id[12])
{
    (void)id;
}

__attribute__((weak)) bool hal_tick_is_due(void)
{
    return false;
}

__attribute__((weak)) void hal_set_sample_time(void)
{
}
