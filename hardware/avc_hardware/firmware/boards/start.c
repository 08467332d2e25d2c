/* Vector table and reset for Cortex-M; board.h names the serial port's interrupt. */
#include <stdint.h>

#include "board.h"
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
