#pragma once
// Writes a JSON object on one line. The keys have the order of the calls that have added them.
#include <cmath>
#include <concepts>
#include <cstdio>
#include <string>
#include <string_view>

namespace forceaxis::nodes {

// Returns the text as a JSON string in quotes.
inline std::string json_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      char escaped[8];
      std::snprintf(escaped, sizeof escaped, "\\u%04x", static_cast<unsigned>(c));
      out += escaped;
    } else {
      out += c;
    }
  }
  return out + '"';
}

class JsonObject {
 public:
  // `value` must be valid JSON.
  JsonObject &raw(std::string_view key, std::string_view value) {
    text_ += (text_.empty() ? "{" : ", ") + json_text(key) + ": " + std::string(value);
    return *this;
  }
  JsonObject &add(std::string_view key, std::string_view value) {
    return raw(key, json_text(value));
  }
  JsonObject &add(std::string_view key, const char *value) { return raw(key, json_text(value)); }
  JsonObject &add(std::string_view key, bool value) { return raw(key, value ? "true" : "false"); }
  // Adds a number with nine significant digits, or null if the value is not finite.
  JsonObject &add(std::string_view key, double value) {
    if (!std::isfinite(value)) return raw(key, "null");
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.9g", value);
    return raw(key, digits);
  }
  template <class Integer>
  requires std::integral<Integer> JsonObject &add(std::string_view key, Integer value) {
    return raw(key, std::to_string(value));
  }
  std::string text() const { return text_.empty() ? "{}" : text_ + "}"; }

 private:
  std::string text_;
};

// Appends a value to a list in the form "a, b", which is a JSON list without brackets.
inline void append(std::string &list, std::string_view value) {
  if (!list.empty()) list += ", ";
  list += value;
}

}  // namespace forceaxis::nodes
