/* Arm MPS2 with the AN386 image (Cortex-M4F), as QEMU emulates it: UART0 only; encoder and force are variables that a
 * debugger or a test may use. */
#include "board.h"

#include "cortex_m.h"
#include "hal.h"

#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u)
#define UART_CONTROL REGISTER(0x40004008u)
#define UART_INTERRUPT REGISTER(0x4000400Cu)
#define UART_DIVIDER REGISTER(0x40004010u)

enum { TRANSMIT_FULL = 1, RECEIVE_FULL = 2, RECEIVE_OVERRUN = 8 };

volatile int32_t bench_encoder_count;
volatile float bench_force_n;

void hal_start(void)
{
    UART_DIVIDER = (BOARD_CLOCK_HZ + BOARD_BAUD / 2u) / BOARD_BAUD;
    UART_CONTROL = 1u | 2u | 8u; /* transmit, receive, receive interrupt */
    interrupt_enable(BOARD_SERIAL_INTERRUPT);
    systick_start((uint32_t)((float)BOARD_CLOCK_HZ * hal_limits.sample_time_s + 0.5f));
}

int32_t hal_encoder_count(void)
{
    return bench_encoder_count;
}

void hal_apply_force(float force_n)
{
    bench_force_n = force_n;
}

bool hal_send(uint8_t byte)
{
    if ((UART_STATE & TRANSMIT_FULL) != 0u) {
        return false;
    }
    UART_DATA = byte;
    return true;
}

void serial_handler(void)
{
    /* Acknowledge before reading: a byte that comes in between raises the interrupt again instead of being forgotten. */
    UART_INTERRUPT = 2u;
    while ((UART_STATE & RECEIVE_FULL) != 0u) {
        avc_on_byte((uint8_t)UART_DATA);
    }
    if ((UART_STATE & RECEIVE_OVERRUN) != 0u) {
        UART_STATE = RECEIVE_OVERRUN;
        avc_on_byte_lost();
    }
}
