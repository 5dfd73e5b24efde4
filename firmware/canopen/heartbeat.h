#ifndef FIRMWARE_CANOPEN_HEARTBEAT_H_
#define FIRMWARE_CANOPEN_HEARTBEAT_H_

/* Heartbeat consumers of a CANopen node (1016h). The node monitors another node from the first
 * heartbeat of that node on. If a heartbeat is missing, or if the monitored node sends a boot-up
 * message, the node reports the command sources CANopen, Modbus and LCM on this bus as lost. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

/* CAN identifiers of heartbeats. The identifier of a heartbeat is HEARTBEAT_ID plus the id of the
 * node that sends the heartbeat. */
enum { HEARTBEAT_ID = 0x700, HEARTBEAT_ID_LAST = 0x77F };

void heartbeat_receive(canopen_t *canopen, const can_frame_t *frame);

/* Acts on a missing heartbeat. Call this function when the time of heartbeat consumer i has
 * expired. */
void heartbeat_missed(canopen_t *canopen, uint8_t i);

/* Acts on a change of the entry of heartbeat consumer i. The node in this entry is monitored from
 * the next heartbeat of that node on. */
void heartbeat_restart(canopen_t *canopen, uint8_t i);

/* Returns true if this node now monitors the heartbeat of at least one other node. */
bool heartbeat_runs(const canopen_t *canopen);

/* Checks the entry `wanted` for heartbeat consumer i. Returns FW_OK, FW_ERROR_RANGE, or
 * FW_ERROR_MAPPING if another consumer already monitors the same node. */
int heartbeat_check(const canopen_t *canopen, uint8_t i, uint32_t wanted);

#endif
