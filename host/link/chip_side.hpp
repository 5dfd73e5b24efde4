#pragma once
// The firmware's side of a run in which an emulated chip executes the firmware image. The writes of
// the experiment and the ticks are sent to the chip as records through one pipe. The chip sends its
// answers through a second pipe.
//
// Records are little-endian. A record to the chip has 16 bytes:
//   tick   {1, din u8, sensor_valid u8, drive u8, encoder i32, adc0 u16, adc1 u16,
//           position_age u8, force_age u8, 0 u16}
//   write  {2, 0, object u16, value i32, 0 u32, 0 u32}
//   end    {3, 0 ...}
//   read   {4, 0, object u16, 0 ...}
//   cycle  {5, 0 ...}
// An answer from the chip has 8 bytes:
//   tick   {dac i16, out u8, fault u8, limit_reason u8, 0, low 16 bits of its interrupt entries}
//   write  {refusal i32, 0 u32}
//   end    {interrupt entries u32, ticks u32}
//   read   {refusal i32, value i32}
//   cycle  {failed phase of the last cycle u32, late ticks u32}
//
// A tick is late if the main loop of the chip has not called fw_between() for this tick before the
// next tick. It is not counted as late if writes of the host have prolonged an interrupt. The chip
// makes the missing call before it reads the next record. So in lock-step, the evaluation of a
// press cycle ends in the same tick as in a run in one process.
//
// The program of a press cycle is written piece by piece (cycle_data_offset and the next objects)
// into the library of the chip and then selected. The library refuses the number 0, so a program
// with the number 0 gets the number 1. The number does not change what the axis does.
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/run/experiment_writes.hpp"
#include "host/run/records.hpp"
#include "host/run/result.hpp"
#include "host/run/trace_hash.hpp"

namespace forceaxis::host {

// Pipes to and from the emulated chip. The caller owns the pipes. If the chip sends nothing for the
// time `patience`, the run fails.
struct ChipPipes {
  int to_fd = -1;
  int from_fd = -1;
  std::chrono::milliseconds patience{5000};
};

struct ChipCounts {
  // Number of timer interrupts (1500 Hz) in which the chip computed a tick.
  std::uint32_t interrupts = 0;
  std::uint32_t ticks = 0;
  std::uint32_t late_ticks = 0;
};

class ChipSide {
 public:
  // Sends the program of the press cycle, if the experiment has one, and the initial writes to a
  // chip that has just powered up. Throws sim::InputError if the firmware refuses an initial write
  // or the program, for example because the chip has no memory for programs. Every function of this
  // class throws TransportError if the chip does not answer in time. The experiment must exist as
  // long as this object.
  ChipSide(const Experiment &experiment, const ChipPipes &pipes);

  LinkOutputs tick(const LinkInputs &in);

  // Appends the raw values of the experiment's traced objects to `objects`.
  void trace(std::vector<std::int32_t> &objects) const;

  // Returns the result of the last cycle, or nothing if the experiment has no program.
  std::optional<CycleResult> cycle() const;

  // Ends the run on the chip and returns the counters of the chip.
  ChipCounts end();

  std::string hash() { return hash_.hex(); }
  const std::vector<Refusal> &refused() const { return writes_.refused(); }

 private:
  using Record = std::array<std::uint8_t, 16>;
  using Answer = std::array<std::uint8_t, 8>;

  Answer ask(const Record &record) const;
  int write(std::uint16_t object, std::int32_t value) const;
  std::int32_t read(std::uint16_t object) const;
  ExperimentWrites::Write writer() const;
  void load_program() const;

  const Experiment *experiment_;
  ChipPipes pipes_;
  ExperimentWrites writes_;
  int steps_per_code_;  // number of DAC codes of the model that equal one DAC code of the chip
  TraceHash hash_;
};

struct ChipRun {
  RunResult result;
  ChipCounts counts;
};

// Runs an experiment as run() does, with the firmware on the emulated chip. result.firmware_hash is
// computed from the inputs sent to the chip and the outputs received from the chip.
ChipRun run_on_chip(const Experiment &experiment, const RunOptions &options,
                    const ChipPipes &pipes);

}  // namespace forceaxis::host
