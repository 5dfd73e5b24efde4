#include "host/gateway/modbus_axis.hpp"

#include <algorithm>
#include <span>

extern "C" {
#include "firmware/modbus/map.h"
#include "firmware/objects/generated/axis_objects.h"
}
#include "host/run/objects.hpp"

namespace forceaxis::nodes {
namespace {

using modbus::kExceptionAddress;
using modbus::kExceptionBusy;
using modbus::kExceptionState;
using modbus::kExceptionTarget;
using modbus::kExceptionValue;

constexpr std::int64_t kShutdown = 0x06, kEnableOperation = 0x0F, kHalt = 0x100;

std::uint8_t exception_of(const ObjectResult &result) {
  if (result.ok()) return 0;
  if (result.silent) return kExceptionTarget;
  switch (result.abort >> 16) {
    case 0x0604:
    case 0x0607:
      return kExceptionValue;
    case 0x0606:
      return kExceptionState;
    case 0x0800:
      return result.abort == 0x08000020 ? kExceptionValue : kExceptionState;
    default:
      break;
  }
  return result.abort >= 0x06090030 && result.abort <= 0x06090036 ? kExceptionValue
                                                                  : kExceptionAddress;
}

unsigned registers_of(std::uint16_t object) {
  return host::object_meta(object).size_bytes == 4 ? 2 : 1;
}

// The registers from `first` on as objects, without holes; nothing: a hole.
std::vector<axis_register_t> entries_of(bool holding, unsigned first, unsigned count) {
  const std::span<const axis_register_t> map =
      holding ? std::span<const axis_register_t>(axis_holding) : axis_input;
  std::vector<axis_register_t> entries;
  unsigned at = first;
  for (const axis_register_t &entry : map) {
    const unsigned end = entry.first + registers_of(entry.object);
    if (at < entry.first || at >= end) continue;
    entries.push_back(entry);
    at = end;
    if (at >= first + count) return entries;
  }
  return {};
}

bool any_wide(const std::vector<axis_register_t> &entries) {
  return std::ranges::any_of(entries,
                             [](const auto &entry) { return registers_of(entry.object) == 2; });
}

// Objects whose write acts at once and cannot be taken back.
bool acts_at_once(std::uint16_t object) {
  return object == AXIS_OBJ_CONTROLWORD || object == AXIS_OBJ_MODE ||
         axis_objects[object].block == AXIS_BLOCK_NONE;
}

}  // namespace

// What a request says of each coil.
struct ModbusAxis::Coils {
  Coils(unsigned first, const std::vector<bool> &bits) {
    for (unsigned i = 0; i < bits.size(); ++i) (bits[i] ? one : zero)[first + i] = true;
  }
  bool one[AXIS_COIL_COUNT] = {};
  bool zero[AXIS_COIL_COUNT] = {};
};

Task<std::uint8_t> ModbusAxis::read(std::uint16_t object, std::int64_t &value) {
  const ObjectResult result = co_await port_.read(object);
  value = result.value;
  co_return exception_of(result);
}

Task<std::uint8_t> ModbusAxis::write(std::uint16_t object, std::int64_t value) {
  const ObjectResult result = co_await port_.write(object, value);
  const bool store = object == AXIS_OBJ_STORE_PARAMETERS || object == AXIS_OBJ_RESTORE_DEFAULTS;
  if (result.abort == canopen::kAbortState && store) {
    // SDO has one code for a state and for a store that is still at work.
    const ObjectResult state = co_await port_.read(AXIS_OBJ_STORE_STATE);
    if (state.ok() && state.value == AXIS_STORE_STATE_SAVING) co_return kExceptionBusy;
  }
  co_return exception_of(result);
}

Task<std::uint8_t> ModbusAxis::read_words(bool holding, std::uint16_t first, std::uint16_t count,
                                          std::vector<std::uint16_t> &words) {
  const std::vector<axis_register_t> entries = entries_of(holding, first, count);
  if (entries.empty()) co_return kExceptionAddress;
  std::int64_t order = AXIS_MODBUS_WORD_ORDER_HIGH_FIRST;
  if (any_wide(entries)) {
    const std::uint8_t exception = co_await read(AXIS_OBJ_MODBUS_WORD_ORDER, order);
    if (exception != 0) co_return exception;
  }
  for (const axis_register_t &entry : entries) {
    std::int64_t value = 0;
    const std::uint8_t exception = co_await read(entry.object, value);
    if (exception != 0) co_return exception;
    const unsigned registers = registers_of(entry.object);
    for (unsigned n = 0; n < registers; ++n) {
      if (entry.first + n < first || entry.first + n >= first + count) continue;
      const bool low = registers == 1 || (n == 0) == (order == AXIS_MODBUS_WORD_ORDER_LOW_FIRST);
      words.push_back(static_cast<std::uint16_t>(value >> (low ? 0 : 16)));
    }
  }
  co_return 0;
}

Task<std::uint8_t> ModbusAxis::write_words(std::uint16_t first,
                                           const std::vector<std::uint16_t> &words) {
  const auto count = static_cast<unsigned>(words.size());
  const std::vector<axis_register_t> entries = entries_of(true, first, count);
  if (entries.empty()) co_return kExceptionAddress;
  const axis_register_t &last = entries.back();
  // Half of a 32-bit object cannot be written.
  if (entries.front().first != first || last.first + registers_of(last.object) != first + count) {
    co_return kExceptionValue;
  }
  std::int64_t order = AXIS_MODBUS_WORD_ORDER_HIGH_FIRST;
  if (any_wide(entries)) {
    const std::uint8_t exception = co_await read(AXIS_OBJ_MODBUS_WORD_ORDER, order);
    if (exception != 0) co_return exception;
  }
  std::vector<Write> writes;
  for (const axis_register_t &entry : entries) {
    const unsigned at = static_cast<unsigned>(entry.first) - first;
    const ObjectAddress address = address_of(entry.object);
    std::uint32_t raw = words[at];
    if (registers_of(entry.object) == 2) {
      const bool low_first = order == AXIS_MODBUS_WORD_ORDER_LOW_FIRST;
      raw = static_cast<std::uint32_t>(words[at + (low_first ? 1 : 0)]) << 16 |
            words[at + (low_first ? 0 : 1)];
    }
    const std::int64_t value = !address.is_signed   ? static_cast<std::int64_t>(raw)
                               : address.bytes == 4 ? static_cast<std::int32_t>(raw)
                                                    : static_cast<std::int16_t>(raw);
    const axis_object_meta_t &meta = host::object_meta(entry.object);
    if (value < meta.min || value > meta.max) co_return kExceptionValue;
    writes.push_back({entry.object, value});
  }
  co_return co_await write_all(writes);
}

// In the order of the registers, but what acts at once last, so that a controlword finds the
// targets that were written with it.
Task<std::uint8_t> ModbusAxis::write_all(std::vector<Write> &writes) {
  const auto acting =
      std::ranges::stable_partition(writes, [](const Write &w) { return !acts_at_once(w.object); });
  if (acting.size() > 1) co_return kExceptionValue;
  if (writes.size() > 1) {
    for (Write &w : writes) {
      if (acts_at_once(w.object)) continue;
      const std::uint8_t exception = co_await read(w.object, w.previous);
      if (exception != 0) co_return exception;
    }
  }
  for (std::size_t i = 0; i < writes.size(); ++i) {
    const std::uint8_t exception = co_await write(writes[i].object, writes[i].value);
    if (exception == 0) continue;
    while (i > 0) {
      --i;
      if (acts_at_once(writes[i].object)) continue;
      co_await write(writes[i].object, writes[i].previous);
    }
    co_return exception;
  }
  co_return 0;
}

Task<std::uint8_t> ModbusAxis::read_bits(bool coils, std::uint16_t first, std::uint16_t count,
                                         std::vector<bool> &bits) {
  const unsigned all = coils ? unsigned{AXIS_COIL_COUNT} : unsigned{AXIS_DISCRETE_COUNT};
  if (first + static_cast<unsigned>(count) > all) co_return kExceptionAddress;
  std::int64_t statusword = 0;
  if (!coils && first < AXIS_DISCRETE_LIMIT_ACTIVE) {
    const std::uint8_t exception = co_await read(AXIS_OBJ_STATUSWORD, statusword);
    if (exception != 0) co_return exception;
  }
  for (unsigned n = first; n < first + static_cast<unsigned>(count); ++n) {
    std::uint16_t object = AXIS_OBJ_NONE;
    if (coils) {
      constexpr std::uint16_t kOf[] = {AXIS_OBJ_DRIVE_STATE, AXIS_OBJ_NONE, AXIS_OBJ_CONTROLWORD,
                                       AXIS_OBJ_STORE_STATE, AXIS_OBJ_RECORDER_STATE};
      object = kOf[n];
    } else if (n >= AXIS_DISCRETE_LIMIT_ACTIVE) {
      constexpr std::uint16_t kOf[] = {AXIS_OBJ_LIMIT_REASON, AXIS_OBJ_CONTACT,
                                       AXIS_OBJ_LIMIT_CYCLE};
      object = kOf[n - AXIS_DISCRETE_LIMIT_ACTIVE];
    }
    std::int64_t value = 0;
    if (object != AXIS_OBJ_NONE) {
      const std::uint8_t exception = co_await read(object, value);
      if (exception != 0) co_return exception;
    }
    bool bit = value != 0;
    if (!coils && n < AXIS_DISCRETE_LIMIT_ACTIVE) bit = (statusword >> n & 1) != 0;
    if (object == AXIS_OBJ_DRIVE_STATE) bit = value == AXIS_DRIVE_STATE_OPERATION_ENABLED;
    if (object == AXIS_OBJ_CONTROLWORD) bit = (value & kHalt) != 0;
    if (object == AXIS_OBJ_STORE_STATE) bit = value == AXIS_STORE_STATE_SAVING;
    if (object == AXIS_OBJ_RECORDER_STATE) {
      bit = value == AXIS_RECORDER_STATE_ARMED || value == AXIS_RECORDER_STATE_RECORDING;
    }
    bits.push_back(bit);
  }
  co_return 0;
}

// From any state but a fault to operation enabled.
Task<std::uint8_t> ModbusAxis::enable(std::int64_t halt) {
  std::int64_t state = 0;
  std::uint8_t exception = co_await read(AXIS_OBJ_DRIVE_STATE, state);
  if (exception != 0) co_return exception;
  if (state == AXIS_DRIVE_STATE_OPERATION_ENABLED) co_return 0;
  for (const std::int64_t word : {kShutdown, kEnableOperation}) {
    exception = co_await write(AXIS_OBJ_CONTROLWORD, halt | word);
    if (exception != 0) co_return exception;
  }
  exception = co_await read(AXIS_OBJ_DRIVE_STATE, state);
  if (exception != 0) co_return exception;
  co_return state == AXIS_DRIVE_STATE_OPERATION_ENABLED ? 0 : kExceptionState;
}

Task<std::uint8_t> ModbusAxis::write_coils(std::uint16_t first, const std::vector<bool> &bits) {
  if (first + bits.size() > AXIS_COIL_COUNT) co_return kExceptionAddress;
  const Coils coils(first, bits);
  // At most one part that may be refused for itself: nothing is done before another is refused.
  if (coils.one[AXIS_COIL_STORE] &&
      (coils.one[AXIS_COIL_RECORDER_TRIGGER] || coils.one[AXIS_COIL_ENABLE])) {
    co_return kExceptionValue;
  }
  std::int64_t state = 0, source = 0, word = 0;
  std::uint8_t exception = co_await read(AXIS_OBJ_DRIVE_STATE, state);
  if (exception == 0) exception = co_await read(AXIS_OBJ_COMMAND_SOURCE, source);
  if (exception == 0) exception = co_await read(AXIS_OBJ_CONTROLWORD, word);
  if (exception != 0) co_return exception;
  const bool fault = state == AXIS_DRIVE_STATE_FAULT || state == AXIS_DRIVE_STATE_NOT_READY ||
                     state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
  if (source != AXIS_COMMAND_SOURCE_MODBUS || (coils.one[AXIS_COIL_ENABLE] && fault)) {
    co_return kExceptionState;
  }
  if (coils.one[AXIS_COIL_STORE]) {
    exception = co_await write(AXIS_OBJ_STORE_PARAMETERS, 1);
  } else if (coils.one[AXIS_COIL_RECORDER_TRIGGER]) {
    exception = co_await write(AXIS_OBJ_RECORDER_ARM, 1);
  }
  if (exception != 0) co_return exception;
  if (coils.zero[AXIS_COIL_RECORDER_TRIGGER]) {
    exception = co_await write(AXIS_OBJ_RECORDER_ARM, 0);
    if (exception != 0) co_return exception;
  }
  if (coils.one[AXIS_COIL_FAULT_RESET]) {
    exception = co_await write(AXIS_OBJ_FAULT_RESET, 1);
    if (exception != 0) co_return exception;
  }
  std::int64_t halt = word & kHalt;
  if (coils.one[AXIS_COIL_HALT] || coils.zero[AXIS_COIL_HALT]) {
    halt = coils.one[AXIS_COIL_HALT] ? kHalt : 0;
    exception = co_await write(AXIS_OBJ_CONTROLWORD, (word & ~kHalt) | halt);
    if (exception != 0) co_return exception;
  }
  if (coils.one[AXIS_COIL_ENABLE]) co_return co_await enable(halt);
  if (coils.zero[AXIS_COIL_ENABLE]) {
    co_return co_await write(AXIS_OBJ_CONTROLWORD, halt | kShutdown);
  }
  co_return 0;
}

Task<modbus::Answer> ModbusAxis::serve(modbus::Request &r, bool writes_allowed) {
  modbus::Answer answer;
  const bool reads = r.function >= modbus::kReadCoils && r.function <= modbus::kReadInput;
  if (!reads && !writes_allowed) {
    answer.exception = kExceptionState;
    co_return answer;
  }
  switch (r.function) {
    case modbus::kReadCoils:
    case modbus::kReadDiscretes:
      answer.exception =
          co_await read_bits(r.function == modbus::kReadCoils, r.first, r.count, answer.bits);
      break;
    case modbus::kReadHolding:
    case modbus::kReadInput:
      answer.exception =
          co_await read_words(r.function == modbus::kReadHolding, r.first, r.count, answer.words);
      break;
    case modbus::kWriteCoil:
    case modbus::kWriteCoils:
      answer.exception = co_await write_coils(r.first, r.bits);
      break;
    case modbus::kMaskRegister:
      answer.exception = co_await read_words(true, r.first, 1, answer.words);
      if (answer.exception == 0) {
        r.words = {
            static_cast<std::uint16_t>((answer.words[0] & r.and_mask) | (r.or_mask & ~r.and_mask))};
        answer.words.clear();
        answer.exception = co_await write_words(r.first, r.words);
      }
      break;
    case modbus::kReadWriteRegisters:
      // What cannot be read is refused before anything is written.
      if (entries_of(true, r.read_first, r.read_count).empty()) {
        answer.exception = kExceptionAddress;
        break;
      }
      answer.exception = co_await write_words(r.first, r.words);
      if (answer.exception == 0) {
        answer.exception = co_await read_words(true, r.read_first, r.read_count, answer.words);
      }
      break;
    default:
      answer.exception = co_await write_words(r.first, r.words);
      break;
  }
  co_return answer;
}

}  // namespace forceaxis::nodes
