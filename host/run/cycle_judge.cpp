#include "host/run/cycle_judge.hpp"

#include <memory>

#include "host/run/objects.hpp"

extern "C" {
#include "firmware/cycle/cycle.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_drive.h"
}

namespace forceaxis::host {
namespace {

using Record = std::vector<std::uint32_t>;

const cycle_header_t *header_of(const Record &record) {
  return reinterpret_cast<const cycle_header_t *>(record.data());
}

// Returns the record of a program whose phases have neither limits nor conditions. A phase only
// measures its tare, if it has one. The record has no valid CRC.
Record without_conditions(Record record) {
  auto *const phases = reinterpret_cast<cycle_phase_t *>(
      reinterpret_cast<std::uint8_t *>(record.data()) + sizeof(cycle_header_t));
  for (std::size_t i = 0; i < header_of(record)->phases; ++i) {
    const bool is_tare = phases[i].action == CYCLE_TARE;
    const std::int32_t ticks = phases[i].target;
    phases[i] = {};
    phases[i].action = is_tare ? CYCLE_TARE : CYCLE_WAIT;
    phases[i].target = is_tare ? ticks : 0;
    phases[i].reaction = CYCLE_END;
    phases[i].force_max_q8 = phases[i].travel_max = phases[i].time_max = UINT32_MAX;
  }
  return record;
}

// A cycle of the firmware over the samples of a curve.
class Run {
 public:
  Run(const Record &record, const CycleScales &scales, const CurveSample &start) : scales_(scales) {
    const cycle_header_t *const header = header_of(record);
    last_ = inputs_of(start);
    cycle_init(&cycle_);
    cycle_select(&cycle_, header);
    cycle_start(&cycle_, header, &last_, header->zero_level);
    bound_tare();
  }

  bool is_running() const { return cycle_is_running(&cycle_); }
  bool is_zeroed() const { return cycle_.zeroed != 0; }
  std::uint8_t phase() const { return is_running() ? cycle_.phase : std::uint8_t{CYCLE_END}; }

  // Begins a phase after the last sample. Fails if the tare of the phase before is not complete.
  void enter(std::uint8_t phase) {
    if (cycle_phase(&cycle_)->action == CYCLE_TARE && cycle_.phase_ticks > 0 &&
        cycle_.target != CYCLE_TARGET_MET) {
      cycle_end(&cycle_, CYCLE_TARE_MOVING);
      return;
    }
    cycle_.phase = phase;
    cycle_.phase_ticks = 0;
    cycle_.start_cnt = last_.position;
    cycle_.target = CYCLE_TARGET_OPEN;
    cycle_.tare_cnt = last_.position;
    cycle_.tare_sum = 0;
    cycle_.tare_ticks = 0;
    bound_tare();
  }

  void take(const CurveSample &sample) {
    const std::uint32_t tick = last_.tick + 1;
    last_ = inputs_of(sample);
    last_.tick = tick;
    if (cycle_step(&cycle_, &last_)) bound_tare();
    cycle_evaluate(&cycle_);
  }

  void end(bool is_stopped) {
    if (is_stopped)
      cycle_abort(&cycle_);
    else if (is_running())
      cycle_end(&cycle_, CYCLE_BY_PROGRAM);
    cycle_evaluate(&cycle_);
  }

  CycleResult result(const CycleProgram &program) const {
    const std::int32_t done = cycle_.good != 0 ? AXIS_CYCLE_STATE_GOOD : AXIS_CYCLE_STATE_BAD;
    CycleValues values{
        .state = cycle_.outcome == CYCLE_STOPPED ? std::int32_t{AXIS_CYCLE_STATE_ABORTED} : done,
        .outcome = cycle_.outcome,
        .cycles = 1,
        .failed_phase = cycle_.failed_phase,
        .invalid_ticks = cycle_.invalid_ticks,
        .elements = {}};
    for (std::size_t i = 0; i < program.elements.size(); ++i) {
      const cycle_element_result_t found = cycle_result(&cycle_, static_cast<std::uint8_t>(i));
      values.elements.push_back({found.value, found.verdict + 1, found.found_tick});
    }
    return cycle_result_of(program, values);
  }

 private:
  cycle_inputs_t inputs_of(const CurveSample &sample) const {
    const bool touches =
        scales_.contact_q8 && sample.is_valid && !fx_within(sample.force_q8, *scales_.contact_q8);
    // A sample that is not valid is an old one. A force at the end of its range would end the
    // cycle, and the elements of later phases would have no value.
    return {.tick = 0,
            .position = sample.position,
            .force_q8 = sample.force_q8,
            .contact = std::uint8_t{touches},
            .reached = 0,
            .inputs = 0,
            .defects = std::uint8_t(sample.is_valid ? CYCLE_SAMPLE_VALID : CYCLE_SAMPLE_OLD)};
  }

  void bound_tare() {
    cycle_.tare_least = scales_.tare_least;
    cycle_.tare_most = scales_.tare_most;
  }

  const CycleScales &scales_;
  cycle_t cycle_{};
  cycle_inputs_t last_{};
};

}  // namespace

CurveJudge::CurveJudge(const std::filesystem::path &file, const CycleScales &scales)
    : scales_(scales), program_(read_cycle(file, scales)) {
  const cycle_check_t check = cycle_program_check(
      program_.record.data(), static_cast<std::uint32_t>(program_.record.size() * 4));
  if (check.reason != CYCLE_ACCEPTED)
    throw sim::InputError(file.string(), check.reason == CYCLE_WRONG_PHASE ? "phase" : "element",
                          "expected times within the range of the firmware at " +
                              std::to_string(scales.ticks_per_s) + " samples per second (number " +
                              std::to_string(check.number) +
                              "); record with fewer samples per second");
}

JudgedCurve CurveJudge::judge_labelled(const CurveSample &start,
                                       std::span<const CurveSample> samples) const {
  const Record record = without_conditions(program_.record);
  const auto run = std::make_unique<Run>(record, scales_, start);
  JudgedCurve judged;
  for (const CurveSample &sample : samples) {
    if (run->is_running() && (judged.phases.empty() || run->phase() != sample.phase))
      run->enter(sample.phase);
    judged.phases.push_back(run->phase());
    if (run->is_running()) run->take(sample);
    judged.zeroed_at += run->is_zeroed() ? 0 : 1;
  }
  run->end(false);
  judged.result = run->result(program_);
  return judged;
}

JudgedCurve CurveJudge::judge_followed(const CurveSample &start,
                                       std::span<const CurveSample> samples,
                                       std::uint32_t open) const {
  const auto run = std::make_unique<Run>(program_.record, scales_, start);
  JudgedCurve judged;
  for (const CurveSample &sample : samples) {
    judged.phases.push_back(run->phase());
    if (run->is_running()) run->take(sample);
    judged.zeroed_at += run->is_zeroed() ? 0 : 1;
  }
  run->end(run->is_running() && (open >> run->phase() & 1U) != 0);
  judged.result = run->result(program_);
  return judged;
}

}  // namespace forceaxis::host
