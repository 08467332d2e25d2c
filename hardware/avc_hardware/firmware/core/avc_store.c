#include "avc_store.h"

#include <stddef.h>

#include "avc_crc32.h"

typedef struct {
    uint32_t magic; /* written last */
    uint32_t number;
    uint32_t size; /* of what follows the head */
    uint32_t crc32; /* of number, size, and that */
} avc_slot_t;

static const uint32_t magic = 0x31435641u;

__attribute__((weak)) uint32_t hal_flash_size(void)
{
    return 0u;
}

__attribute__((weak)) void hal_flash_read(uint32_t slot, uint32_t offset, void *to, uint32_t size)
{
    (void)slot;
    (void)offset;
    memset(to, 0xFF, size);
}

__attribute__((weak)) bool hal_flash_erase(uint32_t slot)
{
    (void)slot;
    return false;
}

__attribute__((weak)) bool hal_flash_write(uint32_t slot, uint32_t offset, uint32_t word)
{
    (void)slot;
    (void)offset;
    (void)word;
    return false;
}

static bool whole(uint32_t slot, avc_slot_t *head)
{
    hal_flash_read(slot, 0u, head, sizeof *head);
    if (head->magic != magic || head->number == 0u || head->size < sizeof(avc_kept_t) ||
        head->size > sizeof(avc_kept_t) + sizeof(avc_image_t) || head->size > hal_flash_size() - sizeof *head) {
        return false;
    }
    uint32_t crc = avc_crc32(0u, (const uint8_t *)&head->number, sizeof head->number + sizeof head->size);
    uint8_t part[64];
    for (uint32_t at = 0u; at < head->size; at += (uint32_t)sizeof part) {
        const uint32_t left = head->size - at;
        const uint32_t size = left < sizeof part ? left : (uint32_t)sizeof part;
        hal_flash_read(slot, (uint32_t)sizeof *head + at, part, size);
        crc = avc_crc32(crc, part, size);
    }
    return crc == head->crc32;
}

uint32_t avc_store_load(avc_kept_t *kept, uint32_t *slot)
{
    avc_slot_t heads[2];
    if (hal_flash_size() < sizeof heads[0] + sizeof *kept) {
        return 0u;
    }
    const bool first = whole(0u, &heads[0]);
    const bool second = whole(1u, &heads[1]);
    if (!first && !second) {
        return 0u;
    }
    const uint32_t ahead = heads[1].number - heads[0].number; /* wraps rightly */
    *slot = second && (!first || (ahead != 0u && ahead <= 0x7FFFFFFFu)) ? 1u : 0u;
    hal_flash_read(*slot, (uint32_t)sizeof heads[0], kept, sizeof *kept);
    if (kept->table_size != heads[*slot].size - sizeof *kept) {
        return 0u;
    }
    return heads[*slot].number;
}

void avc_store_table(uint32_t slot, uint32_t offset, void *to, uint32_t size)
{
    hal_flash_read(slot, (uint32_t)(sizeof(avc_slot_t) + sizeof(avc_kept_t)) + offset, to, size);
}

static bool write(uint32_t slot, uint32_t offset, const void *from, uint32_t size)
{
    for (uint32_t at = 0u; at < size; at += 4u) {
        uint32_t word;
        memcpy(&word, (const uint8_t *)from + at, sizeof word);
        if (!hal_flash_write(slot, offset + at, word)) {
            return false;
        }
    }
    return true;
}

bool avc_store_save(const avc_kept_t *kept, const avc_image_t *image)
{
    avc_kept_t before;
    uint32_t slot = 1u;
    const uint32_t number = avc_store_load(&before, &slot) + 1u;
    const uint32_t to = 1u - slot;
    avc_slot_t head = {magic, number != 0u ? number : 1u, (uint32_t)sizeof *kept + kept->table_size, 0u};
    if (hal_flash_size() < sizeof head + head.size) {
        return false;
    }
    head.crc32 = avc_crc32(0u, (const uint8_t *)&head.number, sizeof head.number + sizeof head.size);
    head.crc32 = avc_crc32(head.crc32, (const uint8_t *)kept, sizeof *kept);
    head.crc32 = avc_crc32(head.crc32, (const uint8_t *)image, kept->table_size);
    const uint32_t rest = (uint32_t)offsetof(avc_slot_t, number);
    const bool wrote = hal_flash_erase(to) && write(to, (uint32_t)sizeof head, kept, sizeof *kept) &&
                       write(to, (uint32_t)(sizeof head + sizeof *kept), image, kept->table_size) &&
                       write(to, rest, (const uint8_t *)&head + rest, (uint32_t)sizeof head - rest) &&
                       write(to, 0u, &head, rest);
    avc_slot_t found;
    return wrote && whole(to, &found) && found.number == head.number;
}
