#ifndef FIRMWARE_OBJECTS_DICTIONARY_H_
#define FIRMWARE_OBJECTS_DICTIONARY_H_

/* The object dictionary for the module that contains the values (app/fw.c). This module passes a
 * table to the dictionary. Each row of the table describes one block of objects: where its values
 * are, and which functions the dictionary calls. Protocols use access.h instead. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

/* One block of objects (AXIS_BLOCK_). The values of these objects are the members of one
 * structure. */
typedef struct {
  uint16_t offset; /* offset of the structure with the values, in bytes from the dictionary_t */
  /* Function that returns FW_OK if a value may be written that is within the range of its object.
   * It changes no state. The function pointer is NULL if every value within the range may be
   * written. */
  int (*check)(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
  /* Function that is called after a write has changed a value from `previous` to `value`. The
   * function pointer is NULL if no action follows a write. */
  void (*written)(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                  int32_t value);
} dictionary_block_t;

typedef struct {
  dictionary_block_t blocks[AXIS_BLOCK_NONE];
  /* Function that returns FW_OK if this command source may write this object now. The result
   * depends on the owner and the state of the axis. */
  int (*permit)(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);
  /* Function that is called after a write has changed the value of an object, if the object is a
   * stored parameter, or if its change ends a cycle (AXIS_IN_CYCLE_ENDS). */
  void (*changed)(dictionary_t *objects, uint16_t object);
  /* Function that executes a command. A command is an object that can only be written and has no
   * value. */
  int (*command)(dictionary_t *objects, uint16_t object, int32_t value);
  /* Functions that dictionary_text(), dictionary_domain_size() and dictionary_domain_read()
   * call. */
  const char *(*text)(const dictionary_t *objects, uint16_t index);
  int32_t (*domain_size)(const dictionary_t *objects, uint16_t index);
  uint32_t (*domain_read)(const dictionary_t *objects, uint16_t index, uint32_t offset,
                          uint8_t *bytes, uint32_t count);
  /* Functions that dictionary_download_most() and the other functions for downloads call. */
  uint32_t (*download_most)(const dictionary_t *objects, uint16_t index);
  int (*download_begin)(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);
  int (*download_append)(dictionary_t *objects, uint32_t offset, const uint8_t *bytes,
                         uint32_t count);
  int (*download_end)(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);
} dictionary_owner_t;

/* The object dictionary must be the first member of the structure that contains the values. Then
 * the offsets from the dictionary are also valid in every copy of this structure. */
struct dictionary {
  const dictionary_owner_t *owner;
  /* set of FW_SOURCE_ bits: sources of which a write was accepted since this set was last cleared;
   * writes to objects that are open to every source do not count */
  uint8_t writers;
  /* byte that is always 0; a TPDO sends this byte where no object is mapped */
  uint8_t zero;
};

void dictionary_init(dictionary_t *objects, const dictionary_owner_t *owner);

/* Returns true if the object exists and has a value. Such a value can be read in every tick. */
bool dictionary_has_value(uint16_t object);

/* Writes an object that has a value, as dictionary_write() does. A command may call
 * dictionary_write_value(), because this function executes no command. Returns FW_ERROR_NO_OBJECT
 * if the object is a command. */
int dictionary_write_value(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns true if the object is open: every command source may write it. Such an object selects the
 * result or the points of the curve that are read, or acknowledges a result. A write to such an
 * object does not show that the owner is still active. */
bool dictionary_is_open(uint16_t object);

/* Stores, for the watchdog of the owner, that this command source has written an object that is not
 * open. */
void dictionary_written_by(dictionary_t *objects, uint8_t source);

/* Returns true if a stored value may be restored to this object at power-up. */
bool dictionary_restorable(uint16_t object, int32_t value);

/* Sets an object to its stored value without calling the functions of its block. The caller makes
 * all restored values active afterwards. */
void dictionary_restore(dictionary_t *objects, uint16_t object, int32_t value);

#endif
