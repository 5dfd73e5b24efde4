#pragma once
// One axis of the gateway. As CANopen master, the gateway sets up the axis, monitors and polls it,
// and publishes its state over LCM.
//
// The default SDO channel belongs to the master: it carries set-up, polling and uploads of the
// recorder, and counts as CANopen. The SDO channels of LCM and Modbus carry only requests of their
// clients, so only the writes of a client trigger the watchdog of the axis. The SDO servers of
// these channels are off until the set-up has given them identifiers, and a reset of the node
// switches them off again. Without these channels, reads and stops use the default channel, and all
// other writes are refused.
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/gateway/object_port.hpp"
#include "host/gateway/publisher.hpp"

extern "C" {
#include "firmware/objects/generated/axis_objects.h"
}

namespace forceaxis::nodes {

struct AxisSettings {
  int number = 1;    // node id of the axis, also its Modbus unit and LCM channel
  int master = 127;  // node id of the gateway
  // First of the four CAN identifiers of the SDO channels of the axis.
  std::uint32_t first_sdo = 0x680;
  std::chrono::milliseconds heartbeat{100};  // heartbeat period of axis and gateway
  // Time without heartbeat of the gateway after which the axis disables itself.
  std::chrono::milliseconds watch{300};
  std::chrono::milliseconds sdo_timeout{500};
  std::chrono::milliseconds poll{10};  // time between the reads of two polled objects
  struct Parameter {
    std::uint16_t object;
    std::int64_t raw;
  };
  std::vector<Parameter> parameters;  // parameters that the gateway writes at each set-up of the
                                      // axis
};

class GatewayAxis {
 public:
  GatewayAxis(EventLoop &loop, lcm_bus::AxisChannels &lcm, SdoChannel::Send send,
              const AxisSettings &settings);

  int number() const { return settings_.number; }
  // Starts set-up, polling and monitoring. They continue until the loop is abandoned.
  void start();

  // Processes a frame from the bus. Frames of other nodes are ignored.
  void receive(const canopen::Frame &frame);
  // To be called before a SYNC is sent: publishes the state that followed the previous SYNC.
  void before_sync();
  // To be called once in each period, after all received frames. Reports a lost heartbeat.
  void watch_heartbeat(std::chrono::milliseconds period);

  // To be called after a client of this gateway has written the owner of the axis. If the owner is
  // then Modbus, it is a client of the gateway and not a client on the serial line of the axis.
  void acquired_by_modbus() { modbus_is_ours_ = true; }

  // Stops the axis if its owner is CANopen or a client of the gateway, because this owner will lose
  // its connection. Then makes CANopen the owner, and ends the monitoring of the gateway's
  // heartbeat by the axis.
  Task<void> shut_down();

  // Returns true if the axis has the object table of this program, is not silent, and has open SDO
  // channels for the clients.
  bool writes_allowed() const { return table_known_ && !mismatch_ && channels_open(); }
  bool mismatch() const { return mismatch_; }
  std::int64_t table_hash() const { return table_hash_; }
  bool present() const { return present_; }

  ObjectPort master_port() { return ObjectPort(master_); }
  SdoChannel &master_channel() { return master_; }
  ObjectPort modbus_port() { return ObjectPort(channels_open() ? modbus_ : master_); }
  ObjectPort lcm_port() { return ObjectPort(channels_open() ? lcm_channel_ : master_); }

  AxisPublisher &publisher() { return publisher_; }
  const AxisPublisher &publisher() const { return publisher_; }

 private:
  using Time = EventLoop::Time;

  Task<void> supervise();
  Task<bool> find();
  Task<bool> set_up();
  Task<bool> identify();
  Task<bool> open_channels();
  Task<bool> watch_each_other();
  Task<bool> set_up_pdo(int pdo);
  Task<bool> set_parameters();
  // Writes a value unless the object already has it. Returns false if this fails; the set-up then
  // ends and starts again.
  Task<bool> ensure(ObjectAddress address, std::int64_t value, std::string_view what);
  Task<bool> set(ObjectAddress address, std::int64_t value, std::string_view what);
  bool failed(const ObjectResult &result, std::string_view what);
  Task<void> poll_next();
  Task<bool> give_to_canopen(std::int64_t owner);

  bool channels_open() const { return open_boots_ == boots_; }
  void receive_heartbeat(std::uint8_t state);
  void lose(const std::string &why, std::int64_t milliseconds);
  void receive_emergency(const canopen::Frame &frame);
  void receive_pdo(int pdo, const canopen::Frame &frame);
  void publish_state();

  EventLoop &loop_;
  AxisPublisher publisher_;
  SdoChannel::Send send_;
  AxisSettings settings_;
  SdoChannel master_, modbus_, lcm_channel_;

  bool present_ = false;  // The axis answers requests or sends heartbeats.
  bool reported_waiting_ = false;
  bool reported_locked_ = false;
  bool heartbeats_ = false;  // The axis sends heartbeats.
  bool modbus_is_ours_ = false;
  bool table_known_ = false;
  bool mismatch_ = false;
  bool published_ = true;  // The state was published after the last SYNC.
  std::int64_t table_hash_ = lcm_bus::kNotAvailable;
  std::int64_t nmt_state_ = axis_state_t::NMT_SILENT;
  std::uint64_t boots_ = 1, set_up_boots_ = 0, open_boots_ = 0;
  std::chrono::milliseconds silence_{0};  // time since the last heartbeat of the axis
  std::size_t next_poll_ = 0;
};

}  // namespace forceaxis::nodes
