#ifndef FIRMWARE_PORT_STM32F4_EMULATED_SEMIHOSTING_H_
#define FIRMWARE_PORT_STM32F4_EMULATED_SEMIHOSTING_H_

/* Files of the host, by the semihosting interface of ARM. Without a host that answers, `bkpt`
 * causes a fault; a released image does not contain this file. */

#include <stdint.h>

enum { SEMIHOSTING_READ = 1, SEMIHOSTING_WRITE = 5 };

/* Reads the command line, ended by 0; it is empty if it is longer than `room`. */
void semihosting_command_line(char *text, uint32_t room);

/* Opens a file of the host. Returns a negative number if it cannot be opened. */
int32_t semihosting_open(const char *name, uint32_t mode);

/* Reads all bytes without a time-out; an error ends the program. */
void semihosting_read(int32_t file, uint8_t *bytes, uint32_t count);
void semihosting_write(int32_t file, const uint8_t *bytes, uint32_t count);

_Noreturn void semihosting_exit(void);

#endif
