/* The few core registers that a board needs: SysTick, interrupt enable, priority. */
#ifndef AVC_CORTEX_M_H
#define AVC_CORTEX_M_H

#include "hal.h"

#define REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))

#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define SYSTICK_COUNTED (1u << 16)

static inline void systick_start(void)
{
    hal_set_sample_time();
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = 7u; /* processor clock, interrupt, on */
}

static inline void interrupt_enable(uint32_t number)
{
    /* below SysTick, whose priority is the highest (0) after reset: the control tick is never held up by the link */
    const uint32_t shift = number % 4u * 8u; /* a Cortex-M0 takes whole words alone */
    const uint32_t place = 0xE000E400u + number / 4u * 4u;
    REGISTER(place) = (REGISTER(place) & ~(0xFFu << shift)) | 0x80u << shift;
    REGISTER(0xE000E100u + 4u * (number / 32u)) = 1u << (number % 32u);
}

#endif
