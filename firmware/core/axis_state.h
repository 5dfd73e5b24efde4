#ifndef FIRMWARE_CORE_AXIS_STATE_H_
#define FIRMWARE_CORE_AXIS_STATE_H_

/* The data of one axis: inputs and outputs of a tick, ranges of the DAC code, and state. The
 * functions of the axis are in axis.h. The headers with parts of a tick (faults.h, limits.h,
 * force_control.h) include only this header. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/excitation.h"
#include "firmware/core/force_law.h"
#include "firmware/core/profile.h"
#include "firmware/objects/generated/axis_objects_axis.h"

/* Range of permitted DAC codes, from `least` to `most`; least <= 0 <= most. */
typedef struct {
  int16_t least;
  int16_t most;
} axis_codes_t;

/* Number of ticks in which a range of DAC codes acts. The drive sets the range for the first of
 * these ticks. The second tick is needed if a code is output one tick after its computation. */
enum { AXIS_BOUNDED_TICKS = 2 };

/* End value of a range of DAC codes, if the range has no limit at this end. The value is larger
 * than every code, so that limits_apply() still reports the saturation of the DAC. */
enum { AXIS_CODE_BEYOND = 32767 };
static inline axis_codes_t axis_codes_all(void) {
  const axis_codes_t codes = {.least = -AXIS_CODE_BEYOND, .most = AXIS_CODE_BEYOND};
  return codes;
}

typedef struct {
  int32_t encoder_cnt; /* encoder count of the position; the count wraps at 32 bits */
  /* unsigned ADC codes, 0..2^adc_bits-1: element [0] of the force, element [1] of the motor
   * current. An ADC with more than 16 bits gives the upper 16 bits of each code, and adc_bits is
   * then 16. The lost bits are smaller than the noise of such an ADC. An ADC for both signs of the
   * force gives an offset code, and force_zero_code is then 2^(adc_bits-1). */
  uint16_t adc_code[2];
  /* digital inputs as AXIS_DIGITAL_INPUTS_ bits. ENABLE: the enable chain, which includes the
   * emergency stop, is closed. INDEX: the encoder has sent an index pulse since the last tick */
  uint8_t din;
  uint8_t sensor_valid; /* 0 if the sensor values of this tick must not be used */
  /* State that a drive on a bus reports, as AXIS_DRIVE_REPORT_ bits. FITTED: the axis has a drive
   * on a bus. If this bit is 0, the axis has an amplifier for +-10 V, which reports nothing, and
   * all other bits have no meaning. ON: the drive follows the DAC code. LIMIT: a limit of the drive
   * itself bounds the output of the drive */
  uint8_t drive;
  /* Ages of encoder_cnt and of adc_code[0]: number of ticks since the value was read. 0 means that
   * the value was read in this tick, and 255 means 255 ticks or more. The velocity is the travel
   * between two positions divided by the number of ticks between their readings. */
  uint8_t position_age;
  uint8_t force_age;
} axis_inputs_t;

typedef struct {
  /* DAC code, -2048..2047; one code is 20/4096 V. With the amplifier on, code 0 commands speed 0 */
  int16_t dac_code;
  /* 1 if the amplifier is on; 0: the amplifier is off, and the axis coasts or its brake holds */
  uint8_t amp_enable;
  uint8_t brake_release; /* 1 releases the brake; it is 1 only while the amplifier is on */
  /* The output with a finer resolution than dac_code, in 1/16 DAC code, -32768..32752, for a board
   * whose DAC has more than 12 bits. It is a multiple of 2^(16 - dac_bits). dac_code is
   * floor(dac_fine / 16 + 1/2). */
  int16_t dac_fine;
  /* Digital outputs 1 to 4 as bits 0 to 3, which fw_control() sets. A bit is 1 if the cycle program
   * has switched this output on before this tick. */
  uint8_t digital;
} axis_outputs_t;

/* AXIS_FINE_BITS: number of fractional bits of axis_outputs_t.dac_fine. AXIS_DAC_BITS_MIN and _MAX:
 * smallest and largest number of bits of a DAC. A DAC with AXIS_DAC_BITS_MAX bits outputs all bits
 * of dac_fine. */
enum { AXIS_FINE_BITS = 4, AXIS_DAC_BITS_MIN = 12, AXIS_DAC_BITS_MAX = 16 };

/* Returns true if the axis has a drive on a bus, and this drive is not on. `drive` is the report of
 * the drive as AXIS_DRIVE_REPORT_ bits. */
static inline bool axis_drive_is_off(uint8_t drive) {
  return (drive & (AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_ON)) == AXIS_DRIVE_REPORT_FITTED;
}

/* The complete state of an axis, at most 512 bytes with its parameters. A copy of this structure is
 * a copy of the axis. */
typedef struct {
  axis_params_t params;
  axis_signals_t signals;
  profile_t profile;
  excitation_t excitation;
  force_law_t law;
  /* excitation added to the command of a force law, in 1/65536 code, within +-2048 codes */
  int32_t excitation_q16;
  /* command before any limit and without the output bias, in 1/65536 code, rounded to the
   * resolution of dac_bits */
  int32_t command_q16;
  /* mask with which the command is rounded to the resolution of the DAC: fx_step_mask(dac_bits) */
  int32_t step_mask;
  /* value of output_bias in 1/65536 code, rounded to the resolution of dac_bits and limited to
   * output_limit */
  int32_t bias_q16;
  /* last output without bias_q16, in 1/65536 code; 0 while the axis is disabled or stopped at an
   * end of its travel */
  int32_t net_q16;
  /* Ranges of DAC codes. Each is a range of the command, to which the output bias is added
   * afterwards. free_codes: range of the output in a tick without contact. */
  axis_codes_t free_codes;
  /* range of the DAC code that this tick computes, also if the code is output one tick later */
  axis_codes_t law_codes;
  /* range of the DAC code that the previous tick computed; used if latency_ticks is 1 */
  axis_codes_t late_codes;
  /* number of ticks in which the ranges of DAC codes still act. It is AXIS_BOUNDED_TICKS when the
   * drive has set a range */
  uint8_t bounded;
  /* 1 if bumpless transfer acts at the contact, so that the DAC code continues from its previous
   * value */
  uint8_t bumpless_contact;
  /* 1 if signals.position is a valid encoder count that was read in the last tick */
  uint8_t primed;
  /* 1 if bumpless transfer acts in the next tick, so that the next DAC code continues from the last
   * output */
  uint8_t rebase;
  uint8_t bias_shift; /* value of bump_decay_shift at the start of the present bump bias */
  /* 1 if position_setpoint was written for the next start of position mode */
  uint8_t setpoint_new;
  /* 1 if a fault was latched between two ticks; the fault acts in the next tick */
  uint8_t fault_waits;
  /* number of ticks since the amplifier was enabled. It counts only until the drive on the bus
   * reports that it is on */
  uint16_t drive_wait_tick;
  /* number of ticks for which the amplifier has stayed on since the axis was disabled, while the
   * brake engages; 0 in every other tick */
  uint16_t brake_tick;
  /* age of the position in the last tick, as in axis_inputs_t; `force_age`: age of the force in the
   * last tick */
  uint8_t position_age;
  uint8_t force_age;
  /* remainder of the last division that computed the velocity, in encoder counts; it is added to
   * the next velocity, and its magnitude is below 256 */
  int16_t velocity_rest_cnt;
} axis_t;

#endif
