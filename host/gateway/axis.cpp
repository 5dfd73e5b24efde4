#include "host/gateway/axis.hpp"

#include <algorithm>
#include <iostream>
#include <span>

#include "host/gateway/words.hpp"
#include "host/run/objects.hpp"

namespace forceaxis::nodes {
namespace {

using namespace std::chrono_literals;
using lcm_bus::kNotAvailable;

constexpr std::uint32_t kEmergency = 0x080, kHeartbeat = 0x700;
constexpr std::uint32_t kInvalid = 0x80000000, kNoRemote = 0x40000000;
constexpr std::uint8_t kStart = 1;
// How many of its own periods a heartbeat may be late.
constexpr int kLateHeartbeats = 3;

// The process data of AXIS_n_STATE. The first two are the node's defaults; the others, which are
// off by default, are mapped to what the state lacks.
struct PdoPlan {
  std::uint32_t cob_id;
  std::uint8_t transmission;
  std::uint16_t event_ms;
  std::array<std::uint16_t, 4> objects;
};

constexpr std::array<PdoPlan, 4> kPlans{{
    {0x180, 255, 20, {AXIS_OBJ_STATUSWORD, AXIS_OBJ_MODES_OF_OPERATION_DISPLAY}},
    {0x280, 1, 0, {AXIS_OBJ_POSITION_ACTUAL, AXIS_OBJ_VELOCITY_ACTUAL}},
    {0x380, 1, 0, {AXIS_OBJ_FORCE, AXIS_OBJ_DAC_CODE, AXIS_OBJ_FAULT, AXIS_OBJ_LIMIT_REASON}},
    {0x480,
     1,
     0,
     {AXIS_OBJ_TICK_COUNT, AXIS_OBJ_FORCE_RAW, AXIS_OBJ_COMMAND_SOURCE, AXIS_OBJ_CONTACT}},
}};
constexpr int kLastPdo = 3;

// Read in turn, unless they came as process data just before.
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
};
constexpr auto kFresh = 300ms;

std::string name_of(std::uint16_t object) { return host::object_meta(object).name; }

}  // namespace

GatewayAxis::GatewayAxis(EventLoop &loop, lcm_bus::AxisChannels &lcm, SdoChannel::Send send,
                         const AxisSettings &settings)
    : loop_(loop),
      lcm_(lcm),
      send_(std::move(send)),
      settings_(settings),
      master_(loop, send_, 0x600U + static_cast<unsigned>(settings.number),
              0x580U + static_cast<unsigned>(settings.number), settings.sdo_timeout),
      modbus_(loop, send_, 0x640U + static_cast<unsigned>(settings.number),
              0x5C0U + static_cast<unsigned>(settings.number), settings.sdo_timeout),
      lcm_channel_(loop, send_, 0x660U + static_cast<unsigned>(settings.number),
                   0x5E0U + static_cast<unsigned>(settings.number), settings.sdo_timeout) {}

void GatewayAxis::start() { loop_.spawn(supervise()); }

// --- values and events
// -----------------------------------------------------------------------------

std::int64_t GatewayAxis::value(std::uint16_t object) const { return values_[object].value; }

std::int64_t GatewayAxis::utime() const {
  if (value(AXIS_OBJ_TICK_COUNT) == kNotAvailable) return kNotAvailable;
  return static_cast<std::int64_t>(tick_ * 2000 / 3);
}

void GatewayAxis::update(std::uint16_t object, std::int64_t value) {
  Value &held = values_[object];
  const std::int64_t before = std::exchange(held.value, value);
  held.at = EventLoop::Clock::now();
  if (object == AXIS_OBJ_TICK_COUNT) {
    const auto low = static_cast<std::uint32_t>(value);
    tick_ = before == kNotAvailable ? low : tick_ + (low - static_cast<std::uint32_t>(tick_));
  }
  if (before != value) changed(object, before, value);
}

