#include "sim/model/read.hpp"

#include <algorithm>

namespace forceaxis::sim {
namespace {

constexpr std::string_view kTextText = "a text in quotes";

std::optional<Dimension> per_count(Dimension dimension) {
  switch (dimension) {
    case Dimension::force:
      return Dimension::force_per_count;
    case Dimension::current:
      return Dimension::current_per_count;
    case Dimension::voltage:
      return Dimension::voltage_per_count;
    case Dimension::length:
      return Dimension::length_per_count;
    case Dimension::velocity:
      return Dimension::velocity_per_count;
    case Dimension::acceleration:
      return Dimension::acceleration_per_count;
    case Dimension::force_rate:
      return Dimension::force_rate_per_count;
    default:
      return std::nullopt;
  }
}

// Reads the name of a signal. The following keys of the table may have the unit of this signal.
std::string read_signal(Section &section, Names &names) {
  std::vector<std::string> known;
  for (const SignalInfo &signal : names.signals) known.push_back(signal.name);
  std::string name = section.text("signal", "a signal's name");
  const auto found = std::find(known.begin(), known.end(), name);
  if (found == known.end())
    section.fail("signal", "expected one of " + joined(known) + ", got " + in_quotes(name) +
                               suggestion(name, known) + "; name a signal of this model");
  names.signal = names.signals[static_cast<std::size_t>(found - known.begin())].dimension;
  return name;
}

}  // namespace

void Names::claim(const Section &section, const std::string &key, const std::string &name,
                  std::string_view what) {
  if (taken.emplace(what, name).second) return;
  const std::string of(what);
  section.fail(key, "expected a name that no other " + of + " has, got " + in_quotes(name) +
                        " again; rename one " + of);
}

void expect_beside(Section &section, std::string_view key, std::string_view beside) {
  if (!section.has(key) || section.has(beside)) return;
  const std::string wanted(beside), name(key);
  section.fail(name, "expected " + wanted + " beside " + name + ", got no such key; add " + wanted +
                         " or remove " + name);
}

void one_of(Section &section, const char *one, const char *other, const std::string &what) {
  if (section.has(one) != section.has(other)) return;
  const bool both = section.has(one);
  section.fail(one, "expected " + std::string(one) + " or " + other + ", got " +
                        (both ? "both keys" : "no such key") + "; " +
                        (both ? "remove one of them" : "give " + what));
}

std::optional<double> value_of(Section &section, Names &names, const KeyFormat &key, double *) {
  if (key.unit != KeyFormat::Unit::own) {
    const Dimension dimension =
        key.unit == KeyFormat::Unit::of_signal ? *names.signal : *per_count(*names.signal);
    if (key.required()) return section.value(key.key, dimension, key.sign);
    return section.optional_value(key.key, dimension, key.sign);
  }
  if (key.required() || key.fallback || (key.needed_beside && section.has(key.beside)))
    return section.number(key.key);
  return section.optional_number(key.key);
}

std::optional<int> value_of(Section &section, Names &names, const KeyFormat &key, int *) {
  if (key.form != "integer") {
    const bool ground = key.form == "body or ground";
    return section.point(key.key, names.points, ground,
                         ground ? std::optional(kGround) : std::nullopt);
  }
  if (!key.required() && !key.fallback && !section.has(key.key)) return std::nullopt;
  return section.integer(key.key);
}

std::optional<bool> value_of(Section &section, Names &, const KeyFormat &key, bool *) {
  return section.flag(key.key);
}

std::optional<Ends> value_of(Section &section, Names &names, const KeyFormat &, Ends *) {
  return section.between(names.points);
}

std::optional<std::string> value_of(Section &section, Names &names, const KeyFormat &key,
                                    std::string *) {
  if (key.form == "signal") return read_signal(section, names);
  if (key.form == "body") {
    const int body = section.point(key.key, names.points, false, std::nullopt);
    return names.points[static_cast<std::size_t>(body)];
  }
  if (key.form != "identifier") {
    if (!key.required() && !section.has(key.key)) return std::nullopt;
    std::string text = section.text(key.key, kTextText);
    if (text.empty()) section.fail(key.key, "expected a text, got an empty text; write a text");
    return text;
  }
  std::string name = section.name();
  if (!key.unique.empty()) names.claim(section, "name", name, key.unique);
  return name;
}

std::optional<std::vector<double>> value_of(Section &section, Names &, const KeyFormat &key,
                                            std::vector<double> *) {
  if (key.rising) return section.rising(key.key);
  const bool needed = key.required() || (key.needed_beside && section.has(key.beside));
  if (!needed && !section.has(key.key)) return std::nullopt;
  return section.numbers(key.key);
}

std::optional<std::vector<std::string>> value_of(Section &section, Names &, const KeyFormat &key,
                                                 std::vector<std::string> *) {
  if (key.form == "list of names") return section.names(key.key);
  return section.texts(key.key, kTextText);
}

}  // namespace forceaxis::sim
