/* STM32F405: USART1 (PA9, PA10), encoder on TIM8 (PC6, PC7), force on DAC channel 1 (PA4), enable line in on PB0 (low:
 * enabled), amplifier enable out on PB1, independent watchdog. */
#include "board.h"

#include <string.h>

#include "avc_fault.h"
#include "cortex_m.h"
#include "hal.h"

#define USART1_STATUS REGISTER(0x40011000u)
#define USART1_DATA REGISTER(0x40011004u)
#define USART1_RATE REGISTER(0x40011008u)
#define USART1_CONTROL REGISTER(0x4001100Cu)
#define TIM8_CONTROL REGISTER(0x40010400u)
#define TIM8_SLAVE_MODE REGISTER(0x40010408u)
#define TIM8_CAPTURE REGISTER(0x40010418u)
#define TIM8_COUNT REGISTER(0x40010424u)
#define TIM8_RELOAD REGISTER(0x4001042Cu)
#define DAC_CONTROL REGISTER(0x40007400u)
#define DAC_VALUE REGISTER(0x40007408u)

#define GPIOB_INPUT REGISTER(0x40020410u)
#define GPIOB_SET REGISTER(0x40020418u)
#define WATCHDOG_KEY REGISTER(0x40003000u)
#define WATCHDOG_PRESCALER REGISTER(0x40003004u)
#define WATCHDOG_RELOAD REGISTER(0x40003008u)
#define RCC_RESETS REGISTER(0x40023874u)
#define FLASH_ACCESS REGISTER(0x40023C00u)
#define RCC_CONTROL REGISTER(0x40023800u)
#define RCC_PLL REGISTER(0x40023804u)
#define RCC_CONFIG REGISTER(0x40023808u)
#define RCC_AHB1 REGISTER(0x40023830u)
#define RCC_APB1 REGISTER(0x40023840u)
#define RCC_APB2 REGISTER(0x40023844u)
#define GPIOA_MODE REGISTER(0x40020000u)
#define GPIOA_ALTERNATE_HIGH REGISTER(0x40020024u)
#define GPIOB_MODE REGISTER(0x40020400u)
#define GPIOB_PULL REGISTER(0x4002040Cu)
#define GPIOC_MODE REGISTER(0x40020800u)
#define GPIOC_ALTERNATE_LOW REGISTER(0x40020820u)

enum { ENABLE_OPEN = 1 << 0, DRIVE = 1 << 1, OSCILLATOR_READY = 1 << 1 };
enum { BY_WATCHDOG = 3 << 29, BY_POWER_ON = 1 << 27, BY_BROWN_OUT = 1 << 25, FORGET = 1 << 24 };
enum { RECEIVED = 1 << 5, OVERRUN = 1 << 3, TRANSMIT_EMPTY = 1 << 7 };

static int32_t count;

/* 168 MHz from the internal oscillator, so that any board will do; emulators have neither clocks nor pins. */
static bool is_real(void)
{
    return (RCC_CONTROL & OSCILLATOR_READY) != 0u;
}

static void start_clocks(void)
{
    FLASH_ACCESS = 0x705u; /* 5 wait states, caches and prefetch */
    RCC_PLL = 16u | (336u << 6) | (0u << 16) | (7u << 24); /* 16 MHz / 16 * 336 / 2 */
    RCC_CONTROL |= 1u << 24;
    while ((RCC_CONTROL & (1u << 25)) == 0u) {
    }
    RCC_CONFIG = (5u << 10) | (4u << 13); /* APB1 a quarter, APB2 half */
    RCC_CONFIG |= 2u;
    while ((RCC_CONFIG & 0xCu) != 0x8u) {
    }
    RCC_AHB1 |= (1u << 0) | (1u << 1) | (1u << 2); /* GPIOA, GPIOB, GPIOC */
    RCC_APB1 |= 1u << 29;               /* DAC */
    RCC_APB2 |= (1u << 4) | (1u << 1);  /* USART1, TIM8 */
    GPIOA_MODE = (GPIOA_MODE & ~((3u << 8) | (15u << 18))) | (3u << 8) | (10u << 18); /* PA4 analogue, PA9/10 USART1 */
    GPIOA_ALTERNATE_HIGH = (GPIOA_ALTERNATE_HIGH & ~0xFF0u) | 0x770u;
    GPIOB_PULL = (GPIOB_PULL & ~3u) | 1u;         /* PB0 up */
    GPIOB_MODE = (GPIOB_MODE & ~15u) | (1u << 2); /* PB0 input, PB1 output */
    GPIOC_MODE = (GPIOC_MODE & ~(15u << 12)) | (10u << 12); /* PC6, PC7: TIM8 */
    GPIOC_ALTERNATE_LOW = (GPIOC_ALTERNATE_LOW & ~0xFF000000u) | 0x33000000u;
}

