/* A bench in an emulator: at every tick the firmware exchanges a record with a program outside, by semihosting, and waits
 * for it. Position, force and the bytes of the serial line pass in lock step, so that a run depends on no clock.
 *
 * In:  int32 position in counts, uint32 number of bytes, the bytes (at most 64).
 * Out: float force, uint32 timer cycles that the tick took, uint32 number of bytes, the bytes (at most 64).
 *
 * For one source of a board, which brings semihost, start_ticks, hold_ticks, let_ticks and timer_value of its processor. */
#ifndef AVC_LOCK_STEP_H
#define AVC_LOCK_STEP_H

#include "hal.h"

enum { OPEN = 1, WRITE = 5, READ = 6, EXIT = 24, MODE_READ = 1, MODE_WRITE = 5, LINE_MAX = 64 };

static uintptr_t from_plant;
static uintptr_t to_plant;
static uint8_t line_out[LINE_MAX];
static volatile uint32_t line_size;
static uint32_t began;

static uintptr_t open_file(const char *name, uint32_t size, uint32_t mode)
{
    const uintptr_t parameters[3] = {(uintptr_t)name, mode, size};
    return semihost(OPEN, parameters);
}

static void receive(void *to, uint32_t size)
{
    uint8_t *at = to;
    while (size != 0u) {
        const uintptr_t parameters[3] = {from_plant, (uintptr_t)at, size};
        const uint32_t left = (uint32_t)semihost(READ, parameters);
        if (left >= size) { /* the program outside has gone */
            (void)semihost(EXIT, (const uintptr_t *)0x20026u);
        }
        at += size - left;
        size = left;
    }
}

static void send(const volatile void *from, uint32_t size)
{
    const uintptr_t parameters[3] = {to_plant, (uintptr_t)from, size};
    (void)semihost(WRITE, parameters);
}

void hal_start(void)
{
    to_plant = open_file("to_plant", 8u, MODE_WRITE);
    from_plant = open_file("from_plant", 10u, MODE_READ);
    start_ticks();
}

int32_t hal_encoder_count(void)
{
    int32_t count;
    uint32_t size;
    uint8_t line_in[LINE_MAX];
    receive(&count, sizeof count);
    receive(&size, sizeof size);
    receive(line_in, size);
    for (uint32_t i = 0; i < size; i++) {
        avc_on_byte(line_in[i]);
    }
    began = timer_value();
    return count;
}

void hal_apply_force(float force_n)
{
    const uint32_t took = began - timer_value(); /* it counts down */
    const uint32_t size = line_size;
    send(&force_n, sizeof force_n);
    send(&took, sizeof took);
    send(&size, sizeof size);
    send(line_out, size);
    line_size = 0u;
}

bool hal_send(uint8_t byte)
{
    if (line_size >= LINE_MAX) {
        return false;
    }
    hold_ticks(); /* the tick empties the line */
    line_out[line_size] = byte;
    line_size = line_size + 1u;
    let_ticks();
    return true;
}

void serial_handler(void)
{
}

#endif
