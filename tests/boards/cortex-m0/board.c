/* A Cortex-M0 in lock step with a program outside, as the packaged benches are. */
#include "board.h"

#include "bench/semihosting.h"

#include "bench/lock_step.h"
