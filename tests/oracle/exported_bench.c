/* The exported coupling on a bare processor: takes positions.h, prints the bits of every force, then stack and time.
 *
 * One line of 8 hexadecimal digits a sample; every stroke begins with a start. Then, in hexadecimal too, "stack" (bytes,
 * the deepest step), "cycles" (the longest step; 0 where they are not counted) and "state" (bytes).
 */
#include <stdint.h>

#include "avc_coupling.h"
#include "positions.h" /* STROKES, SAMPLES, positions[STROKES * SAMPLES] (bits) IN_FLASH, bits_at(i) */

#if defined(__AVR__)
enum { PAINT_BYTES = 1024 };
#else
enum { PAINT_BYTES = 4096 };
#endif
static const unsigned char PAINT = 0xa5u;

#if defined(__AVR__)
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

static void put(char letter)
{
    while ((UCSR0A & (1 << UDRE0)) == 0) {
    }
    UDR0 = (uint8_t)letter;
}

static void begin(void)
{
    UCSR0B = 1 << TXEN0;
    TCCR1B = 1 << CS11; /* a count is 8 cycles */
}

static void end(void)
{
    cli();
    sleep_enable();
    sleep_cpu();
    for (;;) {
    }
}

static volatile unsigned char *stack_pointer(void)
{
    return (volatile unsigned char *)SP;
}

#elif defined(__arm__)
static long semihost(long operation, const void *argument)
{
    register long r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void put(char letter)
{
    semihost(3, &letter);
}

static void begin(void)
{
#if defined(__ARM_FP)
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    __asm__ volatile("dsb\n isb");
#endif
}

static void end(void)
{
    semihost(0x18, (const void *)0x20026);
}

static inline volatile unsigned char *stack_pointer(void)
{
    volatile unsigned char *place;
    __asm__ volatile("mov %0, sp" : "=r"(place));
    return place;
}

extern char stack_top[];
int main(void);
__attribute__((section(".vectors"), used)) static const void *const vectors[] = {stack_top, (const void *)main};

#elif defined(__riscv)
__asm__(".section .vectors, \"ax\"\n"
        ".globl start\n"
        "start: la sp, stack_top\n"
        "    li t0, 0x2000\n" /* floats on */
        "    csrs mstatus, t0\n"
        "    call main\n"
        ".text\n");

static void put(char letter)
{
    *(volatile uint8_t *)0x10000000u = (uint8_t)letter;
}

static void begin(void)
{
}

static void end(void)
{
    *(volatile uint32_t *)0x100000u = 0x5555u;
}

static inline volatile unsigned char *stack_pointer(void)
{
    volatile unsigned char *place;
    __asm__ volatile("mv %0, sp" : "=r"(place));
    return place;
}
#endif

static void print_word(const char *word)
{
    while (*word != '\0') {
        put(*word++);
    }
}

static void print_hex(uint32_t value)
{
    for (int digit = 7; digit >= 0; digit--) {
        const unsigned int nibble = (unsigned int)(value >> (4 * digit)) & 15u;
        put((char)(nibble < 10u ? '0' + (int)nibble : 'a' + (int)nibble - 10));
    }
    put('\n');
}

static uint32_t deepest, longest;
static avc_coupling_t coupling;

/* One step on a painted stack; nothing interrupts. */
__attribute__((noinline)) static float measured_step(float position_m)
{
    volatile unsigned char *const top = stack_pointer();
    volatile unsigned char *place;
    for (place = top - PAINT_BYTES; place < top; place++) {
        *place = PAINT;
    }
#if defined(__AVR__)
    TCNT1 = 0;
#endif
    const float force_n = avc_coupling_step(&coupling, position_m);
#if defined(__AVR__)
    const uint32_t took = 8u * (uint32_t)TCNT1;
    longest = took > longest ? took : longest;
#endif
    for (place = top - PAINT_BYTES; *place == PAINT && place < top; place++) {
    }
    deepest = (uint32_t)(top - place) > deepest ? (uint32_t)(top - place) : deepest;
    return force_n;
}

int main(void)
{
    union {
        uint32_t bits;
        float number;
    } value;
    begin();
    for (unsigned int stroke = 0u; stroke < STROKES; stroke++) {
        avc_coupling_start(&coupling);
        for (unsigned int at = 0u; at < SAMPLES; at++) {
            value.bits = bits_at(stroke * SAMPLES + at);
            value.number = measured_step(value.number);
            print_hex(value.bits);
        }
    }
    print_word("stack ");
    print_hex(deepest);
    print_word("cycles ");
    print_hex(longest);
    print_word("state ");
    print_hex((uint32_t)sizeof(coupling));
    end();
    return 0;
}
