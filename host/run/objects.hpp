#pragma once
// Access to the firmware's object table by name: converts names, texts and values in units to
// objects and raw values.
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/objects/generated/axis_objects_meta.h"

namespace forceaxis::host {

// Returns the object with this name, or nothing if no object has it.
std::optional<std::uint16_t> find_object(std::string_view name);

// Returns the metadata of an object, which must be a result of find_object() or a constant
// AXIS_OBJ_.
const axis_object_meta_t &object_meta(std::uint16_t object);

bool object_writable(std::uint16_t object);

// Returns the value of a text of an enumeration. Returns nothing if the object is not an
// enumeration or does not have this text.
std::optional<std::int32_t> enum_value(std::uint16_t object, std::string_view text);

// Returns the texts of the values 0, 1, 2 and so on of an enumeration. Empty if the object is not
// an enumeration.
std::vector<std::string> enum_texts(std::uint16_t object);

// Returns the text of a value of an enumeration, or the number if the value has no text.
std::string enum_text(std::uint16_t object, std::int32_t value);

// Returns the name of the object at a CANopen address. The address may be one at which only version
// 0.1.0 stored an object. Empty if no object has this address.
std::string_view name_at(std::uint32_t index, std::uint32_t sub);

// Returns the name that the object table gives to a special raw value of an object that is not an
// enumeration. Empty if the value has no name.
std::string_view value_name(std::uint16_t object, std::int32_t value);

}  // namespace forceaxis::host
