#pragma once
#include "sim/model/field.hpp"

namespace forceaxis::sim {

class Section;
struct Names;

/// The bus between firmware and drive, as sim/hybrid/drive_bus.hpp describes it.
struct BusCycle {
  int ticks = 1;            ///< period of the frames in ticks: 1, or a multiple of 3
  int delay_ticks_out = 0;  ///< ticks from an output of the firmware to the drive, 0..30
  int delay_ticks_in = 0;   ///< ticks from a measured position to the firmware, 0..30

  /// Returns true if every tick has its own frame in both directions and no frame is late.
  bool immediate() const { return ticks == 1 && delay_ticks_out == 0 && delay_ticks_in == 0; }

  static constexpr auto rows() {
    using namespace format;
    return rows_of(
        field(&BusCycle::ticks,
              integer("cycle_ticks", 1, 300, 1.0,
                      "Cycle of the bus between firmware and drive in ticks of 1/1500 s: 1, or a "
                      "multiple of 3, which is 2 ms. In the first tick of a cycle the firmware's "
                      "output leaves for the drive, which holds it for a cycle, and the encoder is "
                      "measured.")),
        field(&BusCycle::delay_ticks_out,
              integer("delay_ticks_out", 0, 30, 0.0,
                      "Ticks from the output of the firmware to the drive. The drive is disabled "
                      "until the first output arrives.")),
        field(&BusCycle::delay_ticks_in,
              integer("delay_ticks_in", 0, 30, 0.0,
                      "Ticks from the measurement of the encoder to the firmware.")));
  }
};

}  // namespace forceaxis::sim
