#include "host/link/chip_side.hpp"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "host/link/transport.hpp"
#include "host/run/cycle_result.hpp"
#include "host/run/objects.hpp"
#include "host/run/plant_side.hpp"
#include "sim/model/elements/dac.hpp"

extern "C" {
#include "firmware/cycle/cycle.h"
#include "firmware/cycle/program.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"
}

namespace forceaxis::host {
namespace {

enum : std::uint8_t { kTick = 1, kWrite = 2, kEnd = 3, kRead = 4, kCycle = 5 };

// Number of 32-bit words of a program that the objects cycle_data_1 to cycle_data_16 transfer
// together.
constexpr int kPartWords = AXIS_OBJ_CYCLE_DATA_16 - AXIS_OBJ_CYCLE_DATA_1 + 1;
// Number that a program with the number 0 gets, because a library refuses the number 0.
constexpr std::uint32_t kFirstNumber = 1;

void put(std::uint8_t *to, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) to[i] = static_cast<std::uint8_t>(value >> (8 * i));
}

std::uint32_t get(const std::uint8_t *from, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= static_cast<std::uint32_t>(from[i]) << (8 * i);
  return value;
}

cycle_header_t header_of(const std::vector<std::uint32_t> &record) {
  cycle_header_t header;
  std::memcpy(&header, record.data(), sizeof(header));
  return header;
}

// Returns the program with a number that the library of the chip accepts.
std::vector<std::uint32_t> numbered(std::vector<std::uint32_t> record) {
  cycle_header_t header = header_of(record);
  if (header.number != 0) return record;
  header.number = kFirstNumber;
  std::memcpy(record.data(), &header, sizeof(header));
  std::uint32_t crc = UINT32_MAX;
  for (std::size_t i = 0; i + 1 < record.size(); ++i) {
    for (int shift = 0; shift < 32; shift += 8)
      crc = fx_crc32(crc, static_cast<std::uint8_t>(record[i] >> shift));
  }
  record.back() = ~crc;
  return record;
}

[[noreturn]] void fail(const std::string &what) { throw TransportError("emulated chip: " + what); }

}  // namespace

ChipSide::ChipSide(const Experiment &experiment, const ChipPipes &pipes)
    : experiment_(&experiment),
      pipes_(pipes),
      writes_(experiment),
      steps_per_code_(1 << (experiment.model->dac->bits - 12)) {
  if (experiment.cycle) load_program();
  writes_.write_initial(writer());
}

int ChipSide::write(std::uint16_t object, std::int32_t value) const {
  Record record{kWrite};
  put(&record[2], object, 2);
  put(&record[4], static_cast<std::uint32_t>(value), 4);
  return static_cast<std::int32_t>(get(ask(record).data(), 4));
}

std::int32_t ChipSide::read(std::uint16_t object) const {
  Record record{kRead};
  put(&record[2], object, 2);
  const Answer answer = ask(record);
  if (get(answer.data(), 4) != FW_OK)
    fail(std::string("refuses to read ") + object_meta(object).name);
  return static_cast<std::int32_t>(get(&answer[4], 4));
}

ExperimentWrites::Write ChipSide::writer() const {
  return [this](std::int64_t, const ObjectWrite &w) { return write(w.object, w.raw); };
}

