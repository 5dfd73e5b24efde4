#include "host/gateway/axis.hpp"

#include <algorithm>
#include <span>

#include "host/gateway/words.hpp"
#include "host/run/objects.hpp"

namespace forceaxis::nodes {
namespace {

using namespace std::chrono_literals;
using lcm_bus::kNotAvailable;

constexpr std::uint32_t kEmergency = 0x080, kHeartbeat = 0x700;
constexpr std::uint32_t kInvalid = AXIS_TPDO_COB_ID_OFF, kNoRemote = AXIS_TPDO_COB_ID_NO_REQUEST;
constexpr std::uint8_t kStart = 1, kEnterPreOperational = 128;
// Number of periods without heartbeat after which the axis is reported as lost.
constexpr int kLateHeartbeats = 3;

// The process data objects (PDOs) from which the message AXIS_n_STATE is made. The gateway
// activates them with their default identifiers.
constexpr int kLastPdo = AXIS_GATEWAY_TPDO_COUNT - 1;

const axis_gateway_tpdo_t &plan_of(int pdo) {
  return axis_gateway_tpdos[static_cast<std::size_t>(pdo)];
}

// Returns the default identifier of a TPDO, without the node id.
std::uint32_t identifier_of(int pdo) {
  const auto object = static_cast<std::uint16_t>(AXIS_OBJ_TPDO_COB_ID_1 + pdo);
  return static_cast<std::uint32_t>(host::object_meta(object).initial) & 0x7FFU;
}

// Objects that are read one after the other. An object is not read if a PDO has transmitted its
// value a short time before.
constexpr std::uint16_t kPolled[] = {
    AXIS_OBJ_ACTIVE_MODE,     AXIS_OBJ_ERROR_CODE,      AXIS_OBJ_LIMIT_CYCLE,
    AXIS_OBJ_FORCE_ACTUAL,    AXIS_OBJ_CURRENT_ACTUAL,  AXIS_OBJ_CURRENT_RAW,
    AXIS_OBJ_COMMAND_CODE,    AXIS_OBJ_CONTROLWORD,     AXIS_OBJ_TARGET_POSITION,
    AXIS_OBJ_TARGET_VELOCITY, AXIS_OBJ_TARGET_FORCE,    AXIS_OBJ_POSITION_DEMAND,
    AXIS_OBJ_FOLLOWING_ERROR, AXIS_OBJ_RATED_FORCE,     AXIS_OBJ_FORCE_SCALE,
    AXIS_OBJ_STATUSWORD,      AXIS_OBJ_POSITION_ACTUAL, AXIS_OBJ_VELOCITY_ACTUAL,
    AXIS_OBJ_FORCE,           AXIS_OBJ_DAC_CODE,        AXIS_OBJ_FAULT,
    AXIS_OBJ_LIMIT_REASON,    AXIS_OBJ_TICK_COUNT,      AXIS_OBJ_FORCE_RAW,
    AXIS_OBJ_COMMAND_SOURCE,  AXIS_OBJ_CONTACT,         AXIS_OBJ_MODES_OF_OPERATION_DISPLAY,
    AXIS_OBJ_FORCE_DEMAND,    AXIS_OBJ_STOPPED_BY,      AXIS_OBJ_FEED,
    AXIS_OBJ_POSITION_UNIT,
};
constexpr auto kFresh = 300ms;
constexpr auto kStartPeriod = 1s;

std::string name_of(std::uint16_t object) { return host::object_meta(object).name; }

}  // namespace

GatewayAxis::GatewayAxis(EventLoop &loop, lcm_bus::AxisChannels &lcm, SdoChannel::Send send,
                         const AxisSettings &settings)
    : loop_(loop),
      publisher_(lcm, settings.number),
      send_(std::move(send)),
      settings_(settings),
      master_(loop, send_, 0x600U + static_cast<unsigned>(settings.number),
              0x580U + static_cast<unsigned>(settings.number), settings.sdo_timeout),
      modbus_(loop, send_, settings.first_sdo, settings.first_sdo + 1, settings.sdo_timeout),
      lcm_channel_(loop, send_, settings.first_sdo + 2, settings.first_sdo + 3,
                   settings.sdo_timeout) {}

void GatewayAxis::start() { loop_.spawn(supervise()); }

void GatewayAxis::publish_state() {
  published_ = true;
  publisher_.publish_state(table_hash_, nmt_state_);
}

void GatewayAxis::before_sync() {
  if (!published_) publish_state();
  published_ = false;
}

void GatewayAxis::receive(const canopen::Frame &frame) {
  const std::uint32_t node = static_cast<std::uint32_t>(number());
  for (SdoChannel *channel : {&master_, &modbus_, &lcm_channel_}) {
    if (frame.id == channel->answer_id()) {
      channel->receive(frame);
      return;
    }
  }
  if (frame.id == kHeartbeat + node && frame.length == 1) {
    receive_heartbeat(frame.data[0] & 0x7F);
  } else if (frame.id == kEmergency + node && frame.length == 8) {
    receive_emergency(frame);
  } else {
    for (int pdo = 0; pdo <= kLastPdo; ++pdo) {
      if (frame.id == identifier_of(pdo) + node) receive_pdo(pdo, frame);
    }
  }
}

void GatewayAxis::receive_heartbeat(std::uint8_t state) {
  silence_ = 0ms;
  heard_ = EventLoop::Clock::now();
  heartbeats_ = true;
  const bool booted = state == 0;
  if (booted || !present_) ++boots_;
  present_ = true;
  if (state != nmt_state_ || booted) {
    nmt_state_ = state;
    publisher_.event(axis_event_t::EVENT_NODE, state,
                     booted ? "boot-up" : "node is " + nmt_text(state));
  }
}

// The time without heartbeat is counted in periods of the gateway, so that the time does not
// increase while the machine of the gateway is suspended.
void GatewayAxis::watch_heartbeat(std::chrono::milliseconds period) {
  if (!present_ || !heartbeats_) return;
  silence_ += period;
  // Before the configuration, the node sends heartbeats with its own period, 200 ms by default.
  const auto beat = set_up_boots_ == boots_ && !mismatch_ ? settings_.heartbeat
                                                          : std::max(settings_.heartbeat, 1000ms);
  if (silence_ > kLateHeartbeats * beat) lose("heartbeat lost", silence_.count());
}

void GatewayAxis::lose(const std::string &why, std::int64_t milliseconds) {
  present_ = false;
  heartbeats_ = false;
  table_known_ = false;
  nmt_state_ = axis_state_t::NMT_SILENT;
  publisher_.loud_event(
      axis_event_t::EVENT_HEARTBEAT_LOST, milliseconds,
      why + ": no message from the node for " + std::to_string(milliseconds) + " ms");
}

void GatewayAxis::receive_emergency(const canopen::Frame &frame) {
  const auto code = static_cast<std::uint16_t>(frame.data[0] | frame.data[1] << 8);
  const std::int64_t manufacturer = value_of(std::span(frame.data).subspan(3), false);
  publisher_.event(axis_event_t::EVENT_EMCY, code,
                   emergency_text(code, std::span(frame.data).subspan(3)),
                   {{"error_register", frame.data[2]}, {"manufacturer", manufacturer}});
}

void GatewayAxis::receive_pdo(int pdo, const canopen::Frame &frame) {
  // Before the configuration, a PDO can be mapped to any object.
  if (set_up_boots_ != boots_ || mismatch_) return;
  std::size_t at = 0;
  for (const std::uint16_t object : plan_of(pdo).objects) {
    if (object == AXIS_OBJ_NONE) break;
    const ObjectAddress address = address_of(object);
    if (at + address.bytes > frame.length) return;
    const std::int64_t value =
        value_of(std::span(frame.data).subspan(at, address.bytes), address.is_signed);
    publisher_.update(object, value);
    // If Modbus becomes the owner later, the owner can be a client that does not use this gateway.
    if (object == AXIS_OBJ_COMMAND_SOURCE && value != AXIS_COMMAND_SOURCE_MODBUS) {
      modbus_is_ours_ = false;
    }
    at += address.bytes;
  }
  if (pdo == kLastPdo && !published_) publish_state();
}

Task<void> GatewayAxis::supervise() {
  while (loop_.running()) {
    bool done = true;
    if (!present_) {
      done = co_await find();
    } else if (!keep_started()) {
      done = false;
    } else if (set_up_boots_ != boots_) {
      done = co_await set_up();
    } else {
      co_await poll_next();
      co_await loop_.sleep(settings_.poll);
    }
    if (!done) co_await loop_.sleep(250ms);
  }
}

// Reads an object repeatedly until the node answers, because the node may send no heartbeats.
Task<bool> GatewayAxis::find() {
  const ObjectResult type = co_await master_port().read(AXIS_OBJ_DEVICE_TYPE);
  if (!type.silent) {
    if (!present_) ++boots_;
    present_ = true;
    silence_ = 0ms;
    co_return true;
  }
  if (!reported_waiting_) {
    reported_waiting_ = true;
    publisher_.loud_event(axis_event_t::EVENT_NOTE, kNotAvailable,
                          "the node does not answer; the gateway waits for the node");
  }
  co_return false;
}

// Sends an NMT command in two cases. A configured node that has left the state operational is
// started. A stopped node that is not configured is made to answer SDO requests. The NMT command
// does not move the axis: by default the stop, or the lost heartbeat, has disabled the drive
// (abort_connection_option), and only new controlwords of its owner enable it. Returns false while
// the node answers no SDO request.
bool GatewayAxis::keep_started() {
  const bool is_set_up = set_up_boots_ == boots_;
  const bool has_left = is_set_up && nmt_state_ == axis_state_t::NMT_PREOPERATIONAL;
  const bool ours = !table_known_ || !mismatch_;
  // An older heartbeat may have been sent before the latest command.
  const bool is_news = heard_ - started_ >= kStartPeriod;
  if (ours && is_news && (is_stopped() || has_left)) {
    started_ = EventLoop::Clock::now();
    publisher_.loud_event(
        axis_event_t::EVENT_NODE, nmt_state_,
        "node is " + nmt_text(nmt_state_) + ", the gateway starts it; a start enables no drive");
    send_({0, 2, {is_set_up ? kStart : kEnterPreOperational, static_cast<std::uint8_t>(number())}});
  }
  return !is_stopped();
}

bool GatewayAxis::failed(const ObjectResult &result, std::string_view what) {
  if (result.ok()) return false;
  if (result.silent) {
    publisher_.loud_event(axis_event_t::EVENT_BUS, 0, std::string(what) + ": no answer in time");
    return true;
  }
  if (result.abort == canopen::kAbortLocked) {
    if (!reported_locked_) {
      reported_locked_ = true;
      publisher_.loud_event(
          axis_event_t::EVENT_NOTE, kNotAvailable,
          "the gateway waits with the configuration, because another source owns the axis");
    }
    return true;
  }
  publisher_.loud_event(axis_event_t::EVENT_NOTE, result.abort,
                        std::string(what) + ": " + canopen::abort_text(result.abort));
  return true;
}

Task<bool> GatewayAxis::set(ObjectAddress address, std::int64_t value, std::string_view what) {
  const ObjectResult written = co_await master_port().write(address, value);
  co_return !failed(written, what);
}

Task<bool> GatewayAxis::ensure(ObjectAddress address, std::int64_t value, std::string_view what) {
  const ObjectResult held = co_await master_port().read(address);
  if (failed(held, what)) co_return false;
  if (held.value == value) co_return true;
  co_return co_await set(address, value, what);
}

Task<bool> GatewayAxis::set_up() {
  const std::uint64_t boots = boots_;
  publisher_.forget();
  if (!co_await identify()) co_return false;
  if (!mismatch_) {
    if (!co_await open_channels()) co_return false;
    if (!co_await watch_each_other()) co_return false;
    for (int pdo = 0; pdo <= kLastPdo; ++pdo) {
      if (!co_await set_up_pdo(pdo)) co_return false;
    }
    if (!co_await set_parameters()) co_return false;
    // The NMT command "start" is also needed if the node was reset or if another master has stopped
    // the node.
    send_({0, 2, {kStart, static_cast<std::uint8_t>(number())}});
    started_ = EventLoop::Clock::now();
  }
  if (boots != boots_) co_return false;
  set_up_boots_ = boots;
  reported_locked_ = false;
  reported_waiting_ = false;
  publisher_.event(
      axis_event_t::EVENT_NODE, nmt_state_,
      mismatch_ ? "monitored only, because its object table differs" : "set up and started");
  co_return true;
}

Task<bool> GatewayAxis::identify() {
  const ObjectResult product = co_await master_port().read(AXIS_OBJ_PRODUCT_CODE);
  if (failed(product, "product code")) co_return false;
  const ObjectResult hash = co_await master_port().read(AXIS_OBJ_OBJECT_TABLE_HASH);
  if (hash.silent) co_return !failed(hash, "object table");
  const bool ours = product.value == axis_objects[AXIS_OBJ_PRODUCT_CODE].initial;
  table_hash_ = hash.ok() ? hash.value : kNotAvailable;
  mismatch_ = !ours || table_hash_ != static_cast<std::int64_t>(AXIS_OBJECTS_HASH32);
  table_known_ = true;
  if (mismatch_) {
    const std::string found = !ours       ? "another product"
                              : hash.ok() ? "object table " + hash_text(table_hash_)
                                          : "no object table";
    publisher_.loud_event(
        axis_event_t::EVENT_TABLE_MISMATCH, table_hash_,
        "expected object table " + hash_text(AXIS_OBJECTS_HASH32) + ", the axis has " + found +
            "; writes are refused; build gateway and firmware from one object table");
  }
  co_return true;
}

// Opens the SDO servers 1201h and 1202h for the clients on Modbus and LCM.
Task<bool> GatewayAxis::open_channels() {
  const std::uint64_t boots = boots_;
  std::int64_t wanted = settings_.first_sdo;
  for (const std::uint16_t object : {AXIS_OBJ_SDO_MODBUS_RECEIVE, AXIS_OBJ_SDO_MODBUS_TRANSMIT,
                                     AXIS_OBJ_SDO_LCM_RECEIVE, AXIS_OBJ_SDO_LCM_TRANSMIT}) {
    const ObjectAddress cob_id = address_of(object);
    const ObjectResult held = co_await master_port().read(cob_id);
    if (failed(held, name_of(object))) co_return false;
    // CiA 301 forbids to change from one valid identifier to another valid identifier, so the
    // server is first switched off.
    if (held.value != wanted && (held.value & kInvalid) == 0) {
      const bool closed = co_await set(cob_id, held.value | kInvalid, name_of(object));
      if (!closed) co_return false;
    }
    if (held.value != wanted) {
      const bool opened = co_await set(cob_id, wanted, name_of(object));
      if (!opened) co_return false;
    }
    ++wanted;
  }
  open_boots_ = boots;
  co_return boots == boots_;
}

// Configures heartbeats in both directions: the axis monitors the heartbeat of the gateway, and the
// gateway monitors the heartbeat of the axis.
Task<bool> GatewayAxis::watch_each_other() {
  const ObjectAddress period = address_of(AXIS_OBJ_PRODUCER_HEARTBEAT_TIME);
  if (!co_await ensure(period, settings_.heartbeat.count(), "heartbeat")) co_return false;
  heartbeats_ = true;
  silence_ = 0ms;
  const std::int64_t wanted = std::int64_t{settings_.master} << 16 | settings_.watch.count();
  std::optional<ObjectAddress> place;
  for (std::uint8_t sub = 1; sub <= 4; ++sub) {
    ObjectAddress entry = address_of(AXIS_OBJ_CONSUMER_HEARTBEAT_1);
    entry.sub = sub;
    const ObjectResult held = co_await master_port().read(entry);
    if (failed(held, "heartbeat consumer")) co_return false;
    if (held.value >> 16 == settings_.master) place = entry;
    if ((held.value & 0xFFFF) == 0 && !place) place = entry;
  }
  if (!place) {
    publisher_.loud_event(
        axis_event_t::EVENT_NOTE, kNotAvailable,
        "expected a free heartbeat consumer (1016h), but all four monitor other nodes; the axis "
        "will not detect the end of this gateway");
    co_return true;
  }
  co_return co_await ensure(*place, wanted, "heartbeat consumer");
}

Task<bool> GatewayAxis::set_up_pdo(int pdo) {
  const axis_gateway_tpdo_t &plan = plan_of(pdo);
  const auto at = static_cast<std::uint16_t>(pdo);
  const auto parameter = [at](std::uint8_t sub, std::uint8_t bytes) {
    return ObjectAddress{static_cast<std::uint16_t>(0x1800 + at), sub, bytes, false};
  };
  const auto mapping = [at](std::uint8_t sub) {
    return ObjectAddress{static_cast<std::uint16_t>(0x1A00 + at), sub,
                         static_cast<std::uint8_t>(sub == 0 ? 1 : 4), false};
  };
  const std::string what = "TPDO" + std::to_string(pdo + 1);
  const std::int64_t cob_id =
      kNoRemote | (identifier_of(pdo) + static_cast<std::uint32_t>(number()));
  std::vector<std::int64_t> entries;
  for (const std::uint16_t object : plan.objects) {
    if (object == AXIS_OBJ_NONE) break;
    const ObjectAddress a = address_of(object);
    entries.push_back(std::int64_t{a.index} << 16 | a.sub << 8 | a.bytes * 8);
  }
  const auto count = static_cast<std::int64_t>(entries.size());

  ObjectResult held = co_await master_port().read(parameter(1, 4));
  if (failed(held, what)) co_return false;
  bool same = (held.value & ~std::int64_t{kNoRemote}) == (cob_id & ~std::int64_t{kNoRemote});
  const std::int64_t off = held.value | kInvalid | kNoRemote;
  held = co_await master_port().read(mapping(0));
  if (failed(held, what)) co_return false;
  same = same && held.value == count;
  for (std::uint8_t sub = 1; same && sub <= entries.size(); ++sub) {
    held = co_await master_port().read(mapping(sub));
    if (failed(held, what)) co_return false;
    same = held.value == entries[sub - 1U];
  }
  if (!same) {
    if (!co_await set(parameter(1, 4), off, what)) co_return false;
    if (!co_await set(mapping(0), 0, what)) co_return false;
    for (std::uint8_t sub = 1; sub <= entries.size(); ++sub) {
      if (!co_await set(mapping(sub), entries[sub - 1U], what)) co_return false;
    }
    if (!co_await set(mapping(0), count, what)) co_return false;
  }
  if (!co_await ensure(parameter(2, 1), plan.transmission, what)) co_return false;
  if (plan.event_ms != 0) {
    const bool timed = co_await ensure(parameter(5, 2), plan.event_ms, what);
    if (!timed) co_return false;
  }
  if (same) co_return true;
  co_return co_await set(parameter(1, 4), cob_id, what);
}

Task<bool> GatewayAxis::set_parameters() {
  for (const AxisSettings::Parameter &p : settings_.parameters) {
    const ObjectResult written = co_await master_port().write(p.object, p.raw);
    if (!failed(written, name_of(p.object))) continue;
    // A refused value is reported but does not end the configuration.
    if (written.silent || written.abort == canopen::kAbortLocked) co_return false;
  }
  co_return true;
}

Task<void> GatewayAxis::poll_next() {
  for (std::size_t i = 0; i < std::size(kPolled); ++i) {
    const std::uint16_t object = kPolled[next_poll_];
    next_poll_ = (next_poll_ + 1) % std::size(kPolled);
    if (publisher_.is_fresh(object, kFresh) && i + 1 < std::size(kPolled)) continue;
    const ObjectResult result = co_await master_port().read(object);
    if (result.ok()) {
      publisher_.update(object, result.value);
    } else if (result.silent && present_) {
      if (!heartbeats_) {
        lose("no answer", settings_.sdo_timeout.count());
      } else {
        publisher_.loud_event(axis_event_t::EVENT_BUS, 0, name_of(object) + ": no answer in time");
      }
    }
    co_return;
  }
}

// Makes CANopen the owner by a write over the channel of the present owner. This is necessary
// because only the CANopen master can end the heartbeat monitoring.
Task<bool> GatewayAxis::give_to_canopen(std::int64_t owner) {
  if (owner == AXIS_COMMAND_SOURCE_CANOPEN) co_return true;
  ObjectPort port = owner == AXIS_COMMAND_SOURCE_LCM ? lcm_port() : modbus_port();
  const ObjectResult given =
      co_await port.write(AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_CANOPEN);
  co_return given.ok();
}

Task<void> GatewayAxis::shut_down() {
  constexpr std::int64_t kQuickStop = 0x0002;
  if (!present_ || !writes_allowed()) co_return;
  const ObjectResult source = co_await master_port().read(AXIS_OBJ_COMMAND_SOURCE);
  if (!source.ok() || (source.value == AXIS_COMMAND_SOURCE_MODBUS && !modbus_is_ours_)) co_return;
  ObjectResult state = co_await master_port().read(AXIS_OBJ_DRIVE_STATE);
  if (state.ok() && state.value == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    co_await master_port().write(AXIS_OBJ_CONTROLWORD, kQuickStop);
    const Time end = EventLoop::Clock::now() + 1s;
    while (state.ok() && EventLoop::Clock::now() < end &&
           (state.value == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
            state.value == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE)) {
      co_await loop_.sleep(5ms);
      state = co_await master_port().read(AXIS_OBJ_DRIVE_STATE);
    }
  }
  // If the axis is still enabled, its heartbeat monitoring remains on, so that the lost heartbeat
  // disables the axis.
  if (!state.ok() || state.value == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
      state.value == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) {
    co_return;
  }
  if (!co_await give_to_canopen(source.value)) co_return;
  for (std::uint8_t sub = 1; sub <= 4; ++sub) {
    ObjectAddress entry = address_of(AXIS_OBJ_CONSUMER_HEARTBEAT_1);
    entry.sub = sub;
    const ObjectResult held = co_await master_port().read(entry);
    if (held.ok() && held.value >> 16 == settings_.master) {
      co_await master_port().write(entry, 0);
    }
  }
}

}  // namespace forceaxis::nodes
