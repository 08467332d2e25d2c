/* For a compiler that comes without a C library: its own types. */
#include <stdint-gcc.h>
