#include "host/link/can_transport.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

#include "host/canopen/can_socket.hpp"

namespace forceaxis::host {
namespace {

constexpr std::uint32_t kToPlant = 1U << 28;
// Bits in the identifier of an input frame. kStatus: this frame is the status frame. kHasStatus: a
// status frame precedes this frame.
constexpr std::uint32_t kStatus = 4, kHasStatus = 2;
constexpr std::uint32_t kUnused = 0xFF;
constexpr int kAxisShift = 25, kTickShift = 13, kDinShift = 9, kHomeShift = 8;
constexpr std::int64_t kTicksInId = 4096;
constexpr std::int64_t kTicksInData = 65536;
// Number of attempts to send while the queue of the CAN controller is full. The bus transmits 12
// queued frames in 2 ms. If the queue stays full, the bus is down, and the exchange repeats its
// records until its timeout.
constexpr int kRoomTries = 20;
constexpr std::chrono::microseconds kRoomWait{500};
constexpr std::uint8_t kInputBytes = 8, kOutputBytes = 7, kStatusBytes = 3;

void put16(std::uint8_t *at, std::uint16_t value) {
  at[0] = static_cast<std::uint8_t>(value);
  at[1] = static_cast<std::uint8_t>(value >> 8);
}
std::uint16_t get16(const std::uint8_t *at) {
  return static_cast<std::uint16_t>(at[0] | at[1] << 8);
}

canid_t id_of(std::uint8_t axis, std::int64_t tick) {
  return CAN_EFF_FLAG | static_cast<std::uint32_t>(axis - 1) << kAxisShift |
         static_cast<std::uint32_t>(tick % kTicksInId) << kTickShift;
}

// Returns the tick in an identifier, modulo 4096.
std::int64_t tick_of(canid_t id) { return id >> kTickShift & (kTicksInId - 1); }

// Returns the bits of the identifier for the five digital inputs. Digital input 4 has the bit below
// digital input 0.
constexpr std::uint32_t din_bits(unsigned din) {
  return (din & 15) << kDinShift | (din >> 4 & 1) << kHomeShift;
}

// Returns the axis number, counted from 1, in an identifier. Returns 0 if the identifier does not
// belong to the link.
std::uint8_t axis_of(canid_t id) {
  const std::uint32_t axis = id >> kAxisShift & 7U;
  const bool ours = (id & CAN_EFF_FLAG) != 0 && (id & (CAN_RTR_FLAG | CAN_ERR_FLAG)) == 0 &&
                    (id & kUnused) == 0 && axis < kMostAxes;
  return ours ? static_cast<std::uint8_t>(axis + 1) : 0;
}

bool has_status(const LinkInputs &in) { return (in.drive | in.position_age | in.force_age) != 0; }

// Returns axis, tick, drive and ages of a status frame, or nothing if the frame is no status frame.
std::optional<LinkInputs> link_status_of(const can_frame &frame) {
  LinkInputs in{};
  in.axis = axis_of(frame.can_id & ~kStatus);
  if ((frame.can_id & kStatus) == 0 || in.axis == 0 || frame.can_dlc != kStatusBytes ||
      (frame.can_id & (kToPlant | din_bits(31))) != 0) {
    return std::nullopt;
  }
  in.tick = tick_of(frame.can_id);
  in.drive = frame.data[0];
  in.position_age = frame.data[1];
  in.force_age = frame.data[2];
  return in;
}

// Returns the tick nearest to `near` that is congruent to `residue` modulo `modulus`.
std::int64_t unwrap(std::int64_t residue, std::int64_t modulus, std::int64_t near) {
  std::int64_t ahead = (residue - near) % modulus;
  if (ahead < 0) ahead += modulus;
  return near + (ahead >= modulus / 2 ? ahead - modulus : ahead);
}

std::string why(int error) { return std::strerror(error); }

// Writes the frames of a record, at most two, and returns their number.
std::size_t write_frames(const LinkInputs &in, can_frame *to) {
  const std::optional<can_frame> status = can_status_frame_of(in);
  if (status) *to++ = *status;
  *to = can_frame_of(in);
  return status ? 2 : 1;
}
std::size_t write_frames(const LinkOutputs &out, can_frame *to) {
  *to = can_frame_of(out);
  return 1;
}

// Decodes the frames that the plant receives.
class CanOutputs {
 public:
  std::optional<LinkOutputs> take(const can_frame &frame) {
    std::optional<LinkOutputs> out = link_outputs_of(frame);
    if (!out) ++foreign_;
    return out;
  }
  std::uint64_t foreign() const { return foreign_; }

