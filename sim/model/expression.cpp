#include "sim/model/expression.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "sim/model/text.hpp"
#include "sim/model/units.hpp"

namespace forceaxis::sim {
namespace {

bool is_word(char c) {
  return c == '_' || c == '.' || (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') ||
         (c >= 'A' && c <= 'Z');
}

struct Factor {
  bool divides;
  std::string_view text;  // a name or a number
};

// Returns the index of the first character after the number or name at the start of the text.
std::size_t factor_end(std::string_view text) {
  std::size_t end = 0;
  const bool number = is_quantity(text);
  while (end < text.size()) {
    const char before = end > 0 ? text[end - 1] : ' ';
    const bool exponent =
        number && (text[end] == '-' || text[end] == '+') && (before == 'e' || before == 'E');
    if (!is_word(text[end]) && !exponent) break;
    ++end;
  }
  return end;
}

void skip_blanks(std::string_view &text) {
  text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
}

// Returns the factors of an expression, or an empty list if the text is not an expression.
std::vector<Factor> factors_of(std::string_view text) {
  std::vector<Factor> factors;
  bool divides = false;
  for (;;) {
    skip_blanks(text);
    const std::size_t end = factor_end(text);
    if (end == 0) return {};
    factors.push_back({divides, text.substr(0, end)});
    text.remove_prefix(end);
    skip_blanks(text);
    if (text.empty()) return factors;
    if (text.front() != '*' && text.front() != '/') return {};
    divides = text.front() == '/';
    text.remove_prefix(1);
  }
}

class Expressions {
 public:
  Expressions(Source &source, const std::string &overrides_file)
      : source_(source), overrides_file_(overrides_file) {}

  void compute(Parameter &parameter) {
    if (parameter.expression.empty()) return;
    if (std::find(done_.begin(), done_.end(), &parameter) != done_.end()) return;
    if (const auto at = std::find(open_.begin(), open_.end(), &parameter); at != open_.end()) {
      std::string circle;
      for (auto p = at; p != open_.end(); ++p) circle.append((*p)->name).append(" -> ");
      fail(parameter, "expected values without a circular reference, got the circular reference " +
                          circle + parameter.name +
                          "; replace one of these expressions by a number");
    }
    open_.push_back(&parameter);
    const std::vector<Factor> factors = factors_of(parameter.expression);
    if (factors.empty())
      fail(parameter, "expected names of parameters and numbers with * or / between them, got " +
                          in_quotes(parameter.expression) +
                          "; write an expression such as \"m / tau\"");
    double value = 1.0;
    Powers powers{};
    for (const Factor &factor : factors) {
      const double size = is_quantity(factor.text) ? number(parameter, factor.text)
                                                   : named(parameter, factor, powers);
      value = factor.divides ? value / size : value * size;
    }
    const Dimension wanted = *dimension_of(parameter.unit);
    if (powers != powers_of(wanted))
      fail(parameter, "expected " + phrase_of(wanted) + ", got " + in_quotes(parameter.expression) +
                          " in " + text_of(powers) + "; correct the expression or the unit");
    if (!std::isfinite(value))
      fail(parameter, "expected a finite number, got " + in_quotes(parameter.expression) + " = " +
                          number_text(value) + "; check the divisors");
    parameter.value = value;
    open_.pop_back();
    done_.push_back(&parameter);
  }

 private:
  [[noreturn]] void fail(const Parameter &parameter, const std::string &message) const {
    const bool set = parameter.overridden && !overrides_file_.empty();
    throw InputError(set ? overrides_file_ : parameter.file,
                     set ? "set." + parameter.name : "parameters." + parameter.name + ".value",
                     message);
  }

  double number(const Parameter &parameter, std::string_view text) const {
    const QuantityText parts = split_quantity(text);
    if (!parts.unit.empty())
      fail(parameter, "expected plain numbers beside names, got " + in_quotes(text) +
                          "; define a parameter with a unit for this number");
    return parts.number;
  }

  double named(const Parameter &parameter, const Factor &factor, Powers &powers) {
    Parameter *const other = source_.find(factor.text);
    const auto names = source_.parameter_names();
    if (other == nullptr)
      fail(parameter, "expected a parameter out of " + joined(names) + ", got " +
                          in_quotes(factor.text) + suggestion(factor.text, names) +
                          "; define the parameter or correct its name");
    compute(*other);
    const Powers added = powers_of(*dimension_of(other->unit));
    for (std::size_t i = 0; i < powers.size(); ++i)
      powers[i] += factor.divides ? -added[i] : added[i];
    return other->value;
  }

  static std::string text_of(const Powers &powers) {
    static constexpr std::string_view kBase[] = {"kg", "m", "s", "A", "count", "cycle"};
    std::string text;
    for (std::size_t i = 0; i < powers.size(); ++i) {
      if (powers[i] == 0) continue;
      if (!text.empty()) text.push_back(' ');
      text.append(kBase[i]);
      if (powers[i] != 1) text.append("^").append(std::to_string(powers[i]));
    }
    if (text.empty()) text = "no unit";
    return text;
  }

  Source &source_;
  const std::string &overrides_file_;
  std::vector<Parameter *> open_;
  std::vector<Parameter *> done_;
};

}  // namespace

bool is_expression(std::string_view text) {
  skip_blanks(text);
  text.remove_prefix(factor_end(text));
  skip_blanks(text);
  return !text.empty() && (text.front() == '*' || text.front() == '/');
}

std::vector<std::string> names_in(std::string_view expression) {
  std::vector<std::string> names;
  for (const Factor &factor : factors_of(expression))
    if (!is_quantity(factor.text)) names.emplace_back(factor.text);
  return names;
}

void compute_expressions(Source &source, const std::string &overrides_file) {
  Expressions expressions(source, overrides_file);
  for (Parameter &parameter : source.parameters) {
    for (std::string &name : names_in(parameter.expression))
      parameter.refers.push_back(std::move(name));
    expressions.compute(parameter);
  }
}

void use_expressions(Source &source) {
  for (bool grown = true; grown;) {
    grown = false;
    for (const Parameter &parameter : source.parameters) {
      if (!parameter.used && !parameter.documentation) continue;
      for (const std::string &name : parameter.refers)
        if (Parameter *const other = source.find(name); other != nullptr && !other->used)
          other->used = grown = true;
    }
  }
}

}  // namespace forceaxis::sim
