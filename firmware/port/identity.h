#ifndef FIRMWARE_PORT_IDENTITY_H_
#define FIRMWARE_PORT_IDENTITY_H_

/* What an image is: placed once in the flash of every port, found there by programs that hold only
 * the image (.elf, .hex or .bin), for example `forceaxis flash`.
 *
 * A port writes, in one file,
 *     IDENTITY_DEFINE("nucleo-f446re", "ab12cd34ef56+");
 * and keeps the section where it links: KEEP(*(.forceaxis_identity)), aligned to 4, in flash.
 * A reader searches every address divisible by 4 for magic and size; exactly one place may have
 * them. Integers are little-endian; texts are ASCII, filled up with zeros, and may fill their
 * field whole. New fields are added at the end only; `size` shows them. */

#include <stdint.h>

#include "firmware/app/fw.h"

typedef struct {
  char magic[4];    /* "FAXI" */
  uint32_t size;    /* of this structure: 60 */
  char version[16]; /* FW_VERSION */
  char git[16];     /* first 12 digits of the commit, "+" behind them if files differed from it */
  uint32_t table_hash; /* AXIS_OBJECTS_HASH32 of the object table it was built with */
  char board[16];      /* what it runs on, "nucleo-f446re"; an emulator's image has its own name */
} identity_t;

_Static_assert(sizeof(identity_t) == 60, "read by other programs");

/* software_version of a port: version, hash of the object table, commit. tools/image defines it, in
 * the section .version, which the linker script places. */
extern const char identity_software[];

#define IDENTITY_SECTION ".forceaxis_identity"

/* `board_text` and `git_text`: literals of at most 16 characters; a longer one does not compile
 * under -Werror. The name is `identity`, for a port that reports it itself. */
#define IDENTITY_DEFINE(board_text, git_text)                                                \
  extern const identity_t identity;                                                          \
  __attribute__((section(IDENTITY_SECTION), used, aligned(4))) const identity_t identity = { \
      .magic = {'F', 'A', 'X', 'I'},                                                         \
      .size = sizeof(identity_t),                                                            \
      .version = FW_VERSION,                                                                 \
      .git = git_text,                                                                       \
      .table_hash = AXIS_OBJECTS_HASH32,                                                     \
      .board = board_text,                                                                   \
  }

#endif
