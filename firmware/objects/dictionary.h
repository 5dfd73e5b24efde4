#ifndef FIRMWARE_OBJECTS_DICTIONARY_H_
#define FIRMWARE_OBJECTS_DICTIONARY_H_

/* The object dictionary for the owner of the values: a table of the owner, with one row for each
 * block of the object table, locates them and holds the owner's callbacks. Protocols use access.h.
 */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

/* One block (AXIS_BLOCK_): a structure of values of one owner. */
typedef struct {
  uint16_t offset; /* of the structure, bytes from the dictionary_t */
  /* Whether a value within its range may be written; nothing is changed. NULL: any. */
  int (*check)(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
  /* The value was `previous` and now is `value`. NULL: nothing depends on it. */
  void (*written)(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                  int32_t value);
} dictionary_block_t;

typedef struct {
  dictionary_block_t blocks[AXIS_BLOCK_NONE];
  /* Whether this source may write this object now: lock and state. */
  int (*permit)(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
  /* A write gave a stored parameter another value. */
  void (*changed)(dictionary_t *objects, uint16_t object);
  /* Carries out a command, an object without a value. */
  int (*command)(dictionary_t *objects, uint16_t object, int32_t value);
  /* dictionary_text(), dictionary_domain_size(), dictionary_domain_read(). */
  const char *(*text)(const dictionary_t *objects, uint16_t index);
  uint32_t (*domain_size)(const dictionary_t *objects);
  uint32_t (*domain_read)(const dictionary_t *objects, uint32_t offset, uint8_t *bytes,
                          uint32_t count);
} dictionary_owner_t;

/* The first member of the owner's structure, so that offsets hold in every copy of it. */
struct dictionary {
  const dictionary_owner_t *owner;
  uint8_t writers; /* set of FW_SOURCE_ whose writes were accepted since the owner cleared it */
  uint8_t zero;    /* always 0: bytes of TPDOs that nothing is mapped to */
};

void dictionary_init(dictionary_t *objects, const dictionary_owner_t *owner);

/* Whether an object of this number has a value that can be read in any tick. */
bool dictionary_has_value(uint16_t object);

/* Writes an object that has a value, as dictionary_write() does. For a command, which may write
 * values but gives no other command. FW_ERROR_NO_OBJECT: the object is a command. */
int dictionary_write_value(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* A write of this source was accepted. */
void dictionary_written_by(dictionary_t *objects, uint8_t source);

/* Whether a value may be restored to an object at power-up. */
bool dictionary_restorable(uint16_t object, int32_t value);

/* Restores it without calling the owner, who applies all restored values afterwards. */
void dictionary_restore(dictionary_t *objects, uint16_t object, int32_t value);

#endif