void ChipSide::load_program() const {
  const std::vector<std::uint32_t> record = numbered(experiment_->cycle->record);
  int refusal = FW_OK;
  for (std::size_t i = 0; i < record.size() && refusal == FW_OK; ++i) {
    const auto word = static_cast<std::uint16_t>(i % kPartWords);
    if (word == 0) refusal = write(AXIS_OBJ_CYCLE_DATA_OFFSET, static_cast<std::int32_t>(4 * i));
    if (refusal == FW_OK)
      refusal = write(static_cast<std::uint16_t>(AXIS_OBJ_CYCLE_DATA_1 + word),
                      static_cast<std::int32_t>(record[i]));
  }
  if (refusal == FW_OK)
    refusal = write(AXIS_OBJ_CYCLE_DATA_END, static_cast<std::int32_t>(4 * record.size()));
  if (refusal == FW_OK)
    refusal = write(AXIS_OBJ_CYCLE_PROGRAM, static_cast<std::int32_t>(header_of(record).number));
  if (refusal == FW_OK) return;
  const std::string reason =
      enum_text(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL, read(AXIS_OBJ_CYCLE_PROGRAM_REFUSAL));
  throw sim::InputError(
      experiment_->file.string(), "cycle",
      refusal == FW_ERROR_NO_MEMORY
          ? "expected a chip with memory for programs of cycles, got a board that gives the "
            "firmware no program_memory; run the experiment in process"
          : "expected a program that the chip accepts, got the reason " + reason +
                "; report this as an error of forceaxis");
}

ChipSide::Answer ChipSide::ask(const Record &record) const {
  if (::write(pipes_.to_fd, record.data(), record.size()) != static_cast<ssize_t>(record.size())) {
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
    const ssize_t n = ::read(pipes_.from_fd, &answer[got], answer.size() - got);
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
  // DAC code of the chip, 12 bits.
  const auto code = static_cast<std::int16_t>(get(answer.data(), 2));
  const LinkOutputs out{in.tick,   static_cast<std::int16_t>(code * steps_per_code_),
                        answer[2], answer[3],
                        answer[4], in.axis};
  hash_.add(tick_record(in, out));
  return out;
}

void ChipSide::trace(std::vector<std::int32_t> &objects) const {
  for (const std::uint16_t object : experiment_->trace.objects) objects.push_back(read(object));
}

std::optional<CycleResult> ChipSide::cycle() const {
  if (!experiment_->cycle) return std::nullopt;
  const CycleProgram &program = *experiment_->cycle;
  CycleValues values{.state = read(AXIS_OBJ_CYCLE_STATE),
                     .outcome = read(AXIS_OBJ_CYCLE_OUTCOME),
                     .cycles = read(AXIS_OBJ_CYCLE_COUNT),
                     .failed_phase = {},
                     .elements = {}};
  if (cycle_is_done(values.state)) {
    values.failed_phase = static_cast<std::uint8_t>(get(ask({kCycle}).data(), 4));
    values.invalid_ticks = static_cast<std::uint32_t>(read(AXIS_OBJ_CYCLE_RESULT_INVALID));
    for (std::size_t i = 0; i < program.elements.size(); ++i) {
      write(AXIS_OBJ_CYCLE_RESULT_ELEMENT, static_cast<std::int32_t>(i));
      values.elements.push_back({read(AXIS_OBJ_CYCLE_RESULT_VALUE),
                                 read(AXIS_OBJ_CYCLE_RESULT_VERDICT),
                                 static_cast<std::uint32_t>(read(AXIS_OBJ_CYCLE_RESULT_TICK))});
    }
  }
  return cycle_result_of(program, values);
}

ChipCounts ChipSide::end() {
  const std::uint32_t late_ticks = get(&ask({kCycle})[4], 4);
  const Answer answer = ask({kEnd});
  return {get(answer.data(), 4), get(&answer[4], 4), late_ticks};
}

ChipRun run_on_chip(const Experiment &experiment, const RunOptions &options,
                    const ChipPipes &pipes) {
  PlantSide plant(experiment, options);
  ChipSide chip(experiment, pipes);
  std::vector<std::int32_t> objects;
  while (plant.running()) {
    plant.act(chip.tick(plant.sense()));
    if (options.trace) chip.trace(objects);
  }
  ChipRun run{plant.finish(), {}};
  run.result.objects = std::move(objects);
  run.result.cycle = chip.cycle();
  run.counts = chip.end();
  run.result.refused = chip.refused();
  run.result.firmware_hash = chip.hash();
  return run;
}

}  // namespace forceaxis::host