 private:
  std::uint64_t foreign_ = 0;
};

// One end of a link over CAN. Several frames are sent or received with one system call.
template <class Out, class In, class Decoder>
class CanTransport : public Transport<Out, In> {
 public:
  // The kernel passes only frames from the other end of the link to the socket.
  CanTransport(const std::string &interface, std::uint32_t direction, std::int64_t modulus)
      : socket_(interface,
                {.filter = {CAN_EFF_FLAG | direction, CAN_EFF_FLAG | CAN_RTR_FLAG | kToPlant |
                                                          (kUnused & ~(kStatus | kHasStatus))},
                 .blocking = true}),
        modulus_(modulus) {}

  void send(std::span<const Out> records) override {
    std::array<can_frame, kFrames> frames;
    std::size_t count = 0;
    for (const Out &record : records) {
      count += write_frames(record, &frames[count]);
      expected_[record.axis - 1U] = record.tick;
    }
    std::span<const can_frame> left(frames.data(), count);
    for (int tries = 0; !left.empty();) {
      const int n = socket_.send(left);
      if (n > 0) {
        left = left.subspan(static_cast<std::size_t>(n));
        tries = 0;
      } else if (n == -ENOBUFS) {
        if (++tries == kRoomTries) return;
        std::this_thread::sleep_for(kRoomWait);
      } else if (n != -EINTR) {
        throw TransportError(socket_.interface() + ": cannot send, " + why(-n));
      }
    }
  }

  std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) override {
    socket_.set_wait(wait);
    std::array<can_frame, kFrames> frames;
    const int n = socket_.receive({frames.data(), std::min(records.size(), kFrames)});
    if (n < 0) {
      if (n == -EAGAIN || n == -EINTR) return 0;
      throw TransportError(socket_.interface() + ": cannot receive, " + why(-n));
    }
    std::size_t count = 0;
    for (int i = 0; i < n; ++i) {
      const std::optional<In> record = decoder_.take(frames[static_cast<std::size_t>(i)]);
      if (!record) continue;
      records[count] = *record;
      records[count].tick = unwrap(record->tick, modulus_, expected_[record->axis - 1U]);
      ++count;
    }
    return count;
  }

  std::uint64_t foreign() const override { return decoder_.foreign(); }

 private:
  // The plant sends at most one record for each axis, in two frames. The firmware sends at most two
  // records for each axis, each in one frame.
  static constexpr std::size_t kFrames = 2 * kMostAxes;
  static_assert(kFrames <= canopen::CanSocket::kBatch);

  canopen::CanSocket socket_;
  Decoder decoder_;
  std::int64_t modulus_;
  std::array<std::int64_t, kMostAxes> expected_{};  // last sent tick of each axis
};

template <class End, class... Arguments>
std::unique_ptr<End> open(Arguments... arguments) {
  try {
    return std::make_unique<End>(arguments...);
  } catch (const canopen::CanError &error) {
    throw TransportError(error.what());
  }
}

}  // namespace

can_frame can_frame_of(const LinkInputs &in) {
  can_frame frame{};
  frame.can_id = id_of(in.axis, in.tick) | din_bits(in.din) | (has_status(in) ? kHasStatus : 0U);
  if (in.sensor_valid == 0) return frame;
  frame.can_dlc = kInputBytes;
  const auto encoder = static_cast<std::uint32_t>(in.encoder_cnt);
  put16(frame.data, static_cast<std::uint16_t>(encoder));
  put16(frame.data + 2, static_cast<std::uint16_t>(encoder >> 16));
  put16(frame.data + 4, in.adc0_code);
  put16(frame.data + 6, in.adc1_code);
  return frame;
}

