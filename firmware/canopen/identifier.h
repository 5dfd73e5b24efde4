#ifndef FIRMWARE_CANOPEN_IDENTIFIER_H_
#define FIRMWARE_CANOPEN_IDENTIFIER_H_

/* Finds the service of the node to which a CAN identifier belongs. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

/* Whether an object is a COB-ID, and its new value is valid with an identifier that another service
 * of the node uses. Only one service receives a frame, so the other one, perhaps the RPDO with the
 * stop command, would not receive it. Several RPDOs may share an identifier, and several TPDOs
 * may. */
bool identifier_is_taken(const canopen_t *canopen, uint16_t object, uint32_t wanted);

#endif
