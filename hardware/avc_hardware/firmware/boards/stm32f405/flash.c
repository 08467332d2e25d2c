/* The memory that lasts of an STM32F405: the last two sectors of its flash, 128 KB each, a slot each.
 *
 * The flash cannot be read while it erases (1 s, at most 2): what runs then is in memory, so that the watchdog is fed and no
 * count of the encoder is lost. Ticks wait until then; no force is given. */
#include <string.h>

#include "avc_store.h"
#include "board.h"
#include "cortex_m.h"
#include "hal.h"

#define FLASH_ACCESS REGISTER(0x40023C00u)
#define FLASH_KEY REGISTER(0x40023C04u)
#define FLASH_STATUS REGISTER(0x40023C0Cu)
#define FLASH_CONTROL REGISTER(0x40023C10u)

enum { SLOT_SIZE = 0x20000, FIRST_SLOT = 0x080C0000, FIRST_SECTOR = 10 };
enum { WRONG = 0xF2, BUSY = 1 << 16 };
enum { PROGRAM = 1 << 0, ERASE_SECTOR = 1 << 1, SECTOR = 3, BY_WORDS = 2 << 8, START = 1 << 16 };
enum { DATA_CACHE = 1 << 10, FORGET_DATA = 1 << 12 };
static const uint32_t lock = 1u << 31;

/* It is locked between two operations: a board that says otherwise has no such controller, as in QEMU. */
uint32_t hal_flash_size(void)
{
    return (FLASH_CONTROL & lock) != 0u ? (uint32_t)SLOT_SIZE : 0u;
}

static uint32_t address(uint32_t slot, uint32_t offset)
{
    return (uint32_t)FIRST_SLOT + slot * (uint32_t)SLOT_SIZE + offset;
}

void hal_flash_read(uint32_t slot, uint32_t offset, void *to, uint32_t size)
{
    memcpy(to, (const void *)(uintptr_t)address(slot, offset), size);
}

static void unlock(void)
{
    FLASH_KEY = 0x45670123u;
    FLASH_KEY = 0xCDEF89ABu;
    FLASH_STATUS = WRONG; /* of an operation before */
}

/* Lock it; whether nothing went wrong. */
static bool end(void)
{
    const bool right = (FLASH_STATUS & WRONG) == 0u;
    FLASH_CONTROL = lock;
    return right;
}

BOARD_IN_MEMORY static void erase(uint32_t control)
{
    __asm volatile("cpsid i" ::: "memory"); /* what handles an interrupt is in the flash */
    FLASH_CONTROL = control;
    FLASH_CONTROL = control | (uint32_t)START;
    while ((FLASH_STATUS & BUSY) != 0u) {
        hal_feed_watchdog();
        (void)hal_encoder_count();
    }
    __asm volatile("cpsie i" ::: "memory");
}

bool hal_flash_erase(uint32_t slot)
{
    unlock();
    erase((uint32_t)ERASE_SECTOR | ((uint32_t)FIRST_SECTOR + slot) << SECTOR | (uint32_t)BY_WORDS);
    const uint32_t access = FLASH_ACCESS;
    FLASH_ACCESS = access & ~(uint32_t)DATA_CACHE; /* it forgets what was there while it is off alone */
    FLASH_ACCESS = (access & ~(uint32_t)DATA_CACHE) | (uint32_t)FORGET_DATA;
    FLASH_ACCESS = access;
    return end();
}

bool hal_flash_write(uint32_t slot, uint32_t offset, uint32_t word)
{
    unlock();
    FLASH_CONTROL = (uint32_t)PROGRAM | (uint32_t)BY_WORDS; /* from 2.7 V on */
    REGISTER(address(slot, offset)) = word;
    while ((FLASH_STATUS & BUSY) != 0u) {
    }
    hal_feed_watchdog(); /* a table is a thousand words, the main loop waits for them */
    return end();
}