void GatewayAxis::changed(std::uint16_t object, std::int64_t before, std::int64_t now) {
  const auto value = static_cast<std::int32_t>(now);
  const std::string text = host::enum_text(object, value);
  // What is found at the first look did not change, but a fault is worth being told.
  const bool first = before == kNotAvailable;
  switch (object) {
    case AXIS_OBJ_FAULT:
      if (first && now == 0) return;
      event(axis_event_t::EVENT_FAULT, now, now == 0 ? "fault cleared" : "fault " + text);
      return;
    case AXIS_OBJ_STATUSWORD:
      if (first || drive_state_text(before) != drive_state_text(now)) {
        event(axis_event_t::EVENT_DRIVE_STATE, now, drive_state_text(now));
      }
      return;
    case AXIS_OBJ_MODES_OF_OPERATION_DISPLAY:
      if (!first) event(axis_event_t::EVENT_MODE, now, "mode " + mode_text(now));
      return;
    case AXIS_OBJ_COMMAND_SOURCE:
      if (!first) event(axis_event_t::EVENT_LOCK, now, "the axis belongs to " + text);
      return;
    case AXIS_OBJ_LIMIT_REASON:
      if (!first) event(axis_event_t::EVENT_LIMIT, now, now == 0 ? "no limit" : "limit " + text);
      return;
    default:
      return;
  }
}

void GatewayAxis::event(std::int64_t kind, std::int64_t code, const std::string &text,
                        const std::vector<lcm_bus::Item> &items, lcm_bus::CommandId command) {
  axis_event_t e{};
  e.utime = utime();
  e.kind = kind;
  e.code = code;
  e.command_run_id = command.run_id;
  e.command_id = command.command_id;
  e.text = text;
  for (const lcm_bus::Item &item : items) {
    e.object.push_back(item.object);
    e.value.push_back(item.value);
  }
  e.num_items = static_cast<std::int32_t>(items.size());
  lcm_.publish(number(), e);
}

void GatewayAxis::loud_event(std::int64_t kind, std::int64_t code, const std::string &text) {
  std::cerr << "gateway: axis " << number() << ": " << text << std::endl;
  event(kind, code, text);
}

void GatewayAxis::publish_state() {
  published_ = true;
  axis_state_t s{};
  const Value &status = values_[AXIS_OBJ_STATUSWORD];
  s.utime = utime();
  s.objects_hash = table_hash_;
  s.nmt_state = nmt_state_;
  s.age_us = kNotAvailable;
  if (status.value != kNotAvailable) {
    s.age_us =
        std::chrono::duration_cast<std::chrono::microseconds>(EventLoop::Clock::now() - status.at)
            .count();
  }
  s.tick = value(AXIS_OBJ_TICK_COUNT);
  s.statusword = status.value;
  s.controlword = value(AXIS_OBJ_CONTROLWORD);
  s.mode_display = value(AXIS_OBJ_MODES_OF_OPERATION_DISPLAY);
  s.native_mode = value(AXIS_OBJ_ACTIVE_MODE);
  s.fault = value(AXIS_OBJ_FAULT);
  s.error_code = value(AXIS_OBJ_ERROR_CODE);
  s.limit_reason = value(AXIS_OBJ_LIMIT_REASON);
  s.command_source = value(AXIS_OBJ_COMMAND_SOURCE);
  s.contact = value(AXIS_OBJ_CONTACT);
  s.limit_cycle = value(AXIS_OBJ_LIMIT_CYCLE);
  s.position_cnt = value(AXIS_OBJ_POSITION_ACTUAL);
  s.velocity_cnt_per_s = value(AXIS_OBJ_VELOCITY_ACTUAL);
  s.force_permille = value(AXIS_OBJ_FORCE_ACTUAL);
  s.force_cnt_q8 = value(AXIS_OBJ_FORCE);
  s.force_raw = value(AXIS_OBJ_FORCE_RAW);
  s.current_permille = value(AXIS_OBJ_CURRENT_ACTUAL);
  s.current_raw = value(AXIS_OBJ_CURRENT_RAW);
  s.dac_code = value(AXIS_OBJ_DAC_CODE);
  s.command_code = value(AXIS_OBJ_COMMAND_CODE);
  s.target_position_cnt = value(AXIS_OBJ_TARGET_POSITION);
  s.target_velocity_cnt_per_s = value(AXIS_OBJ_TARGET_VELOCITY);
  s.target_force_permille = value(AXIS_OBJ_TARGET_FORCE);
  s.demand_position_cnt = value(AXIS_OBJ_POSITION_DEMAND);
  s.following_error_cnt = value(AXIS_OBJ_FOLLOWING_ERROR);
  s.rated_force_mN = value(AXIS_OBJ_RATED_FORCE);
  s.force_scale_uN = value(AXIS_OBJ_FORCE_SCALE);
  lcm_.publish(number(), s);
}

void GatewayAxis::before_sync() {
  if (!published_) publish_state();
  published_ = false;
}

// --- what comes
// --------------------------------------------------------------------------------------

