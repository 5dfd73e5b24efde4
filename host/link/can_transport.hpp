#pragma once
// Records as CAN frames on an interface of their own (vcan1): extended identifier, bit 28 direction
// (0 to the firmware), 25-27 axis - 1, 13-24 tick mod 4096, 9-12 and 8 digital inputs 0 to 3 and 4,
// others 0. Data, little-endian: encoder i32, adc0 u16, adc1 u16; without data: sensor values not
// valid. Back: dac i16, outputs u8, tick u16, fault u8, limit reason u8.
#include <linux/can.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

can_frame can_frame_of(const LinkInputs &in);
can_frame can_frame_of(const LinkOutputs &out);

// The record that a frame carries; its tick is known mod 4096 only, of outputs mod 65536. Nothing
// if it is no such frame.
std::optional<LinkInputs> link_inputs_of(const can_frame &frame);
std::optional<LinkOutputs> link_outputs_of(const can_frame &frame);

// Throw TransportError.
std::unique_ptr<PlantTransport> can_plant_transport(const std::string &interface);
std::unique_ptr<AxisTransport> can_axis_transport(const std::string &interface);

}  // namespace forceaxis::host
