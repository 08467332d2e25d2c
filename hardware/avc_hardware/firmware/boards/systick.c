/* The tick of a Cortex-M by SysTick, which board.h gives the clock of. */
#include "board.h"
#include "cortex_m.h"
#include "hal.h"

void systick_handler(void);
void systick_handler(void)
{
    (void)SYSTICK_CONTROL; /* clears its flag */
    avc_on_tick();
}

void hal_set_sample_time(void)
{
    SYSTICK_RELOAD = (uint32_t)((float)BOARD_CLOCK_HZ * hal_limits()->sample_time_s + 0.5f) - 1u;
}

bool hal_tick_is_due(void)
{
    return (SYSTICK_CONTROL & SYSTICK_COUNTED) != 0u;
}