void hal_unique(uint8_t id[12])
{
    if (is_real()) {
        const uint32_t words[3] = {REGISTER(0x1FFF7A10u), REGISTER(0x1FFF7A14u), REGISTER(0x1FFF7A18u)};
        memcpy(id, words, sizeof words);
    }
}

void hal_start(void)
{
    if (is_real()) {
        start_clocks();
    }
    TIM8_CAPTURE = 0x0101u; /* both channels as inputs */
    TIM8_SLAVE_MODE = 3u;   /* quadrature, both edges */
    TIM8_RELOAD = 0xFFFFu;
    TIM8_CONTROL = 1u;
    DAC_CONTROL = 3u; /* on, without its buffer, which ends 0.2 V before either rail */
    hal_apply_force(0.0f);
    USART1_RATE = (BOARD_CLOCK_HZ / 2u + BOARD_BAUD / 2u) / BOARD_BAUD; /* APB2 runs at half the core's clock */
    USART1_CONTROL = (1u << 13) | (1u << 5) | (1u << 3) | (1u << 2);    /* on, receive interrupt, both ways */
    interrupt_enable(BOARD_SERIAL_INTERRUPT);
    WATCHDOG_KEY = 0x5555u; /* 32 kHz / 4, 400 of them: 50 ms */
    WATCHDOG_PRESCALER = 0u;
    WATCHDOG_RELOAD = 399u;
    WATCHDOG_KEY = 0xCCCCu;
    systick_start();
}

bool hal_enabled(void)
{
    return (GPIOB_INPUT & ENABLE_OPEN) == 0u; /* a broken wire is pulled up: not enabled */
}

void hal_drive(bool on)
{
    static bool driven;
    if (on != driven) {
        driven = on;
        GPIOB_SET = on ? (uint32_t)DRIVE : (uint32_t)DRIVE << 16;
    }
}

uint32_t hal_reset_faults(void)
{
    const uint32_t why = RCC_RESETS;
    RCC_RESETS = FORGET;
    uint32_t codes = (why & BY_WATCHDOG) != 0u ? (uint32_t)AVC_FAULT_WATCHDOG : 0u;
    if ((why & (BY_POWER_ON | BY_BROWN_OUT)) == BY_BROWN_OUT) {
        codes |= AVC_FAULT_BROWN_OUT; /* switching on sets both */
    }
    return codes;
}

void hal_feed_watchdog(void)
{
    WATCHDOG_KEY = 0xAAAAu;
}

int32_t hal_encoder_count(void)
{
    /* the counter has 16 bits: 65 mm at 2 um; movement within a tick is far less */
    const int16_t moved = (int16_t)(uint16_t)(TIM8_COUNT - (uint32_t)count);
    count += moved;
    return count;
}

void hal_apply_force(float force_n)
{
    DAC_VALUE = (uint32_t)(int32_t)(2048.0f + 2047.0f * (force_n / hal_limits()->max_force_n) + 0.5f);
}

bool hal_send(uint8_t byte)
{
    if ((USART1_STATUS & TRANSMIT_EMPTY) == 0u) {
        return false;
    }
    USART1_DATA = byte;
    return true;
}

void serial_handler(void)
{
    if ((USART1_STATUS & (RECEIVED | OVERRUN)) != 0u) {
        avc_on_byte((uint8_t)USART1_DATA); /* which clears both */
    }
}
