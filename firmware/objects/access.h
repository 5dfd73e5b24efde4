#ifndef FIRMWARE_OBJECTS_ACCESS_H_
#define FIRMWARE_OBJECTS_ACCESS_H_

/* The object dictionary for the protocols. Values are accessed by the number of the object, and
 * entries by their CANopen address. dictionary.c implements these functions. It depends neither on
 * the protocols nor on the modules that contain the values. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_table.h"

typedef struct dictionary dictionary_t;

/* Command sources of an access to an object. The first three sources have the same numbers as in
 * the object command_source. */
typedef enum {
  FW_SOURCE_CANOPEN = 0,
  FW_SOURCE_MODBUS = 1,
  FW_SOURCE_LCM = 2,
  /* source of writes by the code for the board or by a test bench. These writes are permitted for
   * every owner of the axis */
  FW_SOURCE_LOCAL
} fw_source_t;

/* Reads the raw value of an object (AXIS_OBJ_). An unsigned 32-bit value keeps its bits in `value`.
 * Every command source may read. Returns FW_OK, FW_ERROR_NO_OBJECT or FW_ERROR_WRITE_ONLY. */
int dictionary_read(const dictionary_t *objects, uint16_t object, int32_t *value);

/* Writes a raw value to an object or executes a command, on behalf of `source`. All writes to
 * objects use this function. Call it between ticks; the write acts in the next tick. A value
 * outside the range of the object is refused; it is not limited to the range. Returns FW_OK or one
 * of these error codes:
 *
 *   FW_ERROR_LOCKED     another source owns the axis. Exceptions: each bus may write its own number
 *                       to command_source, and the owner may write the number of canopen. Each bus
 *                       may also select the result of a cycle or points of its curve for reading,
 *                       and acknowledge a result
 *   FW_ERROR_RANGE      the value is outside the range of the object, or is 0 although the object
 *                       table forbids 0; position_min would be above position_max; the object of a
 *                       recorder channel or trigger cannot be read; recorder_arm is written without
 *                       a channel, or with a pretrigger or length larger than the buffer; the mode
 *                       of operation or homing method does not exist
 *   FW_ERROR_STATE      the object may only be written while the axis is disabled, or while the
 *                       recorder is idle or done; its value must not change while a cycle runs
 *                       (AXIS_IN_CYCLE_REFUSED); a native mode other than disabled is written while
 *                       a fault is latched, or over a bus, which must use controlword and
 *                       modes_of_operation; the mapping of a PDO is written while the PDO is valid
 *   FW_ERROR_BUSY       the parameter store is working, and the write is to a stored parameter, is
 *                       a command to the store, or would enable the axis
 *   FW_ERROR_MAPPING    the object cannot be mapped into this PDO or exceeds the length of the PDO,
 *                       or the heartbeat of the node is already monitored
 *   FW_ERROR_NO_MEMORY  a command to the parameter store, but the board has no memory for the store
 *
 * The watchdog of the owner is reset only by an accepted write of the owner, and not by a write to
 * an object that every bus may write. Otherwise a client that only reads results could keep an axis
 * in motion although its owner no longer writes. To reset the watchdog, a write of the present
 * value of an object is sufficient. Neither a soft limit nor position_setpoint is refused because
 * of the other one. So a soft limit can always be reduced, and the axis stops at a soft limit if
 * the set-point is beyond it.*/
int dictionary_write(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns the result that dictionary_write() would return now, without a write. Commands are
 * checked only in part. Two conditions are checked only when a command is executed: consistent
 * settings of the recorder, and the existence of a parameter store. */
int dictionary_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns the entry of the object dictionary at a CANopen address, or NULL if there is no entry. */
const axis_address_t *dictionary_address(uint16_t index, uint8_t sub);

/* Returns the object at an address (CANopen index times 256 plus sub-index), or AXIS_OBJ_NONE if
 * there is no object. */
uint16_t dictionary_object_at(uint32_t address);

/* Returns the offset in bytes from `objects` to the lowest byte of the value of a readable object.
 * The other bytes of the value follow. TPDOs read mapped values at this offset in every tick. For
 * AXIS_OBJ_NONE the result is the offset of a byte that is always 0. */
uint16_t dictionary_place(const dictionary_t *objects, uint16_t object);

/* Returns the text of an AXIS_ADDRESS_TEXT entry, with a 0 at its end. */
const char *dictionary_text(const dictionary_t *objects, uint16_t index);

/* CANopen indices of the AXIS_ADDRESS_DOMAIN entries. RECORDING: the completed recording, beginning
 * with the oldest sample, in the format that recorder.h describes. CURVE: the curve of the last
 * cycle; curve.h describes its points. */
enum { DICTIONARY_RECORDING = 0x2120, DICTIONARY_CURVE = 0x243B };

/* CANopen index of the AXIS_ADDRESS_DOWNLOAD entry for an update. Its bytes are programmed into the
 * flash when they are received. */
enum { DICTIONARY_UPDATE = 0x1F50 };

/* dictionary_domain_size() returns the size of a domain in bytes, FW_ERROR_NO_DATA if the domain is
 * empty, or FW_ERROR_STATE while it cannot be read. dictionary_domain_read() copies up to `count`
 * bytes of a domain from `offset` on, and returns the number of copied bytes. */
int32_t dictionary_domain_size(const dictionary_t *objects, uint16_t index);
uint32_t dictionary_domain_read(const dictionary_t *objects, uint16_t index, uint32_t offset,
                                uint8_t *bytes, uint32_t count);

/* An AXIS_ADDRESS_DOWNLOAD entry is a cycle program or an update of the firmware.
 * dictionary_download_most() returns the largest size of a download in bytes, or 0 if the board has
 * no memory for it. dictionary_download_begin() begins a download; `size` is the size that the
 * client has announced, or 0. dictionary_download_append() stages bytes from offset 0 on.
 * dictionary_download_end() ends the download, and only this function changes the axis. The three
 * functions return FW_OK; FW_ERROR_LOCKED; FW_ERROR_STATE; FW_ERROR_BUSY while another download is
 * in progress; FW_ERROR_RANGE if the bytes are refused; or FW_ERROR_NO_MEMORY if there is no room
 * for the bytes. */
uint32_t dictionary_download_most(const dictionary_t *objects, uint16_t index);
int dictionary_download_begin(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);
int dictionary_download_append(dictionary_t *objects, uint8_t source, uint32_t offset,
                               const uint8_t *bytes, uint32_t count);
int dictionary_download_end(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);

#endif
