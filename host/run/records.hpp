#pragma once
// The records exchanged between plant and firmware: one of each kind for every tick and axis.
#include <cstddef>
#include <cstdint>

namespace forceaxis::host {

inline constexpr int kMostAxes = 6;  // of one machine; axes are numbered from 1

// Plant to firmware. `tick` names the record: a repeated one is recognised by it.
struct LinkInputs {
  std::int64_t tick;
  std::int32_t encoder_cnt;
  std::uint16_t adc0_code;
  std::uint16_t adc1_code;
  std::uint8_t din;           // digital inputs, one bit each
  std::uint8_t sensor_valid;  // 0: the values are not to be trusted
  std::uint8_t axis;          // from 1
};

// Firmware to plant, the answer to the inputs of the same tick and axis.
struct LinkOutputs {
  std::int64_t tick;
  std::int16_t dac_code;      // -2048 to 2047
  std::uint8_t out;           // bit 0 amp_enable, bit 1 brake_release
  std::uint8_t fault;         // AXIS_FAULT_
  std::uint8_t limit_reason;  // AXIS_LIMIT_REASON_
  std::uint8_t axis;          // from 1
};

// One tick of the trace. The trace hash is SHA-256 over these fields, little-endian and
// unpadded, in this order, all ticks.
struct TickRecord {
  std::uint32_t tick;
  std::int32_t encoder_cnt;
  std::uint16_t adc0_code;
  std::uint16_t adc1_code;
  std::uint8_t din;
  std::int16_t dac_code;
  std::uint8_t out;
};
inline constexpr std::size_t kTickRecordBytes = 16;

inline TickRecord tick_record(const LinkInputs &in, const LinkOutputs &out) {
  return {static_cast<std::uint32_t>(in.tick),
          in.encoder_cnt,
          in.adc0_code,
          in.adc1_code,
          in.din,
          out.dac_code,
          out.out};
}

}  // namespace forceaxis::host
