#include "firmware/objects/dictionary.h"

/* dictionary_write() has its own file, because a command may call dictionary_write_value(). The
 * list of calls through function pointers (board.toml) contains the file of each call. With a
 * separate file, the list shows that no function calls itself. */
int dictionary_write(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  if (dictionary_has_value(object)) {
    return dictionary_write_value(objects, source, object, value);
  }
  int refusal = dictionary_check(objects, source, object, value);
  if (refusal == FW_OK) {
    refusal = objects->owner->command(objects, object, value);
  }
  if (refusal == FW_OK) {
    dictionary_written_by(objects, source);
  }
  return refusal;
}
