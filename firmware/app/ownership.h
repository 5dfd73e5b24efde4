#ifndef FIRMWARE_APP_OWNERSHIP_H_
#define FIRMWARE_APP_OWNERSHIP_H_

/* Ownership of the axis: which bus owns it, which bus may write, and what happens when the owner
 * falls silent. Canopen owns the axis at power-up. Another bus acquires a disabled axis by writing
 * its own number to command_source, or receives it from its owner. It loses the axis to canopen if
 * none of its own writes is accepted for the time of its watchdog.
 *
 * An owner on CAN (owner_on_can) also loses the axis when CAN fails: bus off, NMT stop, or a
 * missing heartbeat. Owners on CAN are canopen; a client of the gateway, which is LCM or a Modbus
 * client that acquired or enabled the axis through the SDO server 1201h; and a Modbus client that
 * received the axis from its owner. A Modbus client on the serial line is not on CAN if it wrote
 * its number to command_source while the axis was disabled or belonged to another bus.
 *
 * Every bus may stop the axis. After a stop by a bus that is not the owner, stopped_by names this
 * bus, and no controlword enables the axis until the owner has sent a controlword that does not
 * enable it. So an owner that continues to send 000Fh does not start the axis again. A stop by the
 * port itself does not have this effect. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

/* Returns the firmware that contains a dictionary. */
static inline fw_t *fw_of(dictionary_t *objects) {
  void *fw = objects;
  return fw;
}
static inline const fw_t *fw_of_const(const dictionary_t *objects) {
  const void *fw = objects;
  return fw;
}

/* Whether a source may write this value to an existing object now: FW_OK, FW_ERROR_LOCKED,
 * FW_ERROR_STATE (the column `writable` of the object table forbids it) or FW_ERROR_BUSY (the store
 * is working). */
int ownership_permit(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Acts on a controlword that a source has written in place of `previous`. If the source does not
 * own the axis, its controlword can only stop the axis (cia402_stop()), and the controlword of the
 * owner stays active. After such a stop this also applies to a controlword of the owner that
 * enables. */
void ownership_command(fw_t *fw, uint8_t source, uint16_t previous, uint16_t controlword);

/* A source has written the native mode `disabled`, which is carried out afterwards. */
void ownership_disabled(fw_t *fw, uint8_t source);

/* CAN stops an axis that another bus owns (NMT, bus off). The fault `fault` (AXIS_FAULT_) is raised
 * if abort_connection_option selects a fault. */
void ownership_stopped(fw_t *fw, uint8_t fault);

/* Acts on a write to a parameter of the device: command_source or a watchdog. */
void ownership_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                       int32_t value);

/* Acts on a write that changes how the loss of the owner is detected, or whether it must be
 * detected. If the owner is canopen and its loss would no longer be detected, an enabled axis is
 * disabled with the fault source_lost if unsupervised_owner is refused; otherwise a warning is
 * shown. */
void ownership_check_watch(fw_t *fw);

/* The owner can no longer reach the axis; `fault` (AXIS_FAULT_) is the reason. */
void ownership_lost(fw_t *fw, uint8_t fault);

/* Whether the loss on CAN of the sources in the set `lost` (bits of FW_SOURCE_) includes the
 * owner. */
bool ownership_ends(const fw_t *fw, uint8_t lost);

/* Parts of ownership_tick(). */
void ownership_watch_canopen(fw_t *fw);
/* the warning ends when a loss of the owner would be detected again */
void ownership_watch_warning(fw_t *fw);
void ownership_time_out(fw_t *fw);

/* Call it once in each tick, before the drive. An owner that has been silent for too long loses the
 * axis. */
static inline void ownership_tick(fw_t *fw) {
  const uint8_t owner = fw->device.command_source;
  if (owner == AXIS_COMMAND_SOURCE_CANOPEN) {
    if (fw->canopen.heartbeats_lost != 0) {
      ownership_watch_canopen(fw);
    }
    if (fw->drive.unsupervised != 0) {
      ownership_watch_warning(fw);
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
