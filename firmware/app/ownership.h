#ifndef FIRMWARE_APP_OWNERSHIP_H_
#define FIRMWARE_APP_OWNERSHIP_H_

/* Which bus owns the axis, may write, and is missed when it falls silent: the source lock. canopen
 * owns at power-up. Another bus acquires a disabled axis by writing its own number to
 * command_source, or is given it by its owner, and loses it to canopen when no write of its own is
 * accepted for the time of its watchdog.
 *
 * An owner on CAN (owner_on_can) is lost with CAN too: bus off, NMT stop, a heartbeat that is
 * missed. That is canopen; a client of the gateway: LCM, or a Modbus that acquired the axis through
 * the SDO server 1201h, or enables it through it; and a Modbus that was given the axis. A Modbus on
 * the serial line that writes its number to command_source, while the axis is disabled or another
 * one's, is not on CAN.
 *
 * Every bus may stop the axis. One that another than its owner stopped is held (stopped_by): no
 * controlword enables it until the owner has sent one that does not. So an owner that goes on
 * sending the same 000Fh does not start it again. The port itself is not held. */

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

/* A source wrote a controlword in place of `previous`. Of a source that does not own the axis it
 * can only stop it (cia402_stop()), and the owner's stays; so can an owner's that enables, while
 * the axis is held by such a stop. */
void ownership_command(fw_t *fw, uint8_t source, uint16_t previous, uint16_t controlword);

/* A source wrote the native mode `disabled`, which is about to be carried out. */
void ownership_disabled(fw_t *fw, uint8_t source);

/* CAN stops an axis that another bus owns (NMT, bus off), with the fault `fault` (AXIS_FAULT_) if
 * abort_connection_option says so. */
void ownership_stopped(fw_t *fw, uint8_t fault);

/* A parameter of the device was written: command_source or watchdog. */
void ownership_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                       int32_t value);

/* What watches the owner, or whether it must be watched, was written: an axis that is enabled for a
 * CANopen whose end nobody would notice any more is disabled as by its loss (source_lost) where
 * unsupervised_owner is refused, else it is warned of. */
void ownership_judge_watch(fw_t *fw);

/* The owner can no longer reach the axis, for the reason `fault` (AXIS_FAULT_). */
void ownership_lost(fw_t *fw, uint8_t fault);

/* Whether the end of the sources in the set `lost` (bits of FW_SOURCE_) on CAN is the owner's. */
bool ownership_ends(const fw_t *fw, uint8_t lost);

/* Parts of ownership_tick(). */
void ownership_watch_canopen(fw_t *fw);
void ownership_watch_warning(fw_t *fw); /* it ends when the owner is watched */
void ownership_time_out(fw_t *fw);

/* Once a tick, before the drive: an owner that is silent for too long loses the axis. */
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
