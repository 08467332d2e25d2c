/* Vector table, reset and tick by SysTick for Cortex-M; board.h names the serial port's interrupt and the core's clock. */
#include "board.h"
#include "cortex_m.h"
#include "hal.h"

extern uint32_t stack_top[], data_start[], data_end[], data_load[], bss_start[], bss_end[];

int main(void);
void reset_handler(void);
void systick_handler(void);

static void fault_handler(void)
{
    for (;;) {
        hal_apply_force(0.0f); /* no force without a control loop; only a reset leads out */
    }
}

void reset_handler(void)
{
    for (uint32_t *to = data_start, *from = data_load; to < data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = bss_start; to < bss_end;) {
        *to++ = 0u;
    }
#if defined(__ARM_FP)
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: the FPU */
    __asm volatile("dsb\n\tisb");
#endif
    (void)main();
}

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

typedef union {
    void (*handler)(void);
    void *address;
} vector_t;

__attribute__((section(".vectors"), used)) static const vector_t vectors[16 + BOARD_INTERRUPTS] = {
    [0] = {.address = stack_top},
    [1] = {reset_handler},
    [2] = {fault_handler},
    [3] = {fault_handler},
    [4] = {fault_handler},
    [5] = {fault_handler},
    [6] = {fault_handler},
    [11] = {fault_handler},
    [14] = {fault_handler},
    [15] = {systick_handler},
    [16 + BOARD_SERIAL_INTERRUPT] = {serial_handler},
};
