#pragma once
// The description of a plant from a model file. The description is checked and immutable, and
// contains no equations of motion.
//
// load_model() reads a TOML file and returns a Model that satisfies every rule below, or throws
// InputError. The message is one line that names the file, the key, the expected value and the
// remedy. The only other exception is std::bad_alloc. Positive motion is towards the workpiece. All
// quantities are in SI units.
//
// sim/model/elements declares the keys; docs/guide/reference/model.md is generated from them.
//
// A value is a number in SI units, a quantity such as "400 kN/m" (units.hpp), the name of a
// parameter, or "-name". The value of a parameter is a number in its unit, a quantity, or a product
// or quotient of other parameters and numbers, "m / tau" (expression.hpp). One end of `between` may
// be "ground". The deflection is d = x_a - x_b, minus `gap` for a contact. A positive force
// accelerates end a backwards and end b forwards.
// * A structure has modes of vibration and ports. Its mode i with the modal mass m has the modal
//   coordinate q_i, and the port p has the position x_p:
//     m q_i'' + 2 damping_ratio w m q_i' + w^2 m q_i = sum over p of shape_ip F_p,  w = 2 pi f
//     x_p = sum over i of shape_ip q_i
//   F_p is the sum of the forces on the port. A port may be an end of every element.
// * A piecewise-linear curve has ascending breaks and slope k between breaks[k-1] and breaks[k].
//   The curve is continuous and passes through the origin. A spring may have `loads` in N in place
//   of breaks.
// * A contact exerts k d + b d' while d > 0 and this sum is > 0; otherwise its force is 0.
// * A contact with hysteresis exerts k d + h e while this is > 0. The deflection e of the spring h
//   follows d until |h e| reaches the slip force, at which it stays while the slider slips.
// * A stop has a contact with k and b at each end of the range low < d < high. A backlash is a stop
// at
//   -width/2 and +width/2.
// * A friction opposes sliding with the force `coulomb`. The friction sticks at d' = 0 while the
//   force that keeps d' = 0 is at most `stiction`. Frictions must not form a loop, because the
//   forces in the loop would be undetermined.
// * An engaged brake is a friction with the force `holding` while it sticks and while it slides. A
//   released brake has no force. The brake releases a time `release` after the output brake_release
//   of the firmware becomes 1, and engages a time `engage` after this output becomes 0. A friction
//   may have the same ends as a brake. While the friction and the brake stick, the brake transmits
//   all of the force.
// * A cogging force is a function of d that repeats with its period within a travel.
// * An external force is a function of time.
// * A body has the mass mass + sum of inertia / r_trans^2.
// * Gravity acts on its body with mass * acceleration, positive towards +x. The acceleration is
//   interpolated between positions and constant outside their range.
// These elements or the drive must connect every body to ground; a brake alone is not sufficient. A
// structure connects its ports, and without a rigid-body mode it connects them to ground.
// The model must use every parameter that its file defines, directly or through another parameter,
// unless the parameter is marked as documentation. parameters_file may contain parameters that the
// model does not use.
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "sim/model/boxed.hpp"
#include "sim/model/elements/ends.hpp"
#include "sim/model/signal.hpp"
#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// Version of the file format of models, experiments and measurements. This number must be
/// incremented if the meaning of a valid file changes.
inline constexpr int kFileFormat = 1;

/// An error in an input file or an override. what() returns one line "FILE: KEY: expected ..., got
/// ...; what to do".
struct InputError : std::runtime_error {
  InputError(std::string file_name, std::string key_name, std::string text);
  /// Name of the file that contains the error.
  std::string file;
  /// Path of the key with the error, such as parameters.m_r.value or body[1].mass. Entries of a
  /// list are counted from 0.
  std::string key;
  std::string message;  ///< text of the error message, without the file name and the key
};

struct Parameter {
  std::string name;
  double value = 0.0;
  std::string unit;
  std::string source;
  /// Name of the file with the definition of the parameter that is used.
  std::string file;
  /// true: an element of the model uses the parameter.
  bool used = false;
  /// true: the value of the parameter comes from an override.
  bool overridden = false;
  /// true: the parameter only documents the model and need not be used.
  bool documentation = false;
  /// Expression for the value of the parameter, such as "m / tau". Empty if the value in the file
  /// is a number.
  std::string expression;
  /// Names of the parameters in the expression of this parameter, also in an expression that an
  /// override has replaced.
  std::vector<std::string> refers;
};

struct Adc;
struct Backlash;
struct Body;
struct Brake;
struct Cogging;
struct Contact;
struct Dac;
struct Damper;
struct Drive;
struct Encoder;
struct External;
struct Friction;
struct Gravity;
struct MachineController;
struct Spring;
struct Stop;
struct Structure;
struct Switches;

/// A checked model. Include the headers of the elements that are used, sim/model/elements.
struct Model {
  Model();
  Model(const Model &);
  Model(Model &&) noexcept;
  Model &operator=(const Model &);
  Model &operator=(Model &&) noexcept;
  ~Model();

  std::string file;
  std::string title;
  std::string shows;
  std::vector<Parameter> parameters;
  std::vector<Body> bodies;
  std::vector<Structure> structures;
  std::vector<Spring> springs;
  std::vector<Damper> dampers;
  std::vector<Contact> contacts;
  std::vector<Backlash> backlashes;
  std::vector<Stop> stops;
  std::vector<Friction> frictions;
  std::vector<Brake> brakes;
  std::vector<Gravity> gravities;
  std::vector<Cogging> coggings;
  std::vector<External> externals;
  Boxed<Drive> drive;
  Boxed<MachineController> machine_controller;
  Boxed<Encoder> encoder;
  /// Switches of the axis. This member always has a value; all positions are empty if the file has
  /// no switches.
  Boxed<Switches> switches;
  std::array<Boxed<Adc>, 2> adc;
  Boxed<Dac> dac;  ///< the digital-to-analog converter; never empty

  /// Returns all signals of the model, in the order of Plant::signals().
  std::vector<SignalInfo> signal_list() const;
  /// Returns the names of all points that elements may connect: the bodies, followed by the ports
  /// of all structures.
  std::vector<std::string> point_names() const;
  /// Returns the index of a point. Throws std::invalid_argument for an unknown name.
  int point_index(std::string_view name) const;
  bool is_body(int point) const;
};

/// A new value for one parameter: a number in the unit of the parameter, or a text with a quantity
/// or the name of another parameter. If this other parameter is overridden too, its new value is
/// used.
struct Override {
  std::string parameter;
  std::variant<double, std::string> value;
};

/// A model file that is read once and gives models with different values of its parameters.
class ModelFile {
 public:
  /// Reads the file and its parameters_file. Throws InputError.
  explicit ModelFile(const std::filesystem::path &path);
  ModelFile(ModelFile &&) noexcept;
  ~ModelFile();
  /// Returns the checked model. Each override must name a parameter of the model or of its
  /// parameters_file. Parameter::used is false for a parameter that no element uses. Messages about
  /// an override name the key `set.NAME` of the file `overrides_file`, unless `overrides_file` is
  /// empty. Throws InputError.
  Model model(std::span<const Override> overrides = {},
              const std::string &overrides_file = "") const;

 private:
  struct Content;
  std::unique_ptr<const Content> content_;
};

/// Returns ModelFile(path).model(overrides, overrides_file).
Model load_model(const std::filesystem::path &path, std::span<const Override> overrides = {},
                 const std::string &overrides_file = "");

}  // namespace forceaxis::sim
