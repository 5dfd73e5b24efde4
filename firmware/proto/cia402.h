#ifndef FIRMWARE_PROTO_CIA402_H_
#define FIRMWARE_PROTO_CIA402_H_

/* The CiA 402 drive profile over one axis: state machine, modes of operation, trajectories. It
 * writes the axis' mode and set-points before a tick and reads its signals after it. */

#include <stdint.h>

#include "firmware/core/axis.h"

typedef struct {
  drive_params_t params;
  drive_signals_t signals;
} cia402_t;

/* Power-up: parameters at their defaults, switch on disabled. */
void cia402_init(cia402_t *drive);

/* Takes up the state of an axis that ran without its drive until now. */
void cia402_wake(cia402_t *drive, const axis_t *axis);

/* Before and after axis_tick(). */
void cia402_before(cia402_t *drive, axis_t *axis);
void cia402_after(cia402_t *drive, axis_t *axis);

/* Whether a value within its range may be written now to an object of the drive: FW_OK or
 * FW_ERROR_RANGE, FW_ERROR_STATE. */
int cia402_check(const cia402_t *drive, const axis_t *axis, uint16_t object, int32_t value);

/* An object of the drive was `previous` and now is `value`; a controlword is carried out here. */
void cia402_written(cia402_t *drive, axis_t *axis, uint16_t object, int32_t previous,
                    int32_t value);

/* The native `mode` was written (by the port itself): the state follows. */
void cia402_native_mode(cia402_t *drive, axis_t *axis, uint8_t mode);

/* fault_reset was given outside the controlword. */
void cia402_fault_reset(cia402_t *drive, axis_t *axis);

/* The owner of the axis has gone: what abort_connection_option says, with this fault. */
void cia402_owner_lost(cia402_t *drive, axis_t *axis, uint8_t fault);

#endif
