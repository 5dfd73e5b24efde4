#pragma once
// Reads a TOML file. A Section returns the typed values of one table.
//
// The format of the table (format.hpp) declares its keys with their dimensions, ranges and
// defaults. A call with a key that is not declared throws std::logic_error. A text in place of a
// number is a quantity (units.hpp) or the name of a parameter. An invalid value throws InputError
// with one line that contains the complete path of the key. finish() refuses the keys of the file
// that are not declared. A section contains references, so its table, its source and the lists
// passed to the section must exist as long as the section.
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim/model/elements/ends.hpp"
#include "sim/model/format.hpp"
#include "sim/model/model.hpp"
#include "sim/model/text.hpp"
#include "sim/model/toml_forward.hpp"

namespace forceaxis::sim {

/// An input file, and the parameters that the values in the file may name.
struct Source {
  std::string file;
  std::vector<Parameter> parameters;

  /// Returns the parameter with this name, or nullptr if no parameter has this name.
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
  /// Adds the declarations of further keys to this table.
  void add(const TableFormat &format) { formats_.push_back(&format); }

  /// Returns the TOML node of a key, or nullptr if the table does not have the key.
  const toml::node *find(std::string_view key) const;
  const toml::node &require(std::string_view key, std::string_view expected) const;
  bool has(std::string_view key) const { return find(key) != nullptr; }

  std::string text(std::string_view key, std::string_view expected);
  std::optional<std::string> optional_text(std::string_view key, std::string_view expected);
  /// Returns the value of the key `name`, which must be an identifier.
  std::string name();
  /// Returns the texts of a key: a list that must not be empty.
  std::vector<std::string> texts(std::string_view key, std::string_view expected);
  /// Returns the names of a key: a list of identifiers that must not be empty.
  std::vector<std::string> names(std::string_view key);
  /// Returns the index of the text of a key in the list of choices that the format declares. If the
  /// key is omitted, returns the index of the default.
  std::size_t choice(std::string_view key, std::string_view advice);

  /// Returns the value of a key in SI units. The file may give a number, a quantity, the name of a
  /// parameter or "-PARAMETER".
  double number(std::string_view key);
  std::optional<double> optional_number(std::string_view key);
  /// Returns the numbers of a key: one number, or a list that must not be empty.
  std::vector<double> numbers(std::string_view key);
  /// Returns the numbers of a key, which must be in ascending order. Returns an empty list if the
  /// key is omitted.
  std::vector<double> rising(std::string_view key);
  /// Returns the value true or false of a key. If the key is omitted, returns the default that the
  /// format declares.
  bool flag(std::string_view key);
  int integer(std::string_view key);

  /// Returns the number of a key whose dimension depends on another key.
  double value(std::string_view key, Dimension dimension, Sign sign);
  std::optional<double> optional_value(std::string_view key, Dimension dimension, Sign sign);
  double value_or(std::string_view key, Dimension dimension, Sign sign, double fallback) {
    return optional_value(key, dimension, sign).value_or(fallback);
  }
  /// Returns the number of a key whose range depends on other keys.
  double within(std::string_view key, Dimension dimension, double low, double high);

  /// Returns the index of the point whose name is the value of the key, or kGround.
  int point(std::string_view key, const std::vector<std::string> &points, bool ground_allowed,
            std::optional<int> fallback);
  Ends between(const std::vector<std::string> &points);

  /// If the table of a key exists, calls `visit` and then finish() for this table.
  void one(std::string_view key, const std::function<void(Section &)> &visit);
  /// Calls `visit` and then finish() for every table of the list of a key. The list may be omitted.
  void each(std::string_view key, const std::function<void(Section &)> &visit);

  /// Throws InputError with all keys of the file that are not declared.
  void finish() const;
  [[noreturn]] void fail(std::string_view key, const std::string &message) const;

 private:
  struct Resolved {
    double value;
    std::string origin;  // source of the value for messages, such as " (parameter m_r)", or empty
  };
  std::string key_path(std::string_view key) const;
  std::string checked_name(std::string_view key, const std::string &text) const;
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

/// Parses a TOML file. Throws InputError.
toml::table parse_toml(const std::string &file);
/// Returns the result of parse_toml(file). Each thread keeps the tables of the eight files that it
/// has parsed last, and parses such a file again only if the text of the file has changed: an
/// analysis of a set of plants reads the same model for each plant. Throws InputError.
std::shared_ptr<const toml::table> shared_toml(const std::string &file);
/// Parses a TOML text. Messages name the text `file`. Throws InputError.
toml::table parse_toml_text(std::string_view text, const std::string &file);

/// Returns the index of a name in a list, or kGround for an unknown name.
int find_point(const std::vector<std::string> &points, std::string_view name);

/// Returns the kind of a TOML node for messages, such as "a table".
std::string kind_of(const toml::node &node);

}  // namespace forceaxis::sim
