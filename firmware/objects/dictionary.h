#ifndef FIRMWARE_OBJECTS_DICTIONARY_H_
#define FIRMWARE_OBJECTS_DICTIONARY_H_

/* The object dictionary for the owner of the values. A table of the owner has one row for each
 * block of the object table, with the position of the values and the functions that the dictionary
 * calls. Protocols use access.h. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

/* One block (AXIS_BLOCK_): a structure with values of one owner. */
typedef struct {
  uint16_t offset; /* offset of the structure in bytes from the dictionary_t */
  /* Whether a value within its range may be written; changes nothing. NULL: every value may be
   * written. */
  int (*check)(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
  /* Acts on a write: the value was `previous` and now is `value`. NULL: nothing depends on the
   * value. */
  void (*written)(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                  int32_t value);
} dictionary_block_t;

typedef struct {
  dictionary_block_t blocks[AXIS_BLOCK_NONE];
  /* Whether this source may write this object now: checks source lock and state. */
  int (*permit)(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
  /* A write has changed the value of a stored parameter. */
  void (*changed)(dictionary_t *objects, uint16_t object);
  /* Carries out a command, which is an object without a value. */
  int (*command)(dictionary_t *objects, uint16_t object, int32_t value);
  /* Functions that carry out dictionary_text(), dictionary_domain_size() and
   * dictionary_domain_read(). */
  const char *(*text)(const dictionary_t *objects, uint16_t index);
  uint32_t (*domain_size)(const dictionary_t *objects);
  uint32_t (*domain_read)(const dictionary_t *objects, uint32_t offset, uint8_t *bytes,
                          uint32_t count);
} dictionary_owner_t;

/* The dictionary. It must be the first member of the owner's structure, so that offsets are valid
 * in every copy of the structure. */
struct dictionary {
  const dictionary_owner_t *owner;
  /* set of FW_SOURCE_ whose writes were accepted since the owner cleared the set */
  uint8_t writers;
  uint8_t zero; /* always 0: value of the bytes of TPDOs without a mapped object */
};

void dictionary_init(dictionary_t *objects, const dictionary_owner_t *owner);

/* Whether an object of this number has a value that can be read in any tick. */
bool dictionary_has_value(uint16_t object);

/* Writes an object that has a value, as dictionary_write() does. A command may use it, because it
 * carries out no other command. FW_ERROR_NO_OBJECT: the object is a command. */
int dictionary_write_value(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Notes that the dictionary has accepted a write of this source, for the watchdog of the owner. */
void dictionary_written_by(dictionary_t *objects, uint8_t source);

/* Whether a value may be restored to an object at power-up. */
bool dictionary_restorable(uint16_t object, int32_t value);

/* Restores a value to an object without calling the owner, who applies all restored values
 * afterwards. */
void dictionary_restore(dictionary_t *objects, uint16_t object, int32_t value);

#endif