void GatewayAxis::receive(const canopen::Frame &frame) {
  const std::uint32_t node = static_cast<std::uint32_t>(number());
  for (SdoChannel *channel : {&master_, &modbus_, &lcm_channel_}) {
    if (frame.id == channel->answer_id()) {
      channel->receive(frame);
      return;
    }
  }
  if (frame.id == kHeartbeat + node && frame.length == 1) {
    heard_state(frame.data[0] & 0x7F);
  } else if (frame.id == kEmergency + node && frame.length == 8) {
    receive_emergency(frame);
  } else {
    for (int pdo = 0; pdo <= kLastPdo; ++pdo) {
      if (frame.id == kPlans[static_cast<std::size_t>(pdo)].cob_id + node) receive_pdo(pdo, frame);
    }
  }
}

void GatewayAxis::heard_state(std::uint8_t state) {
  silence_ = 0ms;
  heartbeats_ = true;
  const bool booted = state == 0;
  if (booted || !present_) ++boots_;
  present_ = true;
  if (state != nmt_state_ || booted) {
    nmt_state_ = state;
    event(axis_event_t::EVENT_NODE, state, booted ? "boot-up" : "node is " + nmt_text(state));
  }
}

// Silence is counted in the gateway's own periods: while this machine stands still as a whole, time
// passes but nobody could have sent anything.
void GatewayAxis::watch_heartbeat(std::chrono::milliseconds period) {
  if (!present_ || !heartbeats_) return;
  silence_ += period;
  // At first with the period that the node itself has, which is 200 ms by default.
  const auto beat = set_up_boots_ == boots_ && !mismatch_ ? settings_.heartbeat
                                                          : std::max(settings_.heartbeat, 1000ms);
  if (silence_ > kLateHeartbeats * beat) lose("heartbeat lost", silence_.count());
}

void GatewayAxis::lose(const std::string &why, std::int64_t milliseconds) {
  present_ = false;
  heartbeats_ = false;
  table_known_ = false;
  nmt_state_ = axis_state_t::NMT_SILENT;
  loud_event(axis_event_t::EVENT_HEARTBEAT_LOST, milliseconds,
             why + ": nothing heard of the node for " + std::to_string(milliseconds) + " ms");
}

void GatewayAxis::receive_emergency(const canopen::Frame &frame) {
  const auto code = static_cast<std::uint16_t>(frame.data[0] | frame.data[1] << 8);
  const std::int64_t manufacturer = value_of(std::span(frame.data).subspan(3), false);
  event(axis_event_t::EVENT_EMCY, code, emergency_text(code, std::span(frame.data).subspan(3)),
        {{"error_register", frame.data[2]}, {"manufacturer", manufacturer}});
}

void GatewayAxis::receive_pdo(int pdo, const canopen::Frame &frame) {
  // Until the set-up has made sure of it, a PDO may carry anything.
  if (set_up_boots_ != boots_ || mismatch_) return;
  std::size_t at = 0;
  for (const std::uint16_t object : kPlans[static_cast<std::size_t>(pdo)].objects) {
    if (object == AXIS_OBJ_NONE) break;
    const ObjectAddress address = address_of(object);
    if (at + address.bytes > frame.length) return;
    update(object, value_of(std::span(frame.data).subspan(at, address.bytes), address.is_signed));
    at += address.bytes;
  }
  if (pdo == kLastPdo && !published_) publish_state();
}

// --- set-up and polling
// --------------------------------------------------------------------------------

Task<void> GatewayAxis::supervise() {
  while (loop_.running()) {
    bool done = true;
    if (!present_) {
      done = co_await find();
    } else if (set_up_boots_ != boots_) {
      done = co_await set_up();
    } else {
      co_await poll_next();
      co_await loop_.sleep(settings_.poll);
    }
    if (!done) co_await loop_.sleep(250ms);
  }
}

// A node that sends no heartbeat is asked.
Task<bool> GatewayAxis::find() {
  const ObjectResult type = co_await master_port().read(AXIS_OBJ_DEVICE_TYPE);
  if (!type.silent) {
    if (!present_) ++boots_;
    present_ = true;
    silence_ = 0ms;
    co_return true;
  }
  if (!told_waiting_) {
    told_waiting_ = true;
    loud_event(axis_event_t::EVENT_NOTE, kNotAvailable, "waiting for the node, it does not answer");
  }
  co_return false;
}

