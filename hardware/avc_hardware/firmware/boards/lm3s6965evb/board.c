/* TI Stellaris LM3S6965 (Cortex-M3, floats in software), as QEMU emulates it: UART0 only; encoder and force are variables
 * that a debugger or a test may use. */
#include "board.h"

#include "cortex_m.h"
#include "hal.h"

#define UART_DATA REGISTER(0x4000C000u)
#define UART_ERROR REGISTER(0x4000C004u)
#define UART_FLAGS REGISTER(0x4000C018u)
#define UART_DIVIDER REGISTER(0x4000C024u)
#define UART_FRACTION REGISTER(0x4000C028u)
#define UART_LINE REGISTER(0x4000C02Cu)
#define UART_CONTROL REGISTER(0x4000C030u)
#define UART_MASK REGISTER(0x4000C038u)
#define UART_CLEAR REGISTER(0x4000C044u)

enum { RECEIVE_EMPTY = 1 << 4, TRANSMIT_FULL = 1 << 5, LOST = 1 << 11 };

volatile int32_t bench_encoder_count;
volatile float bench_force_n;

void hal_start(void)
{
    const uint32_t divider = (BOARD_CLOCK_HZ * 4u + BOARD_BAUD / 2u) / BOARD_BAUD; /* in 64ths of 16 clocks */
    UART_CONTROL = 0u;
    UART_DIVIDER = divider / 64u;
    UART_FRACTION = divider % 64u;
    UART_LINE = 3u << 5; /* 8 bits, no FIFO: an interrupt a byte */
    UART_MASK = 1u << 4;
    UART_CONTROL = 1u | (1u << 8) | (1u << 9);
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
    if ((UART_FLAGS & TRANSMIT_FULL) != 0u) {
        return false;
    }
    UART_DATA = byte;
    return true;
}

void serial_handler(void)
{
    UART_CLEAR = 1u << 4;
    while ((UART_FLAGS & RECEIVE_EMPTY) == 0u) {
        const uint32_t data = UART_DATA;
        avc_on_byte((uint8_t)data);
        if ((data & LOST) != 0u) {
            UART_ERROR = 0u;
            avc_on_byte_lost();
        }
    }
}
