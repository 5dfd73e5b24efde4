#pragma once
// Sends records as CAN frames on an interface that carries no other frames (vcan1). The identifier
// is extended: bit 28 is the direction (0: to the firmware), bits 25 to 27 are axis - 1, bits 13 to
// 24 are the tick modulo 4096, bits 9 to 12 are the digital inputs 0 to 3 and bit 8 is the digital
// input 4. All other bits are 0. Data to the firmware, little-endian: encoder i32, adc0 u16, adc1
// u16; a frame without data means that the sensor values are not valid. Data from the firmware: dac
// i16, outputs u8, tick u16, fault u8, limit reason u8.
#include <linux/can.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

can_frame can_frame_of(const LinkInputs &in);
can_frame can_frame_of(const LinkOutputs &out);

// Return the record in a CAN frame, or nothing if the frame does not belong to the link. A frame
// has the tick of inputs modulo 4096 and the tick of outputs modulo 65536.
std::optional<LinkInputs> link_inputs_of(const can_frame &frame);
std::optional<LinkOutputs> link_outputs_of(const can_frame &frame);

// Open the plant's end or the firmware's end of the link. Throw TransportError.
std::unique_ptr<PlantTransport> can_plant_transport(const std::string &interface);
std::unique_ptr<AxisTransport> can_axis_transport(const std::string &interface);

}  // namespace forceaxis::host
