/* Semihosting and the tick of a Cortex-M; the board has told its BOARD_CLOCK_HZ. */
#ifndef AVC_SEMIHOSTING_H
#define AVC_SEMIHOSTING_H

#include "cortex_m.h"
#include "hal.h"

static inline uintptr_t semihost(uint32_t operation, const uintptr_t *parameters)
{
    register uintptr_t r0 __asm("r0") = operation;
    register const uintptr_t *r1 __asm("r1") = parameters;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static inline void start_ticks(void)
{
    systick_start();
}

static inline void hold_ticks(void)
{
    __asm volatile("cpsid i" ::: "memory");
}

static inline void let_ticks(void)
{
    __asm volatile("cpsie i" ::: "memory");
}

static inline uint32_t timer_value(void)
{
    return SYSTICK_VALUE;
}

#endif
