#ifndef FIRMWARE_CANOPEN_IDENTIFIER_H_
#define FIRMWARE_CANOPEN_IDENTIFIER_H_

/* Which service of the node an identifier belongs to. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

/* Whether an object is a COB-ID that would become another, valid one whose identifier another
 * service of the node has. A frame that one service takes does not reach the other, which may be
 * the RPDO with its stop. Several RPDOs may share an identifier, and several TPDOs. */
bool identifier_is_taken(const canopen_t *canopen, uint16_t object, uint32_t wanted);

#endif
