#pragma once
// Sends records as CAN frames on an interface that carries no other frames (vcan1). The identifier
// is extended: bit 28 is the direction (0: to the firmware), bits 25 to 27 are axis - 1, bits 13 to
// 24 are the tick modulo 4096, bits 9 to 12 are the digital inputs 0 to 3 and bit 8 is the digital
// input 4. All other bits are 0. Data to the firmware, little-endian: encoder i32, adc0 u16, adc1
// u16; a frame without data means that the sensor values are not valid. Data from the firmware: dac
// i16, outputs u8, tick u16, fault u8, limit reason u8.
//
// Inputs with the report of a drive or with an age are sent in two frames. The first frame is the
// status frame: bit 2 of its identifier is set, its data are drive u8, position age u8 and force
// age u8. In the second frame bit 1 is set. If the status frame of the same tick is missing, the
// second frame has no effect, and the plant repeats both frames. Inputs without report and ages are
// sent in one frame, in which both bits are 0.
#include <linux/can.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

can_frame can_frame_of(const LinkInputs &in);
// Returns the status frame of the inputs, or nothing if drive and ages are 0.
std::optional<can_frame> can_status_frame_of(const LinkInputs &in);
can_frame can_frame_of(const LinkOutputs &out);

// Return the record in a CAN frame, or nothing if the frame does not belong to the link. A frame
// has the tick of inputs modulo 4096 and the tick of outputs modulo 65536. The result of
// link_inputs_of() has no drive and no ages, which CanInputs adds.
std::optional<LinkInputs> link_inputs_of(const can_frame &frame);
std::optional<LinkOutputs> link_outputs_of(const can_frame &frame);

// Combines the two frames of inputs, for all axes of a link.
class CanInputs {
 public:
  // Returns the record that the frame completes. Returns nothing for a status frame, for a second
  // frame without its status frame, and for a frame that does not belong to the link.
  std::optional<LinkInputs> take(const can_frame &frame);

  // Returns the number of frames that do not belong to the link.
  std::uint64_t foreign() const { return foreign_; }

 private:
  std::array<std::optional<LinkInputs>, kMostAxes> status_{};  // latest status frame that each axis
                                                               // has sent
  std::uint64_t foreign_ = 0;
};

// Open the plant's end or the firmware's end of the link. Throw TransportError.
std::unique_ptr<PlantTransport> can_plant_transport(const std::string &interface);
std::unique_ptr<AxisTransport> can_axis_transport(const std::string &interface);

}  // namespace forceaxis::host
