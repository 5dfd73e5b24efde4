#pragma once
// The messages that plant and firmware exchange, here called records: one in each direction for
// every tick and axis.
#include <cstddef>
#include <cstdint>

namespace forceaxis::host {

// Largest number of axes of one machine. Axes are numbered from 1.
inline constexpr int kMostAxes = 6;

// Record from the plant to the firmware. The field `tick` identifies the record, so the receiver
// recognises a repeated record.
struct LinkInputs {
  std::int64_t tick;
  std::int32_t encoder_cnt;
  std::uint16_t adc0_code;
  std::uint16_t adc1_code;
  std::uint8_t din;           // digital inputs of the axis, one bit for each input
  std::uint8_t sensor_valid;  // 0: encoder and ADC codes of this record are not valid
  std::uint8_t axis;          // number of the axis, counted from 1

  // Report of the drive, as bits AXIS_DRIVE_REPORT_. 0 means that the drive is an amplifier for
  // +-10 V.
  std::uint8_t drive = 0;
  // Ages in ticks of the encoder count and of the code of ADC 0; 255 is 255 ticks or more.
  std::uint8_t position_age = 0;
  std::uint8_t force_age = 0;
};

// Record from the firmware to the plant. It answers the record LinkInputs of the same tick and
// axis.
struct LinkOutputs {
  std::int64_t tick;
  // Code of the model's DAC, from -2^(n-1) to 2^(n-1)-1 for a DAC with n bits.
  std::int16_t dac_code;
  std::uint8_t out;           // digital outputs: bit 0 amp_enable, bit 1 brake_release
  std::uint8_t fault;         // fault, one of AXIS_FAULT_
  std::uint8_t limit_reason;  // reason of the active limit, one of AXIS_LIMIT_REASON_
  std::uint8_t axis;          // number of the axis, counted from 1
};

// One tick of the trace. The trace hash is the SHA-256 over the fields below of all ticks, in this
// order, little-endian and without padding.
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
