#ifndef FIRMWARE_DRIVE_PARAMETERS_H_
#define FIRMWARE_DRIVE_PARAMETERS_H_

/* Parameters of the drive: checks whether values are consistent with each other, and values that
 * are computed from the parameters. The drive computes these values when a parameter is written,
 * because the computation would take too long in every tick. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"

/* Reactions of the drive when it must stop the axis. ABORT_: values of abort_connection_option
 * (6007h). QUICK_STOP_: values of quick_stop_option (605Ah). STOP_: values that the other option
 * codes (605Bh to 605Eh) have in common. */
enum { ABORT_NOTHING = 0, ABORT_FAULT = 1, ABORT_DISABLE = 2, ABORT_QUICK_STOP = 3 };
enum { QUICK_STOP_DISABLE = 0, QUICK_STOP_SLOW = 1, QUICK_STOP_STAY = 5 };
enum { STOP_AT_ONCE = 0, STOP_SLOW = 1, STOP_QUICK = 2 };

/* Computes all values that depend on the parameters: the user units, the speeds and accelerations
 * of the trajectory, the ratio of per mille of rated_force to counts of the measured force, and the
 * available homing methods. */
void parameters_derive(cia402_t *drive);

/* Computes the values that are derived from the changed parameter `object` (AXIS_OBJ_). Returns
 * true if earlier written targets have another meaning after the change. */
bool parameters_written(cia402_t *drive, uint16_t object);

/* Checks whether `value` may be written to an object of the drive. The value is within the range of
 * the object. Returns FW_OK or FW_ERROR_RANGE. */
int cia402_check(const cia402_t *drive, uint16_t object, int32_t value);

/* Restricts a force law that has no certificate, or removes this restriction. In every mode that
 * controls force, the restriction limits the demanded force to `force` per mille of force_limit,
 * limits the DAC code of the law to +-`output`, and shows a warning. */
void cia402_restrict_law(cia402_t *drive, uint16_t force, uint16_t output);
void cia402_release_law(cia402_t *drive);

#endif
