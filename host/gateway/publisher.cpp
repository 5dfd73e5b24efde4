#include "host/gateway/publisher.hpp"

#include <iostream>
#include <utility>

#include "host/gateway/words.hpp"
#include "host/run/objects.hpp"
#include "sim/model/text.hpp"

namespace forceaxis::nodes {

using lcm_bus::kNotAvailable;

std::int64_t AxisPublisher::value(std::uint16_t object) const { return values_[object].value; }

std::int64_t AxisPublisher::utime() const {
  if (value(AXIS_OBJ_TICK_COUNT) == kNotAvailable) return kNotAvailable;
  return static_cast<std::int64_t>(tick_ * 2000 / 3);
}

bool AxisPublisher::is_fresh(std::uint16_t object, std::chrono::milliseconds age) const {
  const Value &held = values_[object];
  return held.value != kNotAvailable && Clock::now() - held.at < age;
}

void AxisPublisher::forget() {
  for (Value &value : values_) value = {};
}

void AxisPublisher::update(std::uint16_t object, std::int64_t value) {
  Value &held = values_[object];
  const std::int64_t before = std::exchange(held.value, value);
  held.at = Clock::now();
  if (object == AXIS_OBJ_TICK_COUNT) {
    const auto low = static_cast<std::uint32_t>(value);
    tick_ = before == kNotAvailable ? low : tick_ + (low - static_cast<std::uint32_t>(tick_));
  }
  if (before != value) changed(object, before, value);
}

void AxisPublisher::changed(std::uint16_t object, std::int64_t before, std::int64_t now) {
  const auto value = static_cast<std::int32_t>(now);
  const std::string text = host::enum_text(object, value);
  // The first known value of an object is not reported as a change, except for a fault.
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
    case AXIS_OBJ_STOPPED_BY:
      if (now != 0) event(axis_event_t::EVENT_NOTE, now, "stopped by " + text);
      return;
    case AXIS_OBJ_LIMIT_REASON:
      if (!first) event(axis_event_t::EVENT_LIMIT, now, now == 0 ? "no limit" : "limit " + text);
      return;
    default:
      return;
  }
}

void AxisPublisher::event(std::int64_t kind, std::int64_t code, const std::string &text,
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
  lcm_.publish(number_, e);
}

void AxisPublisher::loud_event(std::int64_t kind, std::int64_t code, const std::string &text) {
  std::cerr << "gateway: axis " << number_ << ": " << sim::one_line(text) << std::endl;
  event(kind, code, text);
}

void AxisPublisher::publish_state(std::int64_t table_hash, std::int64_t nmt_state) {
  axis_state_t s{};
  const Value &status = values_[AXIS_OBJ_STATUSWORD];
  s.utime = utime();
  s.objects_hash = table_hash;
  s.nmt_state = nmt_state;
  s.age_us = kNotAvailable;
  if (status.value != kNotAvailable) {
    s.age_us =
        std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - status.at).count();
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
  for (const std::uint16_t object : {AXIS_OBJ_FORCE_DEMAND, AXIS_OBJ_STOPPED_BY}) {
    if (value(object) == kNotAvailable) continue;
    s.more_name.push_back(host::object_meta(object).name);
    s.more_value.push_back(value(object));
  }
  // The state also has the user units of positions and velocities, if the axis uses user units.
  for (const std::uint16_t object : {AXIS_OBJ_FEED, AXIS_OBJ_POSITION_UNIT}) {
    if (value(object) == kNotAvailable || value(object) == 0) continue;
    s.more_name.push_back(host::object_meta(object).name);
    s.more_value.push_back(value(object));
  }
  s.num_more = static_cast<std::int32_t>(s.more_name.size());
  lcm_.publish(number_, s);
}

}  // namespace forceaxis::nodes
