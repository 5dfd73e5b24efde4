#pragma once
// The firmware's object table by name: texts and engineering units to objects and raw values.
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/objects/generated/axis_objects_meta.h"

namespace forceaxis::host {

// Nothing if no object has this name.
std::optional<std::uint16_t> find_object(std::string_view name);

// `object` must come from find_object or AXIS_OBJ_*.
const axis_object_meta_t &object_meta(std::uint16_t object);

bool object_writable(std::uint16_t object);

// Value of an enum's text; nothing if the object is no enum or has no such text.
std::optional<std::int32_t> enum_value(std::uint16_t object, std::string_view text);

// The texts of an enum's values 0, 1, 2, ...; empty if the object is no enum.
std::vector<std::string> enum_texts(std::uint16_t object);

// Text of an enum's value, or the number itself.
std::string enum_text(std::uint16_t object, std::int32_t value);

// Name of the object at a CANopen address, also of one that only version 0.1.0 stored there; empty
// if there is none.
std::string_view name_at(std::uint32_t index, std::uint32_t sub);

// The table's name of a single raw value, of an object that is no enum; empty if it has none.
std::string_view value_name(std::uint16_t object, std::int32_t value);

}  // namespace forceaxis::host
