#ifndef FIRMWARE_PORT_STM32F4_EMULATED_SEMIHOSTING_H_
#define FIRMWARE_PORT_STM32F4_EMULATED_SEMIHOSTING_H_

/* Files of the host, as ARM's semihosting gives them. Without a host that answers, `bkpt` is a
 * fault: nothing of this is in a released image. */

#include <stdint.h>

enum { SEMIHOSTING_READ = 1, SEMIHOSTING_WRITE = 5 };

/* The command line, ended by 0; empty where it does not fit. */
void semihosting_command_line(char *text, uint32_t room);

/* A file of the host; negative: it cannot be opened. */
int32_t semihosting_open(const char *name, uint32_t mode);

/* All bytes, without a time-out; an error ends the program. */
void semihosting_read(int32_t file, uint8_t *bytes, uint32_t count);
void semihosting_write(int32_t file, const uint8_t *bytes, uint32_t count);

_Noreturn void semihosting_exit(void);

#endif
