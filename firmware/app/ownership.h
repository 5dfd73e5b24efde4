#ifndef FIRMWARE_APP_OWNERSHIP_H_
#define FIRMWARE_APP_OWNERSHIP_H_

/* The source lock: which bus owns the axis, may write, and is supervised. canopen
 * owns at power-up. Another bus acquires the axis by writing its own number to command_source, and
 * loses it to canopen when no write of its own is accepted for the time of its watchdog. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

/* The firmware around its dictionary. */
static inline fw_t *fw_of(dictionary_t *objects) {
  void *fw = objects;
  return fw;
}
static inline const fw_t *fw_of_const(const dictionary_t *objects) {
  const void *fw = objects;
  return fw;
}

/* Whether this source may write this value now: FW_OK, FW_ERROR_LOCKED, FW_ERROR_STATE (the
 * object's `writable` column) or FW_ERROR_BUSY (the store is at work). The object exists. */
int ownership_permit(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* A parameter of the device was written: command_source or watchdog. */
void ownership_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                       int32_t value);

/* The owner can no longer reach the axis, for the reason `fault` (AXIS_FAULT_). */
void ownership_lost(fw_t *fw, uint8_t fault);

/* Parts of ownership_tick(). */
void ownership_watch_canopen(fw_t *fw);
void ownership_time_out(fw_t *fw);

/* Once a tick, before the drive: an owner that is silent for too long loses the axis. */
static inline void ownership_tick(fw_t *fw) {
  const uint8_t owner = fw->device.command_source;
  if (owner == AXIS_COMMAND_SOURCE_CANOPEN) {
    if (fw->canopen.heartbeats_lost != 0) {
      ownership_watch_canopen(fw);
    }
    return;
  }
  const bool wrote = (fw->objects.writers & fx_bit(owner)) != 0;
  fw->objects.writers = 0;
  fw->source_silence = wrote ? 1 : fw->source_silence + 1;
  if (fw->source_silence > fx_ticks_from_ms(fw->device.watchdog)) {
    ownership_time_out(fw);
  }
}

#endif
