#ifndef FIRMWARE_OBJECTS_ACCESS_H_
#define FIRMWARE_OBJECTS_ACCESS_H_

/* Object dictionary for the protocols: values are accessed by object number, entries by CANopen
 * address. dictionary.c implements these functions. It depends neither on the protocols nor on the
 * modules that have the values. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_table.h"

typedef struct dictionary dictionary_t;

/* Sources of an access to an object. The first three sources have the numbers of command_source. */
typedef enum {
  FW_SOURCE_CANOPEN = 0,
  FW_SOURCE_MODBUS = 1,
  FW_SOURCE_LCM = 2,
  /* the code for the board or a test bench; its writes do not depend on the owner of the axis */
  FW_SOURCE_LOCAL
} fw_source_t;

/* Reads the raw value of an object (AXIS_OBJ_). An unsigned 32-bit value keeps its bits in `value`.
 * Every source may read. Returns FW_OK, FW_ERROR_NO_OBJECT or FW_ERROR_WRITE_ONLY. */
int dictionary_read(const dictionary_t *objects, uint16_t object, int32_t *value);

/* The only function that writes: dictionary_write() writes a raw value or executes a command on
 * behalf of `source`, between ticks. The write acts in the next tick. No value is limited to its
 * range; a value out of range is refused.
 *
 * FW_ERROR_LOCKED: another source owns the axis. Exceptions: any bus may write its own number to
 * command_source, the owner may write the number of canopen, and any bus may name a result of a
 * cycle, or points of its curve, and acknowledge a result.
 * FW_ERROR_RANGE: the value is outside the range of the object; 0 where the table forbids 0;
 * position_min above position_max; a recorder channel or trigger that is no readable object;
 * recorder_arm without a channel, or with a pretrigger or length larger than the buffer; a mode of
 * operation or homing method that does not exist.
 * FW_ERROR_STATE: the object may only be written while the axis is disabled (or the recorder idle
 * or done), or its value must not change while a cycle runs (AXIS_IN_CYCLE_REFUSED); a native mode
 * other than disabled while a fault is latched, or over a bus, which uses controlword and
 * modes_of_operation; the mapping of a PDO while the PDO is valid.
 * FW_ERROR_BUSY: a stored parameter, a command to the store, or a write that would enable the axis,
 * while the store is working.
 * FW_ERROR_MAPPING: the object cannot be mapped into this PDO or exceeds the length of the PDO, or
 * the heartbeat of the node is already monitored.
 * FW_ERROR_NO_MEMORY: a command to the store if the board has no memory for the store.
 *
 * The watchdog of the owner is reset only by an accepted write of the owner, and not by a write to
 * an object that every bus may write. Otherwise a client that only reads results could keep an axis
 * in motion although its owner has stopped writing. A write of the present value is sufficient. The
 * soft limits and position_setpoint are not compared with each other, in either order: a soft limit
 * can always be reduced, and the axis stops at the soft limit on its path to a set-point beyond
 * this limit. */
int dictionary_write(dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns the result that dictionary_write() would return now, without a write. Commands are
 * checked only in part: whether the settings of the recorder are consistent and whether a parameter
 * store exists is checked only when the command is executed. */
int dictionary_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns the entry of the object dictionary at a CANopen address, or NULL. */
const axis_address_t *dictionary_address(uint16_t index, uint8_t sub);

/* Returns the object at the address (CANopen index times 256 plus sub-index), or AXIS_OBJ_NONE. */
uint16_t dictionary_object_at(uint32_t address);

/* Returns the offset in bytes from `objects` to the lowest byte of a readable object; the other
 * bytes follow. TPDOs read mapped values at this offset in every tick. For AXIS_OBJ_NONE the result
 * is the offset of a byte that is always 0. */
uint16_t dictionary_place(const dictionary_t *objects, uint16_t object);

/* Returns the text of an AXIS_ADDRESS_TEXT entry, with a 0 at its end. */
const char *dictionary_text(const dictionary_t *objects, uint16_t index);

/* CANopen indices of the AXIS_ADDRESS_DOMAIN entries: the completed recording, oldest sample first,
 * packed as recorder.h describes, and the curve of the last cycle, whose points curve.h
 * describes. */
enum { DICTIONARY_RECORDING = 0x2120, DICTIONARY_CURVE = 0x243B };

/* CANopen index of the AXIS_ADDRESS_DOWNLOAD entry whose bytes go to the flash as they come. */
enum { DICTIONARY_UPDATE = 0x1F50 };

/* dictionary_domain_size() returns the size of a domain in bytes, FW_ERROR_NO_DATA if it is empty,
 * or FW_ERROR_STATE while it cannot be read. dictionary_domain_read() reads up to `count` bytes
 * from `offset` and returns the number of these bytes. */
int32_t dictionary_domain_size(const dictionary_t *objects, uint16_t index);
uint32_t dictionary_domain_read(const dictionary_t *objects, uint16_t index, uint32_t offset,
                                uint8_t *bytes, uint32_t count);

/* An AXIS_ADDRESS_DOWNLOAD entry is the program of a cycle or an update of the firmware.
 * dictionary_download_most() returns the largest size of a download in bytes, or 0 if the board has
 * no memory for it. A download begins, with the size that the client has announced or 0, stages its
 * bytes from offset 0 on, and ends; only its end changes the axis. These functions return FW_OK,
 * FW_ERROR_LOCKED, FW_ERROR_STATE, FW_ERROR_BUSY while another download is in progress,
 * FW_ERROR_RANGE if the bytes are refused, and FW_ERROR_NO_MEMORY if they have no room.
 */
uint32_t dictionary_download_most(const dictionary_t *objects, uint16_t index);
int dictionary_download_begin(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);
int dictionary_download_append(dictionary_t *objects, uint8_t source, uint32_t offset,
                               const uint8_t *bytes, uint32_t count);
int dictionary_download_end(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);

#endif
