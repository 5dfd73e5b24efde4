#pragma once
#include <string>
#include <vector>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

/// A structure that is described by its modes of vibration. A modal analysis has measured these
/// modes while no force acted on the ports. At the start, the structure is at rest, and all
/// positions are 0.
struct Structure {
  struct Mode {
    static constexpr std::string_view kMeaning =
        "A mode of vibration of the structure. The compliance of modes that are left out can be "
        "given as one more mode for each port: a residual flexibility R in m/N becomes a mode with "
        "a frequency f far above the others, the shape 2 pi f sqrt(R) at this port and 0 at the "
        "others, and the modal mass 1 kg.";
    double frequency_hz = 0.0;   ///< undamped natural frequency, >= 0; 0: a rigid-body mode
    double damping_ratio = 0.0;  ///< damping ratio, >= 0; 0 for a rigid-body mode
    double mass = 1.0;  ///< modal mass in kg, > 0; 1 for a mass-normalised shape in 1/sqrt(kg)
    std::vector<double> shape;  ///< mode shape: displacement of each port

    static constexpr auto rows() {
      using enum Dimension;
      using enum Sign;
      using namespace format;
      return rows_of(
          field(&Mode::frequency_hz,
                needed("frequency", frequency, not_negative,
                       "Undamped natural frequency, without anything at the ports; 0 for a "
                       "rigid-body mode.")),
          field(&Mode::damping_ratio, number("damping_ratio", ratio, not_negative, 0.0,
                                             "Damping ratio; 0 for a rigid-body mode.")),
          field(&Mode::mass,
                number("modal_mass", Dimension::mass, positive, 1.0,
                       "Modal mass in the scale of the shape. Omit it for a mass-normalised shape, "
                       "whose unit is 1/sqrt(kg).")),
          field(&Mode::shape,
                numbers("shape", ratio, any, "",
                        "Displacement of each port in the mode, in the order of `ports`.")));
    }
    void complete(Section &section, Names &names);
  };

  static constexpr std::string_view kMeaning =
      "A flexible structure, given by the modes of vibration that a modal analysis has measured at "
      "its ports. The position of a port is the sum of shape * modal coordinate over the modes, "
      "and a force at a port acts on each mode by its shape. All structures together have at most "
      "32 modes. A structure with a rigid-body mode must be connected to ground; one without is "
      "held by what held it in the measurement. It starts at rest.";
  std::string name;
  /// Names of the ports, at least one; at least one mode moves each port.
  std::vector<std::string> ports;
  std::vector<Mode> modes;  ///< modes of vibration, at least one

  static constexpr auto rows() {
    return rows_of(
        field(&Structure::name, kNameKey),
        field(&Structure::ports,
              format::other("ports", "list of names", "",
                            "Names of the points at which elements act and signals are read. A "
                            "port may be named wherever a body may be named, except under "
                            "[[gravity]], because its mass is not known. No other element may have "
                            "the name.")),
        field(&Structure::modes, format::table("mode", kFormat<Mode>, true)));
  }
  /// Registers the names of the ports, so that no other element can have them.
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
