/* The tick of a Cortex-M by SysTick, which board.h gives the clock of. */
#include "avc_made_for.h"
#include "board.h"
#include "cortex_m.h"
#include "hal.h"

_Static_assert((uint64_t)BOARD_CLOCK_HZ * AVC_MADE_FOR_SAMPLE_TIME_NS / 1000000000u <= 0x1000000u,
               "the sample time is longer than SysTick counts at this clock");

void systick_handler(void);
void systick_handler(void)
{
    (void)SYSTICK_CONTROL; /* clears its flag */
    avc_on_tick();
}

bool hal_tick_is_due(void)
{
    return (SYSTICK_CONTROL & SYSTICK_COUNTED) != 0u;
}
