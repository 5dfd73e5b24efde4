#include "host/link/chip_side.hpp"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "host/link/transport.hpp"
#include "host/run/plant_side.hpp"

namespace forceaxis::host {
namespace {

enum : std::uint8_t { kTick = 1, kWrite = 2, kEnd = 3 };

void put(std::uint8_t *to, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) to[i] = static_cast<std::uint8_t>(value >> (8 * i));
}

std::uint32_t get(const std::uint8_t *from, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= static_cast<std::uint32_t>(from[i]) << (8 * i);
  return value;
}

[[noreturn]] void fail(const std::string &what) { throw TransportError("emulated chip: " + what); }

}  // namespace

ChipSide::ChipSide(const Experiment &experiment, const ChipPipes &pipes)
    : pipes_(pipes), writes_(experiment), steps_per_code_(1 << (experiment.model->dac.bits - 12)) {
  writes_.write_initial(writer());
}

ExperimentWrites::Write ChipSide::writer() const {
  return [this](std::int64_t, const ObjectWrite &w) {
    Record record{kWrite};
    put(&record[2], w.object, 2);
    put(&record[4], static_cast<std::uint32_t>(w.raw), 4);
    return static_cast<std::int32_t>(get(ask(record).data(), 4));
  };
}

ChipSide::Answer ChipSide::ask(const Record &record) const {
  if (write(pipes_.to_fd, record.data(), record.size()) != static_cast<ssize_t>(record.size())) {
    fail(std::string("accepts no record: ") + std::strerror(errno));
  }
  Answer answer{};
  for (std::size_t got = 0; got < answer.size();) {
    pollfd ready{pipes_.from_fd, POLLIN, 0};
    const int events = poll(&ready, 1, static_cast<int>(pipes_.patience.count()));
    if (events < 0 && errno == EINTR) continue;
    if (events <= 0) {
      fail("no response for " + std::to_string(pipes_.patience.count()) + " ms");
    }
    const ssize_t n = read(pipes_.from_fd, &answer[got], answer.size() - got);
    if (n <= 0) fail("has ended");
    got += static_cast<std::size_t>(n);
  }
  return answer;
}

LinkOutputs ChipSide::tick(const LinkInputs &in) {
  if (writes_.due(in.tick)) writes_.write_due(in.tick, writer());
  Record record{kTick, in.din, in.sensor_valid, in.drive};
  put(&record[4], static_cast<std::uint32_t>(in.encoder_cnt), 4);
  put(&record[8], in.adc0_code, 2);
  put(&record[10], in.adc1_code, 2);
  record[12] = in.position_age;
  record[13] = in.force_age;
  const Answer answer = ask(record);
  const auto code = static_cast<std::int16_t>(get(answer.data(), 2));  // of the chip's 12 bits
  const LinkOutputs out{in.tick,   static_cast<std::int16_t>(code * steps_per_code_),
                        answer[2], answer[3],
                        answer[4], in.axis};
  hash_.add(tick_record(in, out));
  return out;
}

ChipCounts ChipSide::end() {
  const Answer answer = ask({kEnd});
  return {get(answer.data(), 4), get(&answer[4], 4)};
}

ChipRun run_on_chip(const Experiment &experiment, const RunOptions &options,
                    const ChipPipes &pipes) {
  if (experiment.cycle)
    throw sim::InputError(experiment.file.string(), "cycle",
                          "expected an experiment without the program of a cycle, because no "
                          "program can be loaded into a chip; run it in process");
  PlantSide plant(experiment, options);
  ChipSide chip(experiment, pipes);
  while (plant.running()) plant.act(chip.tick(plant.sense()));
  ChipRun run{plant.finish(), chip.end()};
  run.result.refused = chip.refused();
  run.result.firmware_hash = chip.hash();
  return run;
}

}  // namespace forceaxis::host
