#pragma once
// What canopen_model.py must be given of the drive to predict the lock and its emergencies.
#include <cstdint>

#include "firmware/port/host/firmware.hpp"

extern "C" {
#include "firmware/drive/state.h"
}

// Taken before a frame; compared after it, by exactly one call of bits().
class DriveBefore {
 public:
  // A frame with an SDO request may read the history of emergencies, so it has `marks` false. It
  // has one effect at most, which the state of the drive shows.
  DriveBefore(fw_t &fw, bool marks)
      : moves_(cia402_is_powered(fw.drive.signals.drive_state) ||
               fw.axis.signals.active_mode != AXIS_MODE_DISABLED),
        warned_(fw.drive.unsupervised != 0),
        marks_(marks),
        stopped_by_(fw.drive.signals.stopped_by) {
    if (!marks_) return;
    for (std::uint32_t &entry : fw.canopen.signals.error_history) entry |= kMark;
  }

  // Bit 0: the axis could move before the frame. Bit 1: the frame enabled the axis for a master
  // that is not supervised. One SYNC, or one frame for two RPDOs, may both enable and disable the
  // axis: then only a new entry in the history of emergencies shows it. Removes the marks.
  std::uint8_t bits(fw_t &after) const {
    bool enabled = !warned_ && after.drive.unsupervised != 0;
    for (std::uint32_t &entry : after.canopen.signals.error_history) {
      const bool is_warning = (entry & 0xFFFF) == AXIS_ERROR_CODE_OWNER_UNSUPERVISED;
      enabled = enabled || (marks_ && is_warning && (entry & kMark) == 0);
      entry &= ~kMark;
    }
    return static_cast<std::uint8_t>((moves_ ? 1 : 0) | (enabled ? 2 : 0));
  }
  // Who stopped it with the frame.
  std::uint8_t stopper(const fw_t &after) const {
    return stopped_by_ == AXIS_STOPPED_BY_NOBODY ? after.drive.signals.stopped_by : std::uint8_t{0};
  }

 private:
  // A bit that no entry of the history has: marks the entries that were there before the frame.
  static constexpr std::uint32_t kMark = UINT32_C(1) << 31;

  bool moves_, warned_, marks_;
  std::uint8_t stopped_by_;
};

// True for a frame that can hold no SDO request.
inline bool is_no_request(std::uint16_t can_id) { return can_id < 0x580; }
