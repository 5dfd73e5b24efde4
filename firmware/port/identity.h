#ifndef FIRMWARE_PORT_IDENTITY_H_
#define FIRMWARE_PORT_IDENTITY_H_

/* The identity of an image, stored once in the flash memory of every board. Programs that have only
 * the image (.elf, .hex or .bin) find the identity there, for example `forceaxis flash`.
 *
 * The code for a board contains, in one file,
 *     IDENTITY_DEFINE("nucleo-f446re", "ab12cd34ef56+");
 * and its linker script keeps the section: KEEP(*(.forceaxis_identity)), aligned to 4, in flash. A
 * program that reads an image searches `magic` and `size` at every address divisible by 4. Exactly
 * one address may match. Integers are little-endian; texts are ASCII, filled with zeros, and may
 * use all bytes of their field. New fields are only added at the end; `size` shows that they
 * exist. */

#include <stdint.h>

#include "firmware/app/fw.h"

typedef struct {
  char magic[4];    /* "FAXI" */
  uint32_t size;    /* size of this structure in bytes: 60 */
  char version[16]; /* version of the firmware, FW_VERSION */
  /* first 12 digits of the commit of the source, and "+" if source files differed from this
   * commit */
  char git[16];
  uint32_t table_hash; /* AXIS_OBJECTS_HASH32, the hash of the object table in the image */
  /* name of the board, for example "nucleo-f446re"; an image for an emulator has another name */
  char board[16];
} identity_t;

_Static_assert(sizeof(identity_t) == 60, "read by other programs");

/* Text of software_version on a board: version, hash of the object table and commit. The program
 * tools/image defines this text in the section .version, which the linker script places. */
extern const char identity_software[];

/* The identity of this image. The code for the board defines this variable. */
extern const identity_t identity;

#define IDENTITY_SECTION ".forceaxis_identity"

/* Defines the variable `identity` with the identity of the image. `board_text` and `git_text` are
 * string literals of at most 16 characters; a longer literal does not compile with -Werror. */
#define IDENTITY_DEFINE(board_text, git_text)                                                \
  __attribute__((section(IDENTITY_SECTION), used, aligned(4))) const identity_t identity = { \
      .magic = {'F', 'A', 'X', 'I'},                                                         \
      .size = sizeof(identity_t),                                                            \
      .version = FW_VERSION,                                                                 \
      .git = git_text,                                                                       \
      .table_hash = AXIS_OBJECTS_HASH32,                                                     \
      .board = board_text,                                                                   \
  }

#endif
