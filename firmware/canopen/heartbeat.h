#ifndef FIRMWARE_CANOPEN_HEARTBEAT_H_
#define FIRMWARE_CANOPEN_HEARTBEAT_H_

/* Heartbeat consumers of a CANopen node (1016h). A node is supervised from its first heartbeat on.
 * After a missing one, or a boot-up message, CANopen counts as lost, and so do clients of a
 * gateway. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

/* Identifiers of heartbeats: this plus the node id. */
enum { HEARTBEAT_ID = 0x700, HEARTBEAT_ID_LAST = 0x77F };

void heartbeat_receive(canopen_t *canopen, const can_frame_t *frame);

/* The timer of consumer i ran out. */
void heartbeat_missed(canopen_t *canopen, uint8_t i);

/* The entry of consumer i has changed: it is watched from its next heartbeat on. */
void heartbeat_restart(canopen_t *canopen, uint8_t i);

/* Whether any node is watched now. */
bool heartbeat_runs(const canopen_t *canopen);

/* Whether consumer i may have this entry: FW_OK, FW_ERROR_RANGE, or FW_ERROR_MAPPING, since there
 * is one consumer for each node. */
int heartbeat_check(const canopen_t *canopen, uint8_t i, uint32_t wanted);

#endif
