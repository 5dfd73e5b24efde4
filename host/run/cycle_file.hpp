#pragma once
// The program of a cycle in a TOML file: phases, their conditions and limits, and evaluation
// elements, with units and names. read_cycle() converts it to the record that the firmware runs
// (firmware/cycle/program.h), with the scales of a model.
//
// Every error is an InputError that names file and key: a phase that cannot be reached or cannot
// end, a loop without a count, a condition that a limit prevents, a force beyond force_limit, or
// beyond what the force sensor can show.
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/model/format.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::host {

extern const sim::TableFormat kCycleFormat;

// An evaluation element as the file describes it.
struct CycleElement {
  std::string name;
  std::string kind;        // "peak", "window" and so on
  std::string unit;        // SI unit of the value, or "" for a number
  double per_value = 1.0;  // value in SI units = value of the firmware * per_value
};

struct CycleProgram {
  // The record of the program, at most 4096 bytes, in words so that it is aligned.
  std::vector<std::uint32_t> record;
  std::string title;
  std::vector<std::string> phases;  // names by number
  std::vector<CycleElement> elements;
};

// Reads a program. The model has to have an encoder and a force on ADC 0. `initial` has the writes
// to the firmware before tick 0, of which rated_force, force_limit, force_sign, tare_band, the
// objects of the reading (adc_bits, force_zero_code, force_tare) and the soft limits count. Throws
// sim::InputError.
CycleProgram read_cycle(const std::filesystem::path &file, const sim::Model &model,
                        const std::vector<ObjectWrite> &initial);

}  // namespace forceaxis::host
