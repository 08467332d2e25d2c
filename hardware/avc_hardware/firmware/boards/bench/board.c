/* A bench in an emulator: at every tick the firmware exchanges a record with a program outside, by semihosting, and waits
 * for it. Position, force and the bytes of the serial line pass in lock step, so that a run depends on no clock.
 *
 * In:  int32 position in counts, uint32 number of bytes, the bytes (at most 64).
 * Out: float force, uint32 timer cycles that the tick took, uint32 number of bytes, the bytes (at most 64). */
#include "board.h"

#include "cortex_m.h"
#include "hal.h"

enum { OPEN = 1, WRITE = 5, READ = 6, EXIT = 24, MODE_READ = 1, MODE_WRITE = 5, LINE_MAX = 64 };

static uint32_t from_plant;
static uint32_t to_plant;
static uint8_t line_out[LINE_MAX];
static volatile uint32_t line_size;
static uint32_t began;

static uint32_t call(uint32_t operation, const uint32_t *parameters)
{
    register uint32_t r0 __asm("r0") = operation;
    register const uint32_t *r1 __asm("r1") = parameters;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t address(const volatile void *of)
{
    return (uint32_t)(uintptr_t)of;
}

static uint32_t open_file(const char *name, uint32_t size, uint32_t mode)
{
    const uint32_t parameters[3] = {address(name), mode, size};
    return call(OPEN, parameters);
}

static void receive(void *to, uint32_t size)
{
    uint8_t *at = to;
    while (size != 0u) {
        const uint32_t parameters[3] = {from_plant, address(at), size};
        const uint32_t left = call(READ, parameters);
        if (left >= size) { /* the program outside has gone */
            (void)call(EXIT, (const uint32_t *)(uintptr_t)0x20026u);
        }
        at += size - left;
        size = left;
    }
}

static void send(const volatile void *from, uint32_t size)
{
    const uint32_t parameters[3] = {to_plant, address(from), size};
    (void)call(WRITE, parameters);
}

void hal_start(void)
{
    to_plant = open_file("to_plant", 8u, MODE_WRITE);
    from_plant = open_file("from_plant", 10u, MODE_READ);
    systick_start((uint32_t)((float)BOARD_CLOCK_HZ * hal_limits.sample_time_s + 0.5f));
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
    began = SYSTICK_VALUE;
    return count;
}

void hal_apply_force(float force_n)
{
    const uint32_t took = began - SYSTICK_VALUE; /* it counts down */
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
    __asm volatile("cpsid i" ::: "memory"); /* the tick empties the line */
    line_out[line_size] = byte;
    line_size = line_size + 1u;
    __asm volatile("cpsie i" ::: "memory");
    return true;
}

void serial_handler(void)
{
}
