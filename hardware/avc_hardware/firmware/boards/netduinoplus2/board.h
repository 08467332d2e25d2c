#define BOARD_INTERRUPTS 82
#define BOARD_SERIAL_INTERRUPT 37
#define BOARD_CLOCK_HZ 168000000u
#ifndef BOARD_BAUD
#define BOARD_BAUD 115200u
#endif
/* Runs while the flash cannot be read. */
#define BOARD_IN_MEMORY __attribute__((section(".ramcode"), noinline))
