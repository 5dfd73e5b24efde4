#include "host/run/objects.hpp"

namespace forceaxis::host {
namespace {

// Calls visit(value, text) for each text of an enumeration until `visit` returns true.
template <class Visit>
void each_enum_text(std::uint16_t object, Visit visit) {
  std::string_view rest = object_meta(object).enum_texts;
  for (std::int32_t value = 0; !rest.empty(); ++value) {
    const std::size_t comma = rest.find(',');
    if (visit(value, rest.substr(0, comma))) return;
    rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
  }
}

}  // namespace

std::optional<std::uint16_t> find_object(std::string_view name) {
  for (const axis_object_meta_t &meta : axis_objects_meta) {
    if (name == meta.name) return meta.object;
  }
  return std::nullopt;
}

const axis_object_meta_t &object_meta(std::uint16_t object) {
  return axis_objects_meta[object - 1];
}

bool object_writable(std::uint16_t object) {
  return std::string_view(object_meta(object).access) != "ro";
}

std::optional<std::int32_t> enum_value(std::uint16_t object, std::string_view text) {
  std::optional<std::int32_t> found;
  each_enum_text(object, [&](std::int32_t value, std::string_view candidate) {
    if (candidate == text) found = value;
    return found.has_value();
  });
  return found;
}

std::vector<std::string> enum_texts(std::uint16_t object) {
  std::vector<std::string> texts;
  each_enum_text(object, [&](std::int32_t, std::string_view text) {
    texts.emplace_back(text);
    return false;
  });
  return texts;
}

std::string enum_text(std::uint16_t object, std::int32_t value) {
  std::string found = std::to_string(value);
  each_enum_text(object, [&](std::int32_t candidate, std::string_view text) {
    if (candidate == value) found = text;
    return candidate == value;
  });
  return found;
}

std::string_view name_at(std::uint32_t index, std::uint32_t sub) {
  for (const axis_object_meta_t &meta : axis_objects_meta) {
    if (meta.index == index && meta.sub == sub) return meta.name;
  }
  for (const axis_former_name_t &former : axis_former_names) {
    if (former.address != 0 && former.address == index * 256 + sub) return former.name;
  }
  return {};
}

std::string_view value_name(std::uint16_t object, std::int32_t value) {
  for (const axis_value_text_t &named : axis_value_texts) {
    if (named.object == object && named.value == value) return named.text;
  }
  return {};
}

}  // namespace forceaxis::host
