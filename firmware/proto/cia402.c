#include "firmware/proto/cia402.h"

#include "firmware/core/value.h"
#include "firmware/proto/access.h"

void cia402_init(cia402_t *drive) {
  value_store_defaults(&drive->params, AXIS_BLOCK_DRIVE_PARAMETER);
  value_store_defaults(&drive->signals, AXIS_BLOCK_DRIVE_SIGNAL);
}

void cia402_wake(cia402_t *drive, const axis_t *axis) { (void)drive, (void)axis; }
void cia402_before(cia402_t *drive, axis_t *axis) { (void)drive, (void)axis; }
void cia402_after(cia402_t *drive, axis_t *axis) { (void)drive, (void)axis; }

int cia402_check(const cia402_t *drive, const axis_t *axis, uint16_t object, int32_t value) {
  (void)drive, (void)axis, (void)object, (void)value;
  return FW_OK;
}

void cia402_written(cia402_t *drive, axis_t *axis, uint16_t object, int32_t previous,
                    int32_t value) {
  (void)drive, (void)axis, (void)object, (void)previous, (void)value;
}

void cia402_native_mode(cia402_t *drive, axis_t *axis, uint8_t mode) {
  (void)drive, (void)axis, (void)mode;
}

void cia402_fault_reset(cia402_t *drive, axis_t *axis) { (void)drive, (void)axis; }

void cia402_owner_lost(cia402_t *drive, axis_t *axis, uint8_t fault) {
  (void)drive;
  axis_fault(axis, fault);
}
