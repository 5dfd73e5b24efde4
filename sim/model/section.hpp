#pragma once
// Reads a TOML file: a Section returns the typed values of one table.
//
// The table's format (format.hpp) says which keys it has, their dimensions, ranges and defaults; a
// key that is not declared cannot be read (std::logic_error). A text in place of a number is a
// quantity (units.hpp) or the name of a parameter. A value that does not fit throws InputError: one
// line with the whole path of the key. In the end finish() refuses keys that are not declared. A
// section holds references: the table, the source and the lists passed to it must outlive it.
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim/model/format.hpp"
#include "sim/model/model.hpp"
#include "sim/model/text.hpp"
#include "sim/model/toml_forward.hpp"

namespace forceaxis::sim {

/// A file and the parameters that its values may name.
struct Source {
  std::string file;
  std::vector<Parameter> parameters;

  /// The parameter of this name, or nullptr.
  Parameter *find(std::string_view name);
  std::vector<std::string> parameter_names() const;
  [[noreturn]] void fail(const std::string &key, const std::string &message) const {
    throw InputError(file, key, message);
  }
};

class Section {
 public:
  Section(Source &source, const toml::table &table, std::string path, const TableFormat &format)
      : source_(source), table_(table), path_(std::move(path)), formats_{&format} {}

  const toml::table &table() const { return table_; }
  const TableFormat &format() const { return *formats_.front(); }
  Source &source() const { return source_; }
  /// Declares further keys of this table.
  void add(const TableFormat &format) { formats_.push_back(&format); }

  /// The node of a key, or nullptr.
  const toml::node *find(std::string_view key) const;
  const toml::node &require(std::string_view key, std::string_view expected) const;
  bool has(std::string_view key) const { return find(key) != nullptr; }

  std::string text(std::string_view key, std::string_view expected);
  std::optional<std::string> optional_text(std::string_view key, std::string_view expected);
  /// The element's own name, an identifier.
  std::string name();
  /// Index of a text in the list that the key's form declares; of an absent one its default's.
  std::size_t choice(std::string_view key, std::string_view advice);

  /// A number as its key is declared: SI, a quantity, a parameter, or a parameter negated.
  double number(std::string_view key);
  std::optional<double> optional_number(std::string_view key);
  /// One such value, or a list of them that is not empty.
  std::vector<double> numbers(std::string_view key);
  /// The same in rising order. Empty if the key is absent.
  std::vector<double> rising(std::string_view key);
  /// true or false; of an absent key what its declaration says.
  bool flag(std::string_view key);
  int integer(std::string_view key);

  /// A number whose dimension depends on another key.
  double value(std::string_view key, Dimension dimension, Sign sign);
  std::optional<double> optional_value(std::string_view key, Dimension dimension, Sign sign);
  double value_or(std::string_view key, Dimension dimension, Sign sign, double fallback) {
    return optional_value(key, dimension, sign).value_or(fallback);
  }
  /// A number whose limits depend on other keys.
  double within(std::string_view key, Dimension dimension, double low, double high);

  /// Index of the body that is named, or kGround.
  int body(std::string_view key, const std::vector<Body> &bodies, bool ground_allowed,
           std::optional<int> fallback);
  Ends between(const std::vector<Body> &bodies);

  /// Visits and finishes the table of a key, if there is one.
  void one(std::string_view key, const std::function<void(Section &)> &visit);
  /// Visits and finishes every table of a list, if there is one.
  void each(std::string_view key, const std::function<void(Section &)> &visit);

  /// Refuses the keys that are not declared, all at once.
  void finish() const;
  [[noreturn]] void fail(std::string_view key, const std::string &message) const;

 private:
  struct Resolved {
    double value;
    std::string origin;  // of the value: " (parameter m_r)", or empty
  };
  std::string key_path(std::string_view key) const;
  const KeyFormat &declared(std::string_view key) const;
  std::vector<std::string> keys() const;
  std::optional<double> optional_within(std::string_view key, Dimension dimension, double low,
                                        double high);
  Resolved resolve(const std::string &key, const toml::node &node, Dimension dimension,
                   const std::string &wanted);
  double resolve(const std::string &key, const toml::node &node, Dimension dimension, Sign sign);
  std::vector<double> list(std::string_view key, Dimension dimension, Sign sign);
  void child(const toml::node &node, std::string_view key, const std::string &path,
             const std::function<void(Section &)> &visit) const;

  Source &source_;
  const toml::table &table_;
  std::string path_;
  std::vector<const TableFormat *> formats_;
};

/// The file as TOML. Throws InputError.
toml::table parse_toml(const std::string &file);
/// The same for a text; messages name it `file`.
toml::table parse_toml_text(std::string_view text, const std::string &file);

/// Index of a body by name, or kGround.
int find_body(const std::vector<Body> &bodies, std::string_view name);

/// The kind of a node in messages, such as "a table".
std::string kind_of(const toml::node &node);

}  // namespace forceaxis::sim
