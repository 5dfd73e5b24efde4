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
#include "firmware/objects/generated/axis_objects.h"

/* Bits of axis_inputs_t.din. */
enum {
  AXIS_DIN_ENABLE = 1, /* bit: the enable chain, with the emergency stop, is closed */
  AXIS_DIN_LIMIT_POS = 2,
  AXIS_DIN_LIMIT_NEG = 4,
  AXIS_DIN_INDEX = 8, /* bit: the encoder sent an index pulse since the last tick */
  AXIS_DIN_HOME = 16
};

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
  /* unsigned ADC codes, 0..2^adc_bits-1: [0] of the force, [1] of the motor current */
  uint16_t adc_code[2];
  uint8_t din;          /* AXIS_DIN_ bits */
  uint8_t sensor_valid; /* 0 if the sensor values of this tick must not be used */
} axis_inputs_t;

typedef struct {
  /* DAC code, -2048..2047, in 20/4096 V; with the amplifier on, code 0 commands speed 0 */
  int16_t dac_code;
  uint8_t amp_enable;    /* 0 if the amplifier is off, so that the axis coasts */
  uint8_t brake_release; /* 1 releases the brake; only while the amplifier is on */
} axis_outputs_t;

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
  axis_codes_t free_codes; /* range of the output code in a tick without contact */
  /* range of the code that a tick computes, also if the code is output one tick later */
  axis_codes_t law_codes;
  /* range of the code that the previous tick computed; used if latency_ticks is 1 */
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
} axis_t;

#endif
