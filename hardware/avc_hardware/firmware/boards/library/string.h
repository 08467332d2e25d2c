/* For a compiler that comes without a C library: what memory.c has of it. */
#ifndef AVC_STRING_H
#define AVC_STRING_H

#include <stddef.h>

void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);

#endif
