#ifndef TESTS_SUPPORT_FRAMES_HPP_
#define TESTS_SUPPORT_FRAMES_HPP_

// Frames and records, built and checked without the firmware's code.

#include <cstddef>
#include <cstdint>
#include <ostream>
#include <vector>

using Bytes = std::vector<uint8_t>;

inline Bytes LittleEndian(uint32_t value, int count) {
  Bytes bytes;
  for (int i = 0; i < count; ++i) bytes.push_back(static_cast<uint8_t>(value >> (8 * i)));
  return bytes;
}

// Four bytes, little-endian.
inline void PutWord(Bytes &bytes, size_t at, uint32_t word) {
  for (size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<uint8_t>(word >> (8 * i));
}

// The CRC of the parameter store: reflected, 0x04C11DB7, as in Ethernet.
inline uint32_t Crc32(const uint8_t *bytes, size_t count) {
  uint32_t crc = ~0u;
  for (size_t i = 0; i < count; ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      const bool one = ((crc ^ (bytes[i] >> bit)) & 1) != 0;
      crc = (crc >> 1) ^ (one ? 0xEDB88320u : 0);
    }
  }
  return ~crc;
}

// The CRC of an SDO block transfer, bit by bit, from the polynomial x^16 + x^12 + x^5 + 1.
inline uint16_t BlockCrc(const Bytes &data) {
  uint32_t crc = 0;
  for (const uint8_t byte : data) {
    for (int bit = 7; bit >= 0; --bit) {
      const bool one = ((crc >> 15 ^ byte >> bit) & 1) != 0;
      crc = (crc << 1 ^ (one ? 0x1021 : 0)) & 0xFFFF;
    }
  }
  return static_cast<uint16_t>(crc);
}

// A data frame of CAN.
struct Frame {
  uint16_t id;
  Bytes data;
  bool operator==(const Frame &) const = default;
};

inline std::ostream &operator<<(std::ostream &out, const Frame &frame) {
  out << std::hex << frame.id << " [";
  for (uint8_t byte : frame.data) out << ' ' << int{byte};
  return out << " ]" << std::dec;
}

// The CRC of Modbus RTU, bit by bit as in its specification.
inline uint16_t Crc16(const Bytes &bytes) {
  unsigned crc = 0xFFFF;
  for (uint8_t byte : bytes) {
    crc ^= byte;
    for (int i = 0; i < 8; ++i) {
      const bool one = (crc & 1) != 0;
      crc >>= 1;
      if (one) crc ^= 0xA001;
    }
  }
  return static_cast<uint16_t>(crc);
}

// The frame with its CRC.
inline Bytes Closed(Bytes frame) {
  const uint16_t crc = Crc16(frame);
  frame.push_back(static_cast<uint8_t>(crc & 0xFF));
  frame.push_back(static_cast<uint8_t>(crc >> 8));
  return frame;
}

inline Bytes RtuFrame(uint8_t unit, const Bytes &pdu) {
  Bytes frame{unit};
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  return Closed(frame);
}

// A register, big-endian.
inline void Add(Bytes &pdu, unsigned word) {
  pdu.push_back(static_cast<uint8_t>(word >> 8));
  pdu.push_back(static_cast<uint8_t>(word));
}

inline Bytes Pdu(uint8_t function, const std::vector<unsigned> &words) {
  Bytes pdu{function};
  for (unsigned word : words) Add(pdu, word);
  return pdu;
}

// Function 16: registers from `first` on.
inline Bytes WritePdu(unsigned first, const std::vector<unsigned> &words) {
  Bytes pdu = Pdu(16, {first, static_cast<unsigned>(words.size())});
  pdu.push_back(static_cast<uint8_t>(2 * words.size()));
  for (unsigned word : words) Add(pdu, word);
  return pdu;
}

#endif
