/* What a device keeps over a reset: its name, its limits at run time, and a coupling, which may act after a reset.
 *
 * Two slots in a memory that lasts. The newest whole one counts; the other one is erased and written, its first word last.
 * Wherever the power is cut, the one before or the new one is whole. */
#ifndef AVC_STORE_H
#define AVC_STORE_H

#include <stdbool.h>
#include <stdint.h>

#include "avc_control.h"

enum { AVC_NAME_SIZE = 16, AVC_KEEPS_COUPLING = 1, AVC_COUPLING_ACTS = 2 };

/* Begins what a slot holds; a table's bytes follow. */
typedef struct {
    uint32_t flags;
    avc_lowered_t lowered;
    char name[AVC_NAME_SIZE];
    uint32_t table_id;
    uint32_t table_size;
} avc_kept_t;

/* A board with such a memory gives these; the core stands for a board without. */
uint32_t hal_flash_size(void); /* bytes of each of the two slots */
void hal_flash_read(uint32_t slot, uint32_t offset, void *to, uint32_t size);
bool hal_flash_erase(uint32_t slot); /* all bits to 1; no tick need come meanwhile, and no force is given */
bool hal_flash_write(uint32_t slot, uint32_t offset, uint32_t word); /* of an erased word, once */

/* Number of the newest whole slot, 0 where there is none; fills kept. */
uint32_t avc_store_load(avc_kept_t *kept, uint32_t *slot);

/* Bytes of the table in a slot that was loaded. */
void avc_store_table(uint32_t slot, uint32_t offset, void *to, uint32_t size);

/* Keep this from now on; false where the memory did not take it, or is too small: what was kept before still is. */
bool avc_store_save(const avc_kept_t *kept, const avc_image_t *image);

#endif
