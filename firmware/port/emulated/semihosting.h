#ifndef FIRMWARE_PORT_EMULATED_SEMIHOSTING_H_
#define FIRMWARE_PORT_EMULATED_SEMIHOSTING_H_

/* Access to files of the host by the semihosting interface of ARM, which RISC-V also uses. Without
 * a host that answers, a call causes a fault of the core. A released image does not contain this
 * file. */

#include <stdint.h>

/* Modes of semihosting_open(): the file is read; the file is written; the file is read and
 * changed. */
enum { SEMIHOSTING_READ = 1, SEMIHOSTING_WRITE = 5, SEMIHOSTING_CHANGE = 3 };

/* Requests an operation from the host and returns the result of the host. Each processor has its
 * own instruction for this request, so the folder of the processor implements the function:
 * cortexm/semihosting_call.c, riscv32_virt/riscv32_virt.c. */
int32_t semihosting_call(uint32_t operation, const void *argument);

/* Reads the command line of the program into `text`, with a 0 at its end. The text is empty if the
 * command line is longer than `room`. */
void semihosting_command_line(char *text, uint32_t room);

/* Opens a file of the host. Returns a negative number if the file cannot be opened. */
int32_t semihosting_open(const char *name, uint32_t mode);

/* Sets the offset in a file from which the next bytes are read or written. */
void semihosting_seek(int32_t file, uint32_t offset);

/* semihosting_read() reads all `count` bytes, and semihosting_write() writes them, without a
 * time-out. An error ends the program. */
void semihosting_read(int32_t file, uint8_t *bytes, uint32_t count);
void semihosting_write(int32_t file, const uint8_t *bytes, uint32_t count);

/* semihosting_exit() ends the program with the exit status 0 of the emulator, and
 * semihosting_fail() with the exit status 1. */
_Noreturn void semihosting_exit(void);
_Noreturn void semihosting_fail(void);

#endif
