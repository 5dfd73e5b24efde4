#pragma once
// A Modbus request as what it asks for, and its answer; no registers are known here.
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace forceaxis::modbus {

// Function codes that are served.
enum : std::uint8_t {
  kReadCoils = 1,
  kReadDiscretes = 2,
  kReadHolding = 3,
  kReadInput = 4,
  kWriteCoil = 5,
  kWriteRegister = 6,
  kWriteCoils = 15,
  kWriteRegisters = 16,
  kMaskRegister = 22,
  kReadWriteRegisters = 23
};

enum : std::uint8_t {
  kExceptionFunction = 1,
  kExceptionAddress = 2,
  kExceptionValue = 3,
  kExceptionState = 4,
  kExceptionBusy = 6,
  kExceptionTarget = 11  // the axis does not answer
};

struct Request {
  std::uint8_t function = 0;
  std::uint16_t first = 0;  // of what is written, or of what is read if nothing is
  std::uint16_t count = 0;
  std::vector<std::uint16_t> words;  // to be written
  std::vector<bool> bits;            // to be written
  std::uint16_t and_mask = 0, or_mask = 0;
  std::uint16_t read_first = 0, read_count = 0;  // kReadWriteRegisters
};

struct Parsed {
  std::uint8_t exception = 0;
  Request request;
};

// A PDU: function code and data. What is malformed or outside the specification's counts is
// exception 3, as is an end beyond 65536 exception 2.
Parsed parse(std::span<const std::uint8_t> pdu);

struct Answer {
  std::uint8_t exception = 0;
  std::vector<std::uint16_t> words;  // read
  std::vector<bool> bits;            // read
};

}  // namespace forceaxis::modbus
