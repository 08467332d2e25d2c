/* No serial interrupt: bytes come with the position, by semihosting. */
#define BOARD_INTERRUPTS 1
#define BOARD_SERIAL_INTERRUPT 0
#define BOARD_CLOCK_HZ 16000000u
