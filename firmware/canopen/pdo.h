#ifndef FIRMWARE_CANOPEN_PDO_H_
#define FIRMWARE_CANOPEN_PDO_H_

/* Process data objects of a CANopen node: 4 RPDOs and 4 TPDOs with 8 mapping entries each. The
 * mapping can be changed at run time.
 *
 * Steps to change a mapping: write the COB-ID with bit 31 set, then 0 as the number of entries, the
 * entries, the new number of entries, and the COB-ID with bit 31 cleared. A write to an entry is
 * refused (FW_ERROR_STATE) while the PDO is valid or its number of entries is not 0. A write to the
 * number of entries is refused while the PDO is valid. An RPDO may contain mappable objects that
 * can be written, and the dummies 0001h..0007h. A TPDO may contain mappable objects that can be
 * read. An entry with the value 0 is empty: it may be written, but not be mapped. A PDO has at most
 * 64 bits. A PDO without entries may be valid and does nothing.
 *
 * COB-IDs have 11-bit identifiers. Bits 0 to 29 of a COB-ID cannot change while the PDO is valid
 * (FW_ERROR_STATE). A COB-ID cannot become valid with an identifier that CiA 301 restricts
 * (FW_ERROR_RANGE). Bit 30 in the COB-ID of a TPDO must be 1 (FW_ERROR_RANGE), because remote
 * requests are never answered. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* Transmission types of PDOs. The types 241 to 253 are refused. */
enum { PDO_SYNC_ACYCLIC = 0, PDO_SYNC_MAX = 240, PDO_EVENT_MANUFACTURER = 254, PDO_EVENT = 255 };
/* PDO_SYNC_AWAITED: value of the SYNC count of a TPDO that waits for the SYNC with its start
 * value. */
enum { PDO_SYNC_AWAITED = 255 };

/* Applies the parameters of all PDOs, and starts or stops the timers of the PDOs. */
void pdo_start(canopen_t *canopen, const dictionary_t *objects);

/* Call pdo_operational() when the node has entered or left the state operational. */
void pdo_operational(canopen_t *canopen, bool operational);

/* Processes a received data frame whose identifier belongs to no other service of the node. */
void pdo_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* pdo_receives() returns true if a valid RPDO has the identifier `id`, and pdo_transmits() if a
 * valid TPDO has this identifier. */
bool pdo_receives(const canopen_t *canopen, uint16_t id);
bool pdo_transmits(const canopen_t *canopen, uint16_t id);

/* Acts on a SYNC message: samples the synchronous TPDOs, then applies the received RPDOs. `counter`
 * is the counter of the SYNC message, or 0 if the message has none. */
void pdo_sync(canopen_t *canopen, dictionary_t *objects, uint8_t counter);

/* Sends the event-driven TPDOs that are due. Call this function in each tick in which tpdos_watched
 * or tpdos_inhibited is not 0. */
void pdo_tick(canopen_t *canopen, const dictionary_t *objects);

/* Adapts the event times and inhibit times of TPDOs to `ticks` missed ticks. Call this function
 * before canopen_timers_missed(). */
void pdo_missed(canopen_t *canopen, uint32_t ticks);

/* Acts on an RPDO that was not received before its deadline. */
void pdo_late(canopen_t *canopen, bool active, uint8_t rpdo);
/* Prepares the deadlines of RPDOs that are not running or have expired. These deadlines start as
 * soon as the axis is active. */
void pdo_restart_deadlines(canopen_t *canopen);
/* Returns true if any valid RPDO has a deadline. */
bool pdo_has_deadline(const canopen_t *canopen);
/* Call pdo_axis_active() when the axis has become active. It starts the deadlines of the RPDOs that
 * waited for an active axis. */
void pdo_axis_active(canopen_t *canopen);

/* For the objects of PDOs, pdo_check() does the work of canopen_check(), and pdo_written() that of
 * canopen_written(). pdo_check() returns PDO_NOT_MINE if the object belongs to no PDO. */
enum { PDO_NOT_MINE = 1 };
int pdo_check(const canopen_t *canopen, uint16_t object, int32_t value);
void pdo_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object);

#endif
