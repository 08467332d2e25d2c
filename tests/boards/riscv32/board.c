/* A RISC-V in lock step with a program outside, as the packaged benches are. */
#include "semihosting.h"

#include "bench/lock_step.h"
