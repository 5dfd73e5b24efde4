#pragma once
// The firmware's side of a run in which an emulated chip executes the firmware image. The writes of
// the experiment and the ticks are sent to the chip as records through one pipe. The chip sends its
// answers through a second pipe.
//
// Records are little-endian. To the chip, 16 bytes:
//   tick   {1, din u8, sensor_valid u8, drive u8, encoder i32, adc0 u16, adc1 u16,
//           position_age u8, force_age u8, 0 u16}
//   write  {2, 0, object u16, value i32, 0 u32, 0 u32}
//   end    {3, 0 ...}
// From the chip, 8 bytes:
//   tick   {dac i16, out u8, fault u8, limit_reason u8, 0, low 16 bits of its interrupt entries}
//   write  {refusal i32, 0 u32}
//   end    {interrupt entries u32, ticks u32}
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
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
  std::uint32_t interrupts;
  std::uint32_t ticks;
};

class ChipSide {
 public:
  // Sends the initial writes to a chip that has just powered up. Throws sim::InputError if the
  // firmware refuses an initial write. Every function of this class throws TransportError if the
  // chip does not answer in time.
  ChipSide(const Experiment &experiment, const ChipPipes &pipes);

  LinkOutputs tick(const LinkInputs &in);

  // Ends the run on the chip and returns the counters of the chip.
  ChipCounts end();

  std::string hash() { return hash_.hex(); }
  const std::vector<Refusal> &refused() const { return writes_.refused(); }

 private:
  using Record = std::array<std::uint8_t, 16>;
  using Answer = std::array<std::uint8_t, 8>;

  Answer ask(const Record &record) const;
  ExperimentWrites::Write writer() const;

  ChipPipes pipes_;
  ExperimentWrites writes_;
  int steps_per_code_;  // codes of the model's DAC in one DAC code of the chip
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
