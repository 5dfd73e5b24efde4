#ifndef FIRMWARE_APP_OWNERSHIP_H_
#define FIRMWARE_APP_OWNERSHIP_H_

/* Ownership of the axis: which bus owns the axis, which bus may write, and what happens when the
 * owner no longer writes. Canopen owns the axis at power-up. Another bus acquires a disabled axis
 * by writing its own number to command_source, or receives the axis from the owner. This bus loses
 * the axis to canopen if none of its own writes is accepted for the time of its watchdog. A write
 * to an object that every bus may write (dictionary_is_open()) does not count.
 *
 * An owner on CAN (owner_on_can) also loses the axis when CAN fails: bus off, NMT stop, or a
 * missing heartbeat. The following owners are on CAN: canopen; a client of the gateway, which is
 * LCM or a Modbus client that acquired or enabled the axis through the SDO server 1201h; and a
 * Modbus client that received the axis from the owner before. A Modbus client on the serial line is
 * not on CAN if it wrote its number to command_source while the axis was disabled or belonged to
 * another bus.
 *
 * Every bus may stop the axis. After a stop by a bus that is not the owner, stopped_by names this
 * bus, and no controlword enables the axis until the owner has sent a controlword that does not
 * enable the axis. So an owner that continues to send 000Fh does not enable the axis again. A stop
 * by FW_SOURCE_LOCAL does not have this effect. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

/* Returns the firmware (fw_t) that contains this object dictionary. */
static inline fw_t *fw_of(dictionary_t *objects) {
  void *fw = objects;
  return fw;
}
static inline const fw_t *fw_of_const(const dictionary_t *objects) {
  const void *fw = objects;
  return fw;
}

/* Checks whether a command source may now write `value` to an existing object. Returns FW_OK;
 * FW_ERROR_LOCKED; FW_ERROR_STATE if the column `writable` or `in_cycle` of the object table
 * forbids the write; or FW_ERROR_BUSY while the parameter store is working. */
int ownership_permit(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Handles a new controlword of a command source; `previous` is the old controlword. A source that
 * does not own the axis can only stop the axis with a controlword (cia402_stop()), and the
 * controlword of the owner stays active. After such a stop, a controlword of the owner that would
 * enable the axis also only stops the axis. */
void ownership_command(fw_t *fw, uint8_t source, uint16_t previous, uint16_t controlword);

/* Call ownership_disabled() when a command source has written the native mode `disabled`, before
 * the axis is disabled. */
void ownership_disabled(fw_t *fw, uint8_t source);

/* Stops an axis whose owner is not canopen. Call ownership_stopped() after an NMT command that
 * stops the node, or after bus off on CAN. Raises the fault `fault` (AXIS_FAULT_) if
 * abort_connection_option selects a fault. */
void ownership_stopped(fw_t *fw, uint8_t fault);

/* Acts on an accepted write to a parameter of the device, for example command_source or
 * watchdog. */
void ownership_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                       int32_t value);

/* Call ownership_check_watch() after a write that may change whether the firmware detects the loss
 * of the owner. If canopen owns an enabled axis and a loss of canopen would not be detected,
 * unsupervised_owner selects the reaction: only a warning, or the fault source_lost, which disables
 * the axis. */
void ownership_check_watch(fw_t *fw);

/* Call ownership_lost() when the owner can no longer reach the axis. `fault` (AXIS_FAULT_) is the
 * reason. */
void ownership_lost(fw_t *fw, uint8_t fault);

/* Returns true if the owner is on CAN and is one of the lost command sources `lost`, a set of
 * FW_SOURCE_ bits. */
bool ownership_ends(const fw_t *fw, uint8_t lost);

/* The following functions are the steps of ownership_tick(). */
void ownership_watch_canopen(fw_t *fw);
/* Ends the warning about an unsupervised owner when the loss of the owner would be detected
 * again. */
void ownership_watch_warning(fw_t *fw);
void ownership_time_out(fw_t *fw);

/* Call ownership_tick() once in each tick, before the drive is computed. An owner other than
 * canopen loses the axis if it has written nothing for longer than the time in the object
 * watchdog. */
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
