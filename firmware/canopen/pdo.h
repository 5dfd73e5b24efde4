#ifndef FIRMWARE_CANOPEN_PDO_H_
#define FIRMWARE_CANOPEN_PDO_H_

/* Process data objects of a CANopen node: 4 it receives, 4 it transmits, 8 entries each, mapped at
 * run time.
 *
 * Mapping: COB-ID with bit 31, mapped 0, entries, mapped n, COB-ID without bit 31. An entry is
 * refused (FW_ERROR_STATE) while its PDO is valid or `mapped` is not 0; so is `mapped` while the
 * PDO is valid. Into an RPDO go mappable objects that can be written, and the dummies
 * 0001h..0007h; into a TPDO mappable objects that can be read. An entry 0 is empty and may be
 * written, but not be among those mapped. All together 64 bits. A TPDO or RPDO with nothing mapped
 * is valid and does nothing.
 *
 * COB-IDs: 11 bits. Bits 0 to 29 do not change while the PDO is valid (FW_ERROR_STATE); one that
 * CiA 301 restricts is refused when it would become valid (FW_ERROR_RANGE). Bit 30 of a TPDO stays
 * 1 (FW_ERROR_RANGE): remote requests are never answered. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* Transmission types. Others up to 253 are refused. */
enum { PDO_SYNC_ACYCLIC = 0, PDO_SYNC_MAX = 240, PDO_EVENT_MANUFACTURER = 254, PDO_EVENT = 255 };
/* In place of a number of SYNCs: the one with the start value has not come. */
enum { PDO_SYNC_AWAITED = 255 };

/* Applies the parameters of all PDOs, and starts or stops their timers. */
void pdo_start(canopen_t *canopen, const dictionary_t *objects);

/* The node entered or left the operational state. */
void pdo_operational(canopen_t *canopen, bool operational);

/* A data frame with an identifier of no other service. */
void pdo_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* Whether a valid RPDO, and whether a valid TPDO, has this identifier. */
bool pdo_receives(const canopen_t *canopen, uint16_t id);
bool pdo_transmits(const canopen_t *canopen, uint16_t id);

/* TPDOs are sampled, then received RPDOs are applied. counter: that of the SYNC, 0 without one. */
void pdo_sync(canopen_t *canopen, dictionary_t *objects, uint8_t counter);

/* Event-driven TPDOs; to be called while any is watched or inhibited. */
void pdo_tick(canopen_t *canopen, const dictionary_t *objects);

/* Ticks that did not come, as canopen_timers_missed(), for the times of TPDOs; before that. */
void pdo_missed(canopen_t *canopen, uint32_t ticks);

/* An RPDO did not come in time. */
void pdo_late(canopen_t *canopen, bool active, uint8_t rpdo);
/* Deadlines that are not running, or were missed, begin anew, as soon as the axis is active. */
void pdo_restart_deadlines(canopen_t *canopen);
/* Whether any RPDO has one. */
bool pdo_has_deadline(const canopen_t *canopen);
/* The axis is active: deadlines that waited for it begin. */
void pdo_axis_active(canopen_t *canopen);

/* canopen_check() and canopen_written() of the PDOs' objects; a refusal above 0: none of them. */
enum { PDO_NOT_MINE = 1 };
int pdo_check(const canopen_t *canopen, uint16_t object, int32_t value);
void pdo_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object);

#endif
