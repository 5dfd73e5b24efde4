#ifndef FIRMWARE_CORE_AXIS_STATE_H_
#define FIRMWARE_CORE_AXIS_STATE_H_

/* The data of one axis: inputs and outputs of a tick, bounds of the DAC code, and state. axis.h has
 * the functions. The parts of the tick (faults.h, limits.h, force_control.h) use only this
 * header. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/excitation.h"
#include "firmware/core/force_law.h"
#include "firmware/core/profile.h"
#include "firmware/objects/generated/axis_objects.h"

/* Bits of axis_inputs_t.din. */
enum {
  AXIS_DIN_ENABLE = 1, /* the chain of enable and emergency stop is closed */
  AXIS_DIN_LIMIT_POS = 2,
  AXIS_DIN_LIMIT_NEG = 4,
  AXIS_DIN_INDEX = 8, /* the encoder gave an index pulse since the last tick */
  AXIS_DIN_HOME = 16
};

/* Range of DAC codes that may be output: least <= 0 <= most. */
typedef struct {
  int16_t least;
  int16_t most;
} axis_codes_t;

/* Number of ticks for which a range of DAC codes acts: the tick for which it is set, and the next
 * tick for a code that is output one tick after its computation. */
enum { AXIS_BOUNDED_TICKS = 2 };

/* An end of a range of DAC codes that limits nothing. It is beyond every code, so that the
 * saturation of the DAC is still reported. */
enum { AXIS_CODE_BEYOND = 32767 };
static inline axis_codes_t axis_codes_all(void) {
  const axis_codes_t codes = {.least = -AXIS_CODE_BEYOND, .most = AXIS_CODE_BEYOND};
  return codes;
}

typedef struct {
  int32_t encoder_cnt; /* position in counts, wraps */
  /* ADC codes of [0] force and [1] motor current, unsigned, 0..2^adc_bits-1 */
  uint16_t adc_code[2];
  uint8_t din;          /* AXIS_DIN_ bits */
  uint8_t sensor_valid; /* 0: the sensor values of this tick must not be used */
} axis_inputs_t;

typedef struct {
  /* code -2048..2047 of 20/4096 V; 0 with the amplifier on commands speed 0 */
  int16_t dac_code;
  uint8_t amp_enable;    /* 0: the amplifier is off and the axis coasts */
  uint8_t brake_release; /* 1 only while the amplifier is on */
} axis_outputs_t;

/* The complete state of an axis, at most 512 bytes with its parameters. A copy of this structure is
 * a copy of the axis. */
typedef struct {
  axis_params_t params;
  axis_signals_t signals;
  profile_t profile;
  excitation_t excitation;
  force_law_t law;
  int32_t excitation_q16;  /* excitation added to the command of a force law, within +-2048 codes */
  axis_codes_t free_codes; /* range of the code that is output in a tick without contact */
  /* range of the code that is computed in a tick, even if it is output one tick later */
  axis_codes_t law_codes;
  /* with latency_ticks 1: range of the previous tick, for the code computed there */
  axis_codes_t late_codes;
  /* number of ticks for which these ranges still act; setting them makes it AXIS_BOUNDED_TICKS */
  uint8_t bounded;
  /* 1: at a contact, bumpless transfer makes the code continue from its previous value */
  uint8_t bumpless_contact;
  uint8_t primed; /* 1: signals.position is the encoder count of the last tick */
  /* 1: bumpless transfer makes the next code continue from the last output */
  uint8_t rebase;
  uint8_t bias_shift; /* value of bump_decay_shift when the present bump bias was set */
  /* 1: position_setpoint was written for the next start of position mode */
  uint8_t setpoint_new;
  /* 1: the fault was latched between two ticks and acts in the next tick */
  uint8_t fault_waits;
} axis_t;

#endif
