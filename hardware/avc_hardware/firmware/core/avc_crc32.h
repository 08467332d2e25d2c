/* CRC-32 as in zlib: reflected polynomial 0xEDB88320, start and final value inverted. */
#ifndef AVC_CRC32_H
#define AVC_CRC32_H

#include <stddef.h>
#include <stdint.h>

/* Continue a checksum; start with crc = 0. */
uint32_t avc_crc32(uint32_t crc, const uint8_t *data, size_t size);

#endif
