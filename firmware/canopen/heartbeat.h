#ifndef FIRMWARE_CANOPEN_HEARTBEAT_H_
#define FIRMWARE_CANOPEN_HEARTBEAT_H_

/* Heartbeat consumers of a CANopen node (1016h). A node is monitored from its first heartbeat on.
 * If a heartbeat is missing, or after a boot-up message, canopen counts as lost, and so do the
 * clients of a gateway. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

/* Identifiers of heartbeats: HEARTBEAT_ID plus the node id. */
enum { HEARTBEAT_ID = 0x700, HEARTBEAT_ID_LAST = 0x77F };

void heartbeat_receive(canopen_t *canopen, const can_frame_t *frame);

/* The time of heartbeat consumer i has expired without a heartbeat. */
void heartbeat_missed(canopen_t *canopen, uint8_t i);

/* The entry of heartbeat consumer i has changed: its node is monitored from the next heartbeat
 * on. */
void heartbeat_restart(canopen_t *canopen, uint8_t i);

/* Whether the heartbeat of any node is monitored now. */
bool heartbeat_runs(const canopen_t *canopen);

/* Whether heartbeat consumer i may have this entry: FW_OK, FW_ERROR_RANGE, or FW_ERROR_MAPPING if
 * another consumer already monitors the node. */
int heartbeat_check(const canopen_t *canopen, uint8_t i, uint32_t wanted);

#endif
