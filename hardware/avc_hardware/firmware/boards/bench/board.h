/* No serial interrupt: bytes come with the position, by semihosting. */
#define BOARD_INTERRUPTS 1
#define BOARD_SERIAL_INTERRUPT 0
#ifndef BOARD_CLOCK_HZ
#define BOARD_CLOCK_HZ 25000000u
#endif
