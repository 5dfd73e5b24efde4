#ifndef FIRMWARE_CORE_AXIS_STATE_H_
#define FIRMWARE_CORE_AXIS_STATE_H_

/* The data of one axis: inputs and outputs of a tick, ranges of the DAC code, and state. The
 * functions are in axis.h. The parts of a tick (faults.h, limits.h, force_control.h) include only
 * this header. */

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

/* Number of ticks for which a range of DAC codes acts. The first tick is the tick for which the
 * drive sets the range. The second tick is needed for a code that is output one tick after its
 * computation. */
enum { AXIS_BOUNDED_TICKS = 2 };

/* End of a range of DAC codes that limits no code. The value is larger than every code, so that
 * limits_apply() still reports the saturation of the DAC. */
enum { AXIS_CODE_BEYOND = 32767 };
static inline axis_codes_t axis_codes_all(void) {
  const axis_codes_t codes = {.least = -AXIS_CODE_BEYOND, .most = AXIS_CODE_BEYOND};
  return codes;
}

typedef struct {
  int32_t encoder_cnt; /* encoder count of the position; the count wraps at 32 bits */
  /* unsigned ADC codes, 0..2^adc_bits-1: element [0] of the force, element [1] of the motor
   * current. A converter of more than 16 bits gives the upper 16 bits of each code, and adc_bits is
   * 16: below the tick rate, the noise of such a converter exceeds the bits that are lost. A
   * converter that measures both directions gives an offset code, so that force_zero_code is
   * 2^(adc_bits-1). */
  uint16_t adc_code[2];
  /* AXIS_DIGITAL_INPUTS_ bits. ENABLE: the enable chain, with the emergency stop, is closed; INDEX:
   * the encoder sent an index pulse since the last tick */
  uint8_t din;
  uint8_t sensor_valid; /* 0 if the sensor values of this tick must not be used */
  /* State that a drive on a bus reports, as AXIS_DRIVE_REPORT_ bits. FITTED: the axis has such a
   * drive; without this bit it has an amplifier for +-10 V, which reports nothing, and the other
   * bits have no meaning. ON: the drive follows the DAC code; LIMIT: a limit of the drive bounds
   * its output */
  uint8_t drive;
  /* Ages of encoder_cnt and of adc_code[0]: number of ticks since the value was read. 0 is a value
   * of this tick, and 255 is 255 ticks or more. A velocity is the travel between two positions by
   * the ticks between their readings. */
  uint8_t position_age;
  uint8_t force_age;
} axis_inputs_t;

typedef struct {
  /* DAC code, -2048..2047, in 20/4096 V; with the amplifier on, code 0 commands speed 0 */
  int16_t dac_code;
  uint8_t amp_enable;    /* 0 if the amplifier is off, so that the axis coasts */
  uint8_t brake_release; /* 1 releases the brake; only while the amplifier is on */
  /* The same output in 1/16 of a code, -32768..32752, for a port that can output more than whole
   * codes: a multiple of 2^(16 - dac_bits). dac_code is floor(dac_fine / 16 + 1/2). */
  int16_t dac_fine;
  /* Digital outputs 1 to 4, as bits 0 to 3, which fw_control() sets: those that the program of a
   * cycle has switched on up to the tick before. */
  uint8_t digital;
} axis_outputs_t;

/* Number of fractional bits of axis_outputs_t.dac_fine; smallest and largest number of bits of a
 * DAC, of which the largest outputs all bits of dac_fine. */
enum { AXIS_FINE_BITS = 4, AXIS_DAC_BITS_MIN = 12, AXIS_DAC_BITS_MAX = 16 };

/* Returns true if the axis has a drive on a bus that is not on. `drive`: its report,
 * AXIS_DRIVE_REPORT_ bits. */
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
  int32_t command_q16;     /* command before any limit, rounded to dac_bits, in 1/65536 code */
  int32_t step_mask;       /* fx_step_mask(dac_bits) */
  axis_codes_t free_codes; /* range of the output code in a tick without contact */
  /* range of the DAC code that this tick computes, also if the code is output one tick later */
  axis_codes_t law_codes;
  /* range of the DAC code that the previous tick computed; used if latency_ticks is 1 */
  axis_codes_t late_codes;
  /* number of ticks for which the ranges of DAC codes still act; AXIS_BOUNDED_TICKS after the drive
   * has set a range */
  uint8_t bounded;
  /* 1 if bumpless transfer acts at the contact, so that the DAC code continues from its previous
   * value */
  uint8_t bumpless_contact;
  uint8_t primed; /* 1 if signals.position is the encoder count of the last tick */
  /* 1 if bumpless transfer acts in the next tick, so that the next code continues from the last
   * output */
  uint8_t rebase;
  uint8_t bias_shift; /* value of bump_decay_shift at the start of the present bump bias */
  /* 1 if position_setpoint was written for the next start of position mode */
  uint8_t setpoint_new;
  /* 1 if a fault was latched between two ticks; the fault acts in the next tick */
  uint8_t fault_waits;
  /* number of ticks since the amplifier was enabled, while the drive on the bus has not reported
   * yet that it is on */
  uint16_t drive_wait_tick;
  uint8_t position_age; /* axis_inputs_t.position_age in the last tick; `force_age` likewise */
  uint8_t force_age;
  /* remainder in counts of the divisions that gave the last velocities; the magnitude is below
   * 256 */
  int16_t velocity_rest_cnt;
} axis_t;

#endif
