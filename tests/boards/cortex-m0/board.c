/* A Cortex-M0 in lock step with a program outside. */
#include "board.h"

#include "semihosting.h"

#include "lock_step.h"
