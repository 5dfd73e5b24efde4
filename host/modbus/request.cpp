#include "host/modbus/request.hpp"

namespace forceaxis::modbus {
namespace {

// Most of one request (application protocol V1.1b3, chapter 6).
constexpr unsigned kMostReadBits = 2000, kMostWrittenBits = 1968, kMostReadWords = 125,
                   kMostWrittenWords = 123, kMostExchangedWords = 121;

std::uint16_t word_at(std::span<const std::uint8_t> pdu, std::size_t at) {
  return static_cast<std::uint16_t>(pdu[at] << 8 | pdu[at + 1]);
}

bool beyond(unsigned first, unsigned count) { return first + count > 65536; }

std::vector<std::uint16_t> words_at(std::span<const std::uint8_t> pdu, std::size_t at,
                                    unsigned count) {
  std::vector<std::uint16_t> words;
  for (unsigned i = 0; i < count; ++i) words.push_back(word_at(pdu, at + 2 * i));
  return words;
}

std::uint8_t parse_read(std::span<const std::uint8_t> pdu, unsigned most, Request &r) {
  if (pdu.size() != 5) return kExceptionValue;
  r.first = word_at(pdu, 1);
  r.count = word_at(pdu, 3);
  if (r.count < 1 || r.count > most) return kExceptionValue;
  return beyond(r.first, r.count) ? kExceptionAddress : 0;
}

std::uint8_t parse_write_one(std::span<const std::uint8_t> pdu, Request &r) {
  if (pdu.size() != 5) return kExceptionValue;
  r.first = word_at(pdu, 1);
  r.count = 1;
  const std::uint16_t word = word_at(pdu, 3);
  if (r.function == kWriteRegister) {
    r.words = {word};
    return 0;
  }
  if (word != 0 && word != 0xFF00) return kExceptionValue;
  r.bits = {word != 0};
  return 0;
}

std::uint8_t parse_write_bits(std::span<const std::uint8_t> pdu, Request &r) {
  if (pdu.size() < 6) return kExceptionValue;
  r.first = word_at(pdu, 1);
  r.count = word_at(pdu, 3);
  if (r.count < 1 || r.count > kMostWrittenBits || pdu[5] != (r.count + 7U) / 8 ||
      pdu.size() != 6U + pdu[5]) {
    return kExceptionValue;
  }
  for (unsigned i = 0; i < r.count; ++i) r.bits.push_back((pdu[6 + i / 8] >> (i % 8) & 1) != 0);
  return beyond(r.first, r.count) ? kExceptionAddress : 0;
}

std::uint8_t parse_write_words(std::span<const std::uint8_t> pdu, Request &r) {
  if (pdu.size() < 6) return kExceptionValue;
  r.first = word_at(pdu, 1);
  r.count = word_at(pdu, 3);
  if (r.count < 1 || r.count > kMostWrittenWords || pdu[5] != 2 * r.count ||
      pdu.size() != 6U + pdu[5]) {
    return kExceptionValue;
  }
  r.words = words_at(pdu, 6, r.count);
  return beyond(r.first, r.count) ? kExceptionAddress : 0;
}

std::uint8_t parse_mask(std::span<const std::uint8_t> pdu, Request &r) {
  if (pdu.size() != 7) return kExceptionValue;
  r.first = word_at(pdu, 1);
  r.count = 1;
  r.and_mask = word_at(pdu, 3);
  r.or_mask = word_at(pdu, 5);
  return 0;
}

std::uint8_t parse_exchange(std::span<const std::uint8_t> pdu, Request &r) {
  if (pdu.size() < 10) return kExceptionValue;
  r.read_first = word_at(pdu, 1);
  r.read_count = word_at(pdu, 3);
  r.first = word_at(pdu, 5);
  r.count = word_at(pdu, 7);
  if (r.read_count < 1 || r.read_count > kMostReadWords || r.count < 1 ||
      r.count > kMostExchangedWords || pdu[9] != 2 * r.count || pdu.size() != 10U + pdu[9]) {
    return kExceptionValue;
  }
  r.words = words_at(pdu, 10, r.count);
  return beyond(r.first, r.count) || beyond(r.read_first, r.read_count) ? kExceptionAddress : 0;
}

}  // namespace

Parsed parse(std::span<const std::uint8_t> pdu) {
  Parsed parsed;
  Request &r = parsed.request;
  r.function = pdu.empty() ? 0 : pdu[0];
  switch (r.function) {
    case kReadCoils:
    case kReadDiscretes:
      parsed.exception = parse_read(pdu, kMostReadBits, r);
      break;
    case kReadHolding:
    case kReadInput:
      parsed.exception = parse_read(pdu, kMostReadWords, r);
      break;
    case kWriteCoil:
    case kWriteRegister:
      parsed.exception = parse_write_one(pdu, r);
      break;
    case kWriteCoils:
      parsed.exception = parse_write_bits(pdu, r);
      break;
    case kWriteRegisters:
      parsed.exception = parse_write_words(pdu, r);
      break;
    case kMaskRegister:
      parsed.exception = parse_mask(pdu, r);
      break;
    case kReadWriteRegisters:
      parsed.exception = parse_exchange(pdu, r);
      break;
    default:
      parsed.exception = kExceptionFunction;
      break;
  }
  return parsed;
}

}  // namespace forceaxis::modbus
