#pragma once
// What canopen_model.py must be given of the drive to predict the lock and its emergencies.
#include <cstdint>

#include "firmware/port/host/firmware.hpp"

extern "C" {
#include "firmware/drive/state.h"
}

// Taken before a frame; compared after it.
struct DriveBefore {
  explicit DriveBefore(const fw_t &fw)
      : moves(cia402_is_powered(fw.drive.signals.drive_state) ||
              fw.axis.signals.active_mode != AXIS_MODE_DISABLED),
        warned(fw.drive.unsupervised != 0),
        warnings(WarningsIn(fw)),
        stopped_by(fw.drive.signals.stopped_by) {}

  // Bit 0: could move before; bit 1: the frame enabled it for a master that is not supervised. One
  // SYNC may enable it and disable it again: then only the history knows.
  std::uint8_t bits(const fw_t &after) const {
    const bool enabled = after.drive.unsupervised != 0 || WarningsIn(after) > warnings;
    return static_cast<std::uint8_t>((moves ? 1 : 0) | (!warned && enabled ? 2 : 0));
  }
  // Who stopped it with the frame.
  std::uint8_t stopper(const fw_t &after) const {
    return stopped_by == AXIS_STOPPED_BY_NOBODY ? after.drive.signals.stopped_by : std::uint8_t{0};
  }

  // Of the unsupervised owner, in the history of emergencies.
  static int WarningsIn(const fw_t &fw) {
    int count = 0;
    for (const std::uint32_t entry : fw.canopen.signals.error_history) {
      count += (entry & 0xFFFF) == AXIS_ERROR_CODE_OWNER_UNSUPERVISED ? 1 : 0;
    }
    return count;
  }

  bool moves, warned;
  int warnings;
  std::uint8_t stopped_by;
};
