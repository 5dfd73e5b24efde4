#ifndef FIRMWARE_CANOPEN_SDO_H_
#define FIRMWARE_CANOPEN_SDO_H_

/* SDO servers of a CANopen node: expedited and segmented transfers in both directions, no blocks.
 * Each server writes on behalf of one source: the source lock distinguishes them. Requests that
 * do not have 8 bytes get no answer, as CiA 301 asks for. */

#include <stdint.h>

#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* Abort codes, with their causes in this server. */
#define SDO_ABORT_TOGGLE UINT32_C(0x05030000)
#define SDO_ABORT_TIMEOUT UINT32_C(0x05040000)    /* no segment for SDO_TIMEOUT_MS */
#define SDO_ABORT_COMMAND UINT32_C(0x05040001)    /* block transfer; a segment out of turn */
#define SDO_ABORT_WRITE_ONLY UINT32_C(0x06010001) /* a command cannot be read */
#define SDO_ABORT_READ_ONLY UINT32_C(0x06010002)
#define SDO_ABORT_NO_OBJECT UINT32_C(0x06020000)  /* no such index, or none to map */
#define SDO_ABORT_MAPPING UINT32_C(0x06040041)    /* cannot be mapped into this PDO */
#define SDO_ABORT_PDO_LENGTH UINT32_C(0x06040042) /* the objects mapped do not fit */
#define SDO_ABORT_PARAMETER UINT32_C(0x06040043)  /* two heartbeat consumers for one node */
#define SDO_ABORT_HARDWARE UINT32_C(0x06060000)   /* no memory for parameters */
#define SDO_ABORT_LENGTH UINT32_C(0x06070010)     /* other than the length that was announced */
#define SDO_ABORT_TOO_LONG UINT32_C(0x06070012)
#define SDO_ABORT_TOO_SHORT UINT32_C(0x06070013)
#define SDO_ABORT_NO_SUB UINT32_C(0x06090011)
#define SDO_ABORT_VALUE UINT32_C(0x06090030) /* in the range, but none of the valid values */
#define SDO_ABORT_TOO_HIGH UINT32_C(0x06090031)
#define SDO_ABORT_TOO_LOW UINT32_C(0x06090032)
#define SDO_ABORT_SIGNATURE UINT32_C(0x08000020) /* neither "save" nor "load" */
#define SDO_ABORT_LOCKED UINT32_C(0x08000021)    /* another source owns the axis */
#define SDO_ABORT_STATE UINT32_C(0x08000022)     /* not now: axis, recorder, PDO or store */
#define SDO_ABORT_NO_DATA UINT32_C(0x08000024)   /* no finished recording */

/* How long the next segment may take. */
enum { SDO_TIMEOUT_MS = 5000 };

/* Server 0 is the default one: CANOPEN; 1: MODBUS, 2: LCM. */
void sdo_receive(canopen_t *canopen, dictionary_t *objects, uint8_t server,
                 const can_frame_t *frame);

/* A segmented transfer has timed out. */
void sdo_timeout(canopen_t *canopen, uint8_t server);

/* Discards transfers, without an abort. */
void sdo_drop(canopen_t *canopen);

/* The recording was stopped or armed anew: an upload of it ends with an abort. */
void sdo_recording_replaced(canopen_t *canopen);

#endif
