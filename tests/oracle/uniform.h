/* Uniform numbers from 0 to 1 by xorshift; the state must not be 0. */
#include <stdint.h>

static uint64_t state;

static double uniform(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) * 0x1p-53;
}
