#include "host/link/lcm_transport.hpp"

#include <lcm/lcm.h>
#include <poll.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <forceaxis/link_inputs_t.hpp>   // header that is generated from host/lcm
#include <forceaxis/link_outputs_t.hpp>  // header that is generated from host/lcm
#include <map>
#include <optional>
#include <type_traits>

#include "host/lcm/lcm_ends.hpp"
#include "host/lcm/receiver.hpp"
#include "host/lcm/url.hpp"

extern "C" {
#include "firmware/fx/fx.h"
}

namespace forceaxis::host {
namespace {

constexpr std::int64_t kFirstPort = 20000, kPorts = 40000;

std::int64_t microseconds_at(std::int64_t tick) { return tick * 1000000 / FX_TICK_RATE_HZ; }

link_inputs_t message_of(const LinkInputs &in) {
  link_inputs_t m{};
  m.encoder = in.encoder_cnt;
  m.adc0 = in.adc0_code;
  m.adc1 = in.adc1_code;
  m.digital_inputs = in.din;
  m.sensor_valid = in.sensor_valid != 0;
  m.drive = in.drive;
  m.position_age = in.position_age;
  m.force_age = in.force_age;
  return m;
}

link_outputs_t message_of(const LinkOutputs &out) {
  link_outputs_t m{};
  m.dac = out.dac_code;
  m.outputs = out.out;
  m.fault = out.fault;
  m.limit_reason = out.limit_reason;
  return m;
}

LinkInputs record_of(const link_inputs_t &m, std::uint8_t axis) {
  return {m.seq,
          m.encoder,
          static_cast<std::uint16_t>(m.adc0),
          static_cast<std::uint16_t>(m.adc1),
          m.digital_inputs,
          static_cast<std::uint8_t>(m.sensor_valid ? 1 : 0),
          axis,
          m.drive,
          m.position_age,
          m.force_age};
}

LinkOutputs record_of(const link_outputs_t &m, std::uint8_t axis) {
  return {m.seq, m.dac, m.outputs, m.fault, m.limit_reason, axis};
}

std::string channel(bool inputs, int axis) {
  return "AXIS_" + std::to_string(axis) + (inputs ? "_LINK_INPUTS" : "_LINK_OUTPUTS");
}

template <class Out, class In>
class LcmTransport : public Transport<Out, In> {
  using OutMessage = decltype(message_of(Out{}));
  using InMessage = decltype(message_of(In{}));
  static constexpr bool kPlant = std::is_same_v<Out, LinkInputs>;

 public:
  LcmTransport(const std::string &url, std::int64_t run_id)
      : url_(lcm_bus::usable<TransportError>(url)), run_id_(run_id) {
    lcm_.reset(lcm_create(url.c_str()));
    if (!lcm_) throw TransportError(url + ": expected a URL that LCM can open");
    for (int i = 1; i <= kMostAxes; ++i) {
      axes_[channel(!kPlant, i)] = static_cast<std::uint8_t>(i);
      channels_[static_cast<std::size_t>(i - 1)] = channel(kPlant, i);
    }
    try {
      receiver_.emplace(url, std::vector<lcm_bus::Network>(),
                        [this](std::string_view name) { return axes_.contains(name); });
    } catch (const lcm_bus::LcmError &error) {
      throw TransportError(error.what());
    }
  }

  void send(std::span<const Out> records) override {
    const std::int64_t now = lcm_bus::wall_us();
    for (const Out &record : records) {
      OutMessage m = message_of(record);
      m.utime = microseconds_at(record.tick);
      m.wall_utime = now;
      m.seq = record.tick;
      m.run_id = run_id_;
      std::array<std::uint8_t, 128> bytes;
      const int n = m.encode(bytes.data(), 0, bytes.size());
      if (lcm_publish(lcm_.get(), channels_[record.axis - 1U].c_str(), bytes.data(),
                      static_cast<unsigned>(n)) != 0) {
        throw TransportError(url_ + ": cannot send, " + std::strerror(errno));
      }
    }
  }

  std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) override {
    pollfd waited{receiver_->fd(), POLLIN, 0};
    if (poll(&waited, 1, static_cast<int>(wait.count())) < 0 && errno != EINTR) {
      throw TransportError(url_ + ": cannot receive");
    }
    std::size_t count = 0;
    const auto take = [&](const lcm_bus::Message &message) {
      InMessage m{};
      const int size = static_cast<int>(message.data.size());
      if (m.decode(message.data.data(), 0, size) != size || m.run_id != run_id_) {
        ++foreign_;
      } else {
        records[count++] = record_of(m, axes_.find(message.channel)->second);
      }
    };
    while (count < records.size() && receiver_->receive(1, take) > 0) {
    }
    return count;
  }

  std::uint64_t foreign() const override { return foreign_ + receiver_->assembly().malformed(); }

 private:
  struct Destroy {
    void operator()(lcm_t *lcm) const { lcm_destroy(lcm); }
  };

  std::string url_;
  std::int64_t run_id_;
  std::unique_ptr<lcm_t, Destroy> lcm_;
  std::optional<lcm_bus::Receiver> receiver_;
  // Axis number for each channel with received records.
  std::map<std::string, std::uint8_t, std::less<>> axes_;
  std::array<std::string, kMostAxes> channels_;  // Channel name for the sent records of each axis.
  std::uint64_t foreign_ = 0;
};

}  // namespace

std::string lcm_url_of(std::int64_t run_id) {
  const std::int64_t port = kFirstPort + (run_id % kPorts + kPorts) % kPorts;
  return std::string("udpm://") + lcm_bus::kGroup + ":" + std::to_string(port) + "?ttl=0";
}

std::unique_ptr<PlantTransport> lcm_plant_transport(const std::string &url, std::int64_t run_id) {
  return std::make_unique<LcmTransport<LinkInputs, LinkOutputs>>(url, run_id);
}

std::unique_ptr<AxisTransport> lcm_axis_transport(const std::string &url, std::int64_t run_id) {
  return std::make_unique<LcmTransport<LinkOutputs, LinkInputs>>(url, run_id);
}

}  // namespace forceaxis::host
