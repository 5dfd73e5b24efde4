#ifndef FIRMWARE_DRIVE402_DRIVE402_CYCLE_H_
#define FIRMWARE_DRIVE402_DRIVE402_CYCLE_H_

/* Cyclic frames of the master: SYNC, RPDO with controlword and target, and the TPDO of the drive.
 */

#include "firmware/drive402/drive402_state.h"

/* Initialises the bus cycle, which then begins in the next tick. The drive is stopped at this
 * time. */
void drive402_cycle_start(drive402_t *master);

/* Computes the cyclic frames of a tick. At the begin of a bus cycle, sends SYNC and RPDO. When the
 * drive must stop, sends an RPDO at once. */
void drive402_cycle_tick(drive402_t *master, const drive402_command_t *command);

/* Processes a TPDO of the drive. A frame before the first SYNC is ignored. A frame whose length
 * differs from that of the TPDO is also ignored. */
void drive402_cycle_receive(drive402_t *master, const can_frame_t *frame);

#endif
