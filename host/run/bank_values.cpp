#include "host/run/bank_values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "sim/hybrid/mode.hpp"
#include "sim/model/read.hpp"
#include "sim/model/toml.hpp"

extern "C" {
#include "firmware/core/certificate.h"
#include "firmware/core/law_bank.h"
#include "firmware/objects/generated/axis_objects_law.h"
}

namespace forceaxis::host {
namespace {

constexpr double kGainsPerUnit = 256.0;
constexpr double kCoefficientsPerUnit = 67108864.0;
constexpr double kCoefficientMax = 16.0;

std::uint16_t to_gain(double value) {
  return static_cast<std::uint16_t>(std::lround(value * kGainsPerUnit));
}

LawSection read_section(const sim::Section &section, const toml::node &node) {
  const toml::array *row = node.as_array();
  if (row == nullptr || row->size() != std::tuple_size_v<LawSection>)
    section.fail("sections", "expected lists of five numbers, b0, b1, b2, a1 and a2, got " +
                                 (row == nullptr ? sim::kind_of(node)
                                                 : "a list of " + std::to_string(row->size())) +
                                 "; write [[b0, b1, b2, a1, a2]]");
  LawSection found{};
  auto coefficient = found.begin();
  for (const toml::node &cell : *row) {
    const double value =
        cell.is_number() ? *cell.value<double>() : std::numeric_limits<double>::quiet_NaN();
    if (!(std::fabs(value) <= kCoefficientMax))
      section.fail("sections",
                   "expected numbers from -16 to 16, got " +
                       (cell.is_number() ? sim::number_text(value) : sim::kind_of(cell)) +
                       "; scale the section and increase the gain of the bank");
    *coefficient++ = static_cast<std::int32_t>(std::lround(value * kCoefficientsPerUnit));
  }
  return found;
}

}  // namespace

// Returns the sections of the key `sections`. sim::read_table() calls this function.
static std::optional<LawSections> value_of(sim::Section &section, sim::Names &,
                                           const sim::KeyFormat &key, LawSections *) {
  const toml::node *node = section.find(key.key);
  if (node == nullptr) return std::nullopt;
  const toml::array *rows = node->as_array();
  if (rows == nullptr || rows->size() > FORCE_LAW_SECTIONS)
    section.fail(key.key,
                 "expected a list of at most three sections, got " +
                     (rows == nullptr ? sim::kind_of(*node) : std::to_string(rows->size())) +
                     "; write [[b0, b1, b2, a1, a2]]");
  LawSections sections;
  for (const toml::node &row : *rows) sections.all.push_back(read_section(section, row));
  return sections;
}

std::optional<std::uint8_t> bank_of_key(std::string_view key) {
  constexpr std::string_view kPrefix = "bank_";
  if (key.size() != kPrefix.size() + 1 || !key.starts_with(kPrefix)) return std::nullopt;
  const char digit = key.back();
  if (digit < '1' || digit > '0' + FORCE_LAW_BANKS) return std::nullopt;
  return static_cast<std::uint8_t>(digit - '1');
}

BankValues read_bank(sim::Section &section, std::uint8_t bank) {
  sim::Names names;
  const auto given = sim::read_table<Bank>(section, names);
  law_params_t values{};
  values.bank_gain[bank] = to_gain(given.gain);
  values.bank_velocity_gain[bank] = to_gain(given.velocity_gain);
  values.bank_integral[bank] = static_cast<std::uint32_t>(
      std::lround(given.integral_rad_per_s / sim::kTickRateHz * kCoefficientsPerUnit));
  static_assert(std::tuple_size_v<LawSection> == FORCE_LAW_COEFFICIENTS);
  constexpr int kInBank = FORCE_LAW_SECTIONS * FORCE_LAW_COEFFICIENTS;
  std::int32_t *coefficients = &values.bank_coefficient[bank * kInBank];
  values.bank_sections[bank] = static_cast<std::uint8_t>(given.sections.all.size());
  std::int32_t *next = coefficients;
  for (const LawSection &one : given.sections.all) next = std::copy(one.begin(), one.end(), next);
  const auto at = [bank](int first) { return static_cast<std::uint16_t>(first + bank); };
  std::vector<ObjectWrite> writes = {
      {at(AXIS_OBJ_BANK_SECTIONS_1), values.bank_sections[bank]},
      {at(AXIS_OBJ_BANK_GAIN_1), values.bank_gain[bank]},
      {at(AXIS_OBJ_BANK_VELOCITY_GAIN_1), values.bank_velocity_gain[bank]},
      {at(AXIS_OBJ_BANK_INTEGRAL_1), static_cast<std::int32_t>(values.bank_integral[bank])}};
  for (int i = 0; i < kInBank; ++i) {
    writes.push_back({static_cast<std::uint16_t>(AXIS_OBJ_BANK_COEFFICIENT_1 + bank * kInBank + i),
                      coefficients[i]});
  }
  const std::uint32_t crc = law_bank_crc(&values, bank);
  writes.push_back({at(AXIS_OBJ_BANK_CRC_1), static_cast<std::int32_t>(crc)});
  return {bank, given.certificate, crc, writes};
}

std::vector<ObjectWrite> certificate_of_bank(const BankValues &bank, std::int32_t adc_bits,
                                             std::int32_t force_scale) {
  const certificate_t certificate = certificate_of(bank.crc, static_cast<std::uint8_t>(adc_bits),
                                                   static_cast<std::uint32_t>(force_scale));
  const auto at = [&bank](int first) { return static_cast<std::uint16_t>(first + bank.bank); };
  return {{at(AXIS_OBJ_CERTIFICATE_HASH_1), static_cast<std::int32_t>(certificate.hash)},
          {at(AXIS_OBJ_CERTIFICATE_PARTS_1), static_cast<std::int32_t>(certificate.parts)}};
}

}  // namespace forceaxis::host
