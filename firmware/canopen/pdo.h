#ifndef FIRMWARE_CANOPEN_PDO_H_
#define FIRMWARE_CANOPEN_PDO_H_

/* Process data objects of a CANopen node: 4 RPDOs and 4 TPDOs with 8 entries each, mapped at run
 * time.
 *
 * Steps of a mapping: COB-ID with bit 31, number of entries 0, entries, number of entries n, COB-ID
 * without bit 31. A write to an entry is refused (FW_ERROR_STATE) while its PDO is valid or the
 * number is not 0; a write to the number is refused while the PDO is valid. An RPDO may contain
 * mappable objects that can be written and the dummies 0001h..0007h; a TPDO may contain mappable
 * objects that can be read. An entry 0 is empty; it may be written, but not be mapped. A PDO has at
 * most 64 bits. A PDO without entries may be valid and does nothing.
 *
 * COB-IDs have 11 bits. Bits 0 to 29 do not change while the PDO is valid (FW_ERROR_STATE); an
 * identifier that CiA 301 restricts is refused when it would become valid (FW_ERROR_RANGE). Bit 30
 * of a TPDO remains 1 (FW_ERROR_RANGE), because remote requests are never answered. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* Transmission types of PDOs. Other types up to 253 are refused. */
enum { PDO_SYNC_ACYCLIC = 0, PDO_SYNC_MAX = 240, PDO_EVENT_MANUFACTURER = 254, PDO_EVENT = 255 };
/* Value of the SYNC count of a TPDO that waits for the SYNC with its start value. */
enum { PDO_SYNC_AWAITED = 255 };

/* Applies the parameters of all PDOs, and starts or stops their timers. */
void pdo_start(canopen_t *canopen, const dictionary_t *objects);

/* The node has entered or left the state operational. */
void pdo_operational(canopen_t *canopen, bool operational);

/* Processes a data frame whose identifier belongs to no other service. */
void pdo_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* Whether a valid RPDO has this identifier, and whether a valid TPDO has it. */
bool pdo_receives(const canopen_t *canopen, uint16_t id);
bool pdo_transmits(const canopen_t *canopen, uint16_t id);

/* Acts on a SYNC message: samples the TPDOs, then applies the received RPDOs. counter is that of
 * the SYNC, or 0 without one. */
void pdo_sync(canopen_t *canopen, dictionary_t *objects, uint8_t counter);

/* Sends event-driven TPDOs; call it while any TPDO is compared or inhibited. */
void pdo_tick(canopen_t *canopen, const dictionary_t *objects);

/* Accounts for missed ticks in the times of TPDOs; call it before canopen_timers_missed(). */
void pdo_missed(canopen_t *canopen, uint32_t ticks);

/* The deadline of an RPDO has expired. */
void pdo_late(canopen_t *canopen, bool active, uint8_t rpdo);
/* Starts deadlines of RPDOs that do not run or have expired again, as soon as the axis is
 * active. */
void pdo_restart_deadlines(canopen_t *canopen);
/* Whether any RPDO has a deadline. */
bool pdo_has_deadline(const canopen_t *canopen);
/* The axis has become active: starts the deadlines that waited for this. */
void pdo_axis_active(canopen_t *canopen);

/* The parts of canopen_check() and canopen_written() for the objects of PDOs. PDO_NOT_MINE: the
 * object is not one of them. */
enum { PDO_NOT_MINE = 1 };
int pdo_check(const canopen_t *canopen, uint16_t object, int32_t value);
void pdo_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object);

#endif
