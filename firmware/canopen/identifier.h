#ifndef FIRMWARE_CANOPEN_IDENTIFIER_H_
#define FIRMWARE_CANOPEN_IDENTIFIER_H_

/* A check whether two services of the node would use the same CAN identifier. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

/* Returns true if `object` is a COB-ID, and its new value `wanted` is a valid COB-ID whose
 * identifier another service of the node uses. Such a value is refused. Only one service receives a
 * frame, so the other service, for example the RPDO with the stop command, would not receive the
 * frame. Several RPDOs may share an identifier, and several TPDOs may share an identifier. */
bool identifier_is_taken(const canopen_t *canopen, uint16_t object, uint32_t wanted);

#endif
