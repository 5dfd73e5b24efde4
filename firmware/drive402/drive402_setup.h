#ifndef FIRMWARE_DRIVE402_DRIVE402_SETUP_H_
#define FIRMWARE_DRIVE402_DRIVE402_SETUP_H_

/* Configuration of the drive by SDO. The objects of a list are written and compared, one transfer
 * at a time. */

#include "firmware/drive402/drive402_state.h"

/* Returns DRIVE402_NONE, or the reason for which this configuration is refused. */
uint8_t drive402_setup_check(const drive402_config_t *config);

/* Writes to master->entries the list of the objects that the master configures. */
void drive402_setup_list(drive402_t *master);

/* Returns the bit (DRIVE402_WITHOUT_) of an object that the master configures, or 0 for another
 * object. */
uint16_t drive402_object_bit(uint16_t index, uint8_t sub);

/* Computes a tick of the phase DRIVE402_CONFIGURING. Returns true when every object has its
 * value. */
bool drive402_setup_tick(drive402_t *master);

/* Computes a tick of the phase DRIVE402_RUNNING: reads objects that are not in a PDO. These are
 * 6061h, or 603Fh while the drive is in fault. */
void drive402_setup_watch(drive402_t *master);

#endif
