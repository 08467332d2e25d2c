/* Reset, trap and timer of a RISC-V core in machine mode, as QEMU's virt has them. */
#include <stdint.h>

#include "hal.h"
#include "semihosting.h"

#define TIMER_COMPARE ((volatile uint32_t *)0x02004000u)
#define TIMER ((volatile uint32_t *)0x0200BFF8u)

enum { TIMER_HZ = 10000000 };

extern uint32_t bss_start[], bss_end[];

int main(void);
void begin(void);

static uint32_t period;
static uint64_t next;

__asm(".section .start, \"ax\"\n"
      ".globl reset_handler\n"
      "reset_handler:\n"
      "la sp, stack_top\n"
      "j begin\n");

static void compare(uint64_t at)
{
    TIMER_COMPARE[1] = 0xFFFFFFFFu; /* nothing in between is due */
    TIMER_COMPARE[0] = (uint32_t)at;
    TIMER_COMPARE[1] = (uint32_t)(at >> 32);
}

static uint64_t now(void)
{
    uint32_t high, low;
    do {
        high = TIMER[1];
        low = TIMER[0];
    } while (high != TIMER[1]);
    return (uint64_t)high << 32 | low;
}

__attribute__((interrupt("machine"), aligned(4))) static void trap(void)
{
    uintptr_t cause;
    __asm volatile("csrr %0, mcause" : "=r"(cause));
    if ((intptr_t)cause >= 0) { /* a fault of the processor */
        for (;;) {
            hal_apply_force(0.0f);
        }
    }
    next += period;
    compare(next);
    avc_on_tick();
}

void start_ticks(void)
{
    period = (uint32_t)((float)TIMER_HZ * hal_limits.sample_time_s + 0.5f);
    next = now() + period;
    compare(next);
    __asm volatile("csrw mtvec, %0" ::"r"(trap));
    __asm volatile("csrs mie, %0" ::"r"(1u << 7));
    let_ticks();
}

bool hal_tick_is_due(void)
{
    return now() >= next;
}

void begin(void)
{
    __asm volatile("csrs mstatus, %0" ::"r"(1u << 13)); /* the floating-point unit */
    for (uint32_t *to = bss_start; to < bss_end;) {
        *to++ = 0u;
    }
    (void)main();
}
