#pragma once
// One axis of the gateway. As CANopen master, the gateway configures, monitors and polls the axis,
// and publishes the state of the axis over LCM.
//
// Only the master uses the default SDO channel: for the configuration, for polling and for uploads
// of the recorder. Writes over the default channel have the source CANopen. The SDO channels of LCM
// and Modbus transfer only the requests of LCM and Modbus clients, so only the writes of a client
// restart the watchdog of the axis. The SDO servers of these two channels are off until the gateway
// has configured their identifiers, and after a reset of the node. While they are off, reads and
// stops use the default channel, and all other writes are refused.
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/gateway/object_port.hpp"
#include "host/gateway/publisher.hpp"

extern "C" {
#include "firmware/objects/generated/axis_gateway.h"
}

namespace forceaxis::nodes {

struct AxisSettings {
  // Node id of the axis, which is also the number of its Modbus unit and LCM channel.
  int number = 1;
  // Node id of the gateway.
  int master = AXIS_GATEWAY_NODE_ID;
  // First of four CAN identifiers, with which the axis serves the SDO channels for LCM and Modbus.
  std::uint32_t first_sdo = AXIS_GATEWAY_FIRST_SDO;
  // Heartbeat period of the axis and of the gateway.
  std::chrono::milliseconds heartbeat{100};
  // Time without heartbeats of the gateway after which the axis disables the drive.
  std::chrono::milliseconds watch{300};
  std::chrono::milliseconds sdo_timeout{500};
  std::chrono::milliseconds poll{10};  // time from one read of a polled object to the next read
  struct Parameter {
    std::uint16_t object;
    std::int64_t raw;
  };
  // Parameters that the gateway writes at each configuration of the axis.
  std::vector<Parameter> parameters;
};

class GatewayAxis {
 public:
  GatewayAxis(EventLoop &loop, lcm_bus::AxisChannels &lcm, SdoChannel::Send send,
              const AxisSettings &settings);

  int number() const { return settings_.number; }
  // Starts configuration, polling and monitoring of the axis, which continue until the event loop
  // is abandoned.
  void start();

  // Processes a frame from the CAN bus. Frames of other nodes are ignored.
  void receive(const canopen::Frame &frame);
  // Publishes the state that the axis has sent after the previous SYNC. To be called before each
  // SYNC.
  void before_sync();
  // Reports a lost heartbeat. To be called once in each period, after all received frames were
  // processed.
  void watch_heartbeat(std::chrono::milliseconds period);

  // To be called after a Modbus client of this gateway has written the owner of the axis. A Modbus
  // owner is then a client of this gateway, and not a client on the serial line of the axis.
  void acquired_by_modbus() { modbus_is_ours_ = true; }

  // Stops the axis if its owner is CANopen or a client of the gateway, because this owner loses its
  // connection. Then makes CANopen the owner, and ends the heartbeat monitoring of the gateway in
  // the axis.
  Task<void> shut_down();

  // Returns true if the axis answers, has the same object table as this program, and has open SDO
  // channels for LCM and Modbus.
  bool writes_allowed() const {
    return table_known_ && !mismatch_ && channels_open() && !is_stopped();
  }
  // Returns true if NMT has stopped the node, which then answers no SDO request.
  bool is_stopped() const { return nmt_state_ == axis_state_t::NMT_STOPPED; }
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
  bool keep_started();
  Task<bool> set_up();
  Task<bool> identify();
  Task<bool> open_channels();
  Task<bool> watch_each_other();
  Task<bool> set_up_pdo(int pdo);
  Task<bool> set_parameters();
  // Writes a value unless the object already has this value. Returns false if the write fails. The
  // configuration of the axis then ends and is repeated.
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

  bool present_ = false;  // true: the axis is present: it answers requests or sends heartbeats
  bool reported_waiting_ = false;
  bool reported_locked_ = false;
  bool heartbeats_ = false;  // true: the axis sends heartbeats
  bool modbus_is_ours_ = false;
  bool table_known_ = false;
  bool mismatch_ = false;
  bool published_ = true;  // true: the state of the axis after the last SYNC was published
  std::int64_t table_hash_ = lcm_bus::kNotAvailable;
  std::int64_t nmt_state_ = axis_state_t::NMT_SILENT;
  Time heard_;    // time at which the latest heartbeat of the node was received
  Time started_;  // time at which the latest NMT command was sent to the node
  std::uint64_t boots_ = 1, set_up_boots_ = 0, open_boots_ = 0;
  std::chrono::milliseconds silence_{0};  // time since the last heartbeat of the axis
  std::size_t next_poll_ = 0;
};

}  // namespace forceaxis::nodes