bool GatewayAxis::failed(const ObjectResult &result, std::string_view what) {
  if (result.ok()) return false;
  if (result.silent) {
    loud_event(axis_event_t::EVENT_BUS, 0, std::string(what) + ": no answer in time");
    return true;
  }
  if (result.abort == canopen::kAbortLocked) {
    if (!told_locked_) {
      told_locked_ = true;
      loud_event(axis_event_t::EVENT_NOTE, kNotAvailable,
                 "set-up waits: another source owns the axis");
    }
    return true;
  }
  loud_event(axis_event_t::EVENT_NOTE, result.abort,
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
  for (Value &value : values_) value = {};
  if (!co_await identify()) co_return false;
  if (!mismatch_) {
    if (!co_await watch_each_other()) co_return false;
    for (int pdo = 0; pdo <= kLastPdo; ++pdo) {
      if (!co_await set_up_pdo(pdo)) co_return false;
    }
    if (!co_await set_parameters()) co_return false;
    // A node that another master has stopped, or that reset itself, is started too.
    send_({0, 2, {kStart, static_cast<std::uint8_t>(number())}});
  }
  if (boots != boots_) co_return false;
  set_up_boots_ = boots;
  told_locked_ = false;
  told_waiting_ = false;
  event(axis_event_t::EVENT_NODE, nmt_state_,
        mismatch_ ? "watched only: its object table is another one" : "set up and started");
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
    loud_event(axis_event_t::EVENT_TABLE_MISMATCH, table_hash_,
               "expected object table " + hash_text(AXIS_OBJECTS_HASH32) + ", the axis has " +
                   found + ": writes are refused; build gateway and firmware from one table");
  }
  co_return true;
}

// The axis heeds the gateway's heartbeat, the gateway the axis's.
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
    loud_event(axis_event_t::EVENT_NOTE, kNotAvailable,
               "expected a free heartbeat consumer (1016h), all four watch other nodes: the axis "
               "will not notice when this gateway ends");
    co_return true;
  }
  co_return co_await ensure(*place, wanted, "heartbeat consumer");
}

Task<bool> GatewayAxis::set_up_pdo(int pdo) {
  const PdoPlan &plan = kPlans[static_cast<std::size_t>(pdo)];
  const auto at = static_cast<std::uint16_t>(pdo);
  const auto parameter = [at](std::uint8_t sub, std::uint8_t bytes) {
    return ObjectAddress{static_cast<std::uint16_t>(0x1800 + at), sub, bytes, false};
  };
  const auto mapping = [at](std::uint8_t sub) {
    return ObjectAddress{static_cast<std::uint16_t>(0x1A00 + at), sub,
                         static_cast<std::uint8_t>(sub == 0 ? 1 : 4), false};
  };
  const std::string what = "TPDO" + std::to_string(pdo + 1);
  const std::int64_t cob_id = kNoRemote | (plan.cob_id + static_cast<std::uint32_t>(number()));
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
  const std::int64_t off = held.value | kInvalid;
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
    // A value that the axis refuses is said, and does not keep it from being watched.
    if (written.silent || written.abort == canopen::kAbortLocked) co_return false;
  }
  co_return true;
}

Task<void> GatewayAxis::poll_next() {
  const Time now = EventLoop::Clock::now();
  for (std::size_t i = 0; i < std::size(kPolled); ++i) {
    const std::uint16_t object = kPolled[next_poll_];
    next_poll_ = (next_poll_ + 1) % std::size(kPolled);
    const Value &held = values_[object];
    if (held.value != kNotAvailable && now - held.at < kFresh && i + 1 < std::size(kPolled)) {
      continue;
    }
    const ObjectResult result = co_await master_port().read(object);
    if (result.ok()) {
      update(object, result.value);
    } else if (result.silent && present_) {
      if (!heartbeats_) {
        lose("no answer", settings_.sdo_timeout.count());
      } else {
        loud_event(axis_event_t::EVENT_BUS, 0, name_of(object) + ": no answer in time");
      }
    }
    co_return;
  }
}

// --- the end
// ---------------------------------------------------------------------------------------------

Task<void> GatewayAxis::shut_down() {
  constexpr std::int64_t kQuickStop = 0x0002;
  if (!present_ || !writes_allowed()) co_return;
  const ObjectResult source = co_await master_port().read(AXIS_OBJ_COMMAND_SOURCE);
  if (!source.ok() || source.value != AXIS_COMMAND_SOURCE_CANOPEN) co_return;
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
  // An axis that is still active keeps its watch: the end of the heartbeat disables it.
  if (!state.ok() || state.value == AXIS_DRIVE_STATE_OPERATION_ENABLED ||
      state.value == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) {
    co_return;
  }
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