std::optional<can_frame> can_status_frame_of(const LinkInputs &in) {
  if (!has_status(in)) return std::nullopt;
  can_frame frame{};
  frame.can_id = id_of(in.axis, in.tick) | kStatus;
  frame.can_dlc = kStatusBytes;
  frame.data[0] = in.drive;
  frame.data[1] = in.position_age;
  frame.data[2] = in.force_age;
  return frame;
}

can_frame can_frame_of(const LinkOutputs &out) {
  can_frame frame{};
  frame.can_id = id_of(out.axis, out.tick) | kToPlant;
  frame.can_dlc = kOutputBytes;
  put16(frame.data, static_cast<std::uint16_t>(out.dac_code));
  frame.data[2] = out.out;
  put16(frame.data + 3, static_cast<std::uint16_t>(out.tick % kTicksInData));
  frame.data[5] = out.fault;
  frame.data[6] = out.limit_reason;
  return frame;
}

std::optional<LinkInputs> link_inputs_of(const can_frame &frame) {
  LinkInputs in{};
  in.axis = axis_of(frame.can_id & ~din_bits(31) & ~kHasStatus);
  if (in.axis == 0 || (frame.can_id & kToPlant) != 0) return std::nullopt;
  if (frame.can_dlc != kInputBytes && frame.can_dlc != 0) return std::nullopt;
  in.tick = tick_of(frame.can_id);
  in.din = static_cast<std::uint8_t>((frame.can_id >> kDinShift & 15) |
                                     (frame.can_id >> kHomeShift & 1) << 4);
  in.sensor_valid = frame.can_dlc == kInputBytes;
  in.encoder_cnt = static_cast<std::int32_t>(
      get16(frame.data) | static_cast<std::uint32_t>(get16(frame.data + 2)) << 16);
  in.adc0_code = get16(frame.data + 4);
  in.adc1_code = get16(frame.data + 6);
  return in;
}

std::optional<LinkInputs> CanInputs::take(const can_frame &frame) {
  if (const std::optional<LinkInputs> status = link_status_of(frame)) {
    status_[status->axis - 1U] = status;
    return std::nullopt;
  }
  std::optional<LinkInputs> in = link_inputs_of(frame);
  if (!in) {
    ++foreign_;
  } else if ((frame.can_id & kHasStatus) != 0) {
    const std::optional<LinkInputs> &status = status_[in->axis - 1U];
    if (!status || status->tick != in->tick) return std::nullopt;
    in->drive = status->drive;
    in->position_age = status->position_age;
    in->force_age = status->force_age;
  }
  return in;
}

std::optional<LinkOutputs> link_outputs_of(const can_frame &frame) {
  LinkOutputs out{};
  out.axis = axis_of(frame.can_id);
  if (out.axis == 0 || (frame.can_id & kToPlant) == 0) return std::nullopt;
  if (frame.can_dlc != kOutputBytes) return std::nullopt;
  out.dac_code = static_cast<std::int16_t>(get16(frame.data));
  out.out = frame.data[2];
  out.tick = get16(frame.data + 3);
  out.fault = frame.data[5];
  out.limit_reason = frame.data[6];
  // The tick in the identifier must agree with the tick in the data.
  if (tick_of(frame.can_id) != out.tick % kTicksInId) return std::nullopt;
  return out;
}

std::unique_ptr<PlantTransport> can_plant_transport(const std::string &interface) {
  return open<CanTransport<LinkInputs, LinkOutputs, CanOutputs>>(interface, kToPlant, kTicksInData);
}

std::unique_ptr<AxisTransport> can_axis_transport(const std::string &interface) {
  return open<CanTransport<LinkOutputs, LinkInputs, CanInputs>>(interface, 0U, kTicksInId);
}

}  // namespace forceaxis::host
