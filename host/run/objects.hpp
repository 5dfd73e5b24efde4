#pragma once
// Access to the firmware's object table. Converts names to objects, and texts of enumerations to
// raw values.
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/objects/generated/axis_objects_meta.h"

namespace forceaxis::host {

// Returns the object with this name, or nothing if no object has this name.
std::optional<std::uint16_t> find_object(std::string_view name);

// Returns the metadata of an object. `object` must be a result of find_object() or a constant
// AXIS_OBJ_.
const axis_object_meta_t &object_meta(std::uint16_t object);

bool object_writable(std::uint16_t object);

// Returns the raw value for a text of an enumeration. Returns nothing if the object is not an
// enumeration or has no such text.
std::optional<std::int32_t> enum_value(std::uint16_t object, std::string_view text);

// Returns the texts of an enumeration for the values 0, 1, 2 and so on. Returns an empty list if
// the object is not an enumeration.
std::vector<std::string> enum_texts(std::uint16_t object);

// Returns the text for a value of an enumeration. If the value has no text, returns the value as a
// number.
std::string enum_text(std::uint16_t object, std::int32_t value);

// Returns the name of the object at a CANopen address, or an empty text. The function also knows
// addresses that only version 0.1.0 used in the store.
std::string_view name_at(std::uint32_t index, std::uint32_t sub);

// Returns the name of a special raw value of an object that is not an enumeration. Returns an empty
// text if the object table gives this value no name.
std::string_view value_name(std::uint16_t object, std::int32_t value);

}  // namespace forceaxis::host
