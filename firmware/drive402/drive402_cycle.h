#ifndef FIRMWARE_DRIVE402_DRIVE402_CYCLE_H_
#define FIRMWARE_DRIVE402_DRIVE402_CYCLE_H_

/* Cyclic frames of the master: SYNC, RPDO with controlword and target, and the TPDO of the drive.
 */

#include "firmware/drive402/drive402_state.h"

/* Begins the cycle at the next tick, with the drive stopped. */
void drive402_cycle_start(drive402_t *master);

/* A tick in the phases STARTING and RUNNING: SYNC and RPDO at the begin of a cycle, an RPDO at once
 * when the drive has to stop. */
void drive402_cycle_tick(drive402_t *master, const drive402_command_t *command);

/* Processes a TPDO of the drive. A frame without exactly 8 bytes, or before the first
 * SYNC, is ignored. */
void drive402_cycle_receive(drive402_t *master, const can_frame_t *frame);

#endif
