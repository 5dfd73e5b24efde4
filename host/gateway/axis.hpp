#pragma once
// One axis as its gateway sees it: set up, watched and polled as CANopen master, published over
// LCM.
//
// The default SDO channel is the master's own: set-up, polling, uploads of the recorder. It counts
// as CANopen. The channels of LCM and Modbus carry nothing but what their clients asked for: the
// watchdog of the axis is fed by what a client writes, and by nothing of the gateway's own. Their
// servers are off until the set-up gives them identifiers, and forgotten by a reset of the node;
// meanwhile reads and stops go over the default channel, and nothing else is written.
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
  int number = 1;                            // node id, unit id, channel
  int master = 127;                          // node id of the gateway
  std::uint32_t first_sdo = 0x680;           // first of the identifiers of its SDO channels
  std::chrono::milliseconds heartbeat{100};  // of axis and gateway
  std::chrono::milliseconds watch{300};      // how long the axis waits for the gateway's
  std::chrono::milliseconds sdo_timeout{500};
  std::chrono::milliseconds poll{10};  // from one polled object to the next
  struct Parameter {
    std::uint16_t object;
    std::int64_t raw;
  };
  std::vector<Parameter> parameters;  // written at each set-up
};

class GatewayAxis {
 public:
  GatewayAxis(EventLoop &loop, lcm_bus::AxisChannels &lcm, SdoChannel::Send send,
              const AxisSettings &settings);

  int number() const { return settings_.number; }
  // Set-up, polling and watching go on until the loop is abandoned.
  void start();

  // A frame from the bus; those of other nodes are ignored.
  void receive(const canopen::Frame &frame);
  // A SYNC is about to be sent: publishes the state that the last one brought.
  void before_sync();
  // To be called once a period, after all received frames: reports a lost heartbeat.
  void watch_heartbeat(std::chrono::milliseconds period);

  // A client of this gateway wrote the owner of the axis: should that be Modbus, it is a client
  // here and not one on the axis' serial line.
  void acquired_by_modbus() { modbus_is_ours_ = true; }

  // Stops the axis if CANopen or a client of the gateway owns it, who cannot reach it any more.
  // Then gives it to CANopen, and ends its watch for the gateway's heartbeat.
  Task<void> shut_down();

  // The axis has this program's object table, is not silent, and serves the clients' channels.
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
  // Writes unless it is there already. False: the set-up ends here, and begins again.
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

  bool present_ = false;  // it answers or sends heartbeats
  bool reported_waiting_ = false;
  bool reported_locked_ = false;
  bool heartbeats_ = false;  // it sends them
  bool modbus_is_ours_ = false;
  bool table_known_ = false;
  bool mismatch_ = false;
  bool published_ = true;  // since the last SYNC
  std::int64_t table_hash_ = lcm_bus::kNotAvailable;
  std::int64_t nmt_state_ = axis_state_t::NMT_SILENT;
  std::uint64_t boots_ = 1, set_up_boots_ = 0, open_boots_ = 0;
  std::chrono::milliseconds silence_{0};  // since the last heartbeat
  std::size_t next_poll_ = 0;
};

}  // namespace forceaxis::nodes
