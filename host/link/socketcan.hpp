#pragma once
// Records as CAN frames on an interface of their own (vcan1): extended identifier, bit 28 direction
// (0 to the firmware), 25-27 axis - 1, 13-24 tick mod 4096, 9-12 digital inputs, others 0. Data,
// little-endian: encoder i32, adc0 u16, adc1 u16; without data: sensor values not valid. Back: dac
// i16, outputs u8, tick u16, fault u8, limit reason u8.
#include <linux/can/raw.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

can_frame can_frame_of(const LinkInputs &in);
can_frame can_frame_of(const LinkOutputs &out);

// The records as far as the frame says: the tick is given mod 4096, of outputs mod 65536. Nothing
// if it is no such frame.
std::optional<LinkInputs> link_inputs_of(const can_frame &frame);
std::optional<LinkOutputs> link_outputs_of(const can_frame &frame);

// A bound raw socket. Throws TransportError: no AF_CAN, no such interface or it is down.
int open_can(const std::string &interface);

// An interface, whose frames have no run number, carries one plant and every axis once; a run over
// LCM has one plant an axis. The claim ends with the object, or with the process however that ends;
// one that is just ending is waited for. Throws TransportError naming `where`. Network namespaces
// do not see each other's.
class LinkClaim {
 public:
  LinkClaim(const std::string &where, const std::string &role);
  ~LinkClaim();
  LinkClaim(const LinkClaim &) = delete;
  LinkClaim &operator=(const LinkClaim &) = delete;

 private:
  int socket_;
};

std::unique_ptr<PlantTransport> can_plant_transport(const std::string &interface);
std::unique_ptr<AxisTransport> can_axis_transport(const std::string &interface);

}  // namespace forceaxis::host
