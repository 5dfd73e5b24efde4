#ifndef FIRMWARE_CORE_AXIS_STATE_H_
#define FIRMWARE_CORE_AXIS_STATE_H_

/* The data of one axis: inputs and outputs of a tick, bounds of the code, state. The functions are
 * in axis.h; the parts of the tick (faults.h, limits.h, force_control.h) know this header alone. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/excitation.h"
#include "firmware/core/force_law.h"
#include "firmware/core/profile.h"
#include "firmware/objects/generated/axis_objects.h"

/* Bits of axis_inputs_t.din. */
enum {
  AXIS_DIN_ENABLE = 1, /* enable and emergency-stop chain closed */
  AXIS_DIN_LIMIT_POS = 2,
  AXIS_DIN_LIMIT_NEG = 4,
  AXIS_DIN_INDEX = 8, /* an index pulse was seen since the last tick */
  AXIS_DIN_HOME = 16
};

/* Codes that may go out: least <= 0 <= most. */
typedef struct {
  int16_t least;
  int16_t most;
} axis_codes_t;

/* The tick that they are set for, and the one after it, for its late code. */
enum { AXIS_BOUNDED_TICKS = 2 };

/* These stand for no bound: they are beyond every code, so that the DAC's saturation shows. */
enum { AXIS_CODE_BEYOND = 32767 };
static inline axis_codes_t axis_codes_all(void) {
  const axis_codes_t codes = {.least = -AXIS_CODE_BEYOND, .most = AXIS_CODE_BEYOND};
  return codes;
}

typedef struct {
  int32_t encoder_cnt;  /* wraps */
  uint16_t adc_code[2]; /* [0] force, [1] motor current; unsigned, 0..2^adc_bits-1 */
  uint8_t din;          /* AXIS_DIN_ bits */
  uint8_t sensor_valid; /* 0: the sensor values of this tick must not be used */
} axis_inputs_t;

typedef struct {
  int16_t dac_code;      /* -2048..2047, 20/4096 V each; 0 with the amplifier on is zero speed */
  uint8_t amp_enable;    /* 0: coasting */
  uint8_t brake_release; /* 1 only with the amplifier on */
} axis_outputs_t;

/* At most 512 bytes with parameters. Copying it copies the axis. */
typedef struct {
  axis_params_t params;
  axis_signals_t signals;
  profile_t profile;
  excitation_t excitation;
  force_law_t law;
  int32_t excitation_q16;  /* added to the command of a force law, within +-2048 codes */
  axis_codes_t free_codes; /* bound what goes out in a tick whose reading is no contact */
  axis_codes_t law_codes;  /* bound what is computed in a tick, also where it goes out later */
  axis_codes_t late_codes; /* with latency_ticks: the bounds of the tick before, for its code */
  uint8_t bounded; /* ticks for which these bounds act, AXIS_BOUNDED_TICKS where they are set */
  uint8_t bumpless_contact; /* at a contact the code continues from the one before it */
  uint8_t primed;           /* signals.position is the count of the last tick */
  uint8_t rebase;           /* the next code continues from the one put out before it */
  uint8_t bias_shift;       /* bump_decay_shift at the change that set signals.bump_bias */
  uint8_t setpoint_new;     /* position_setpoint was written for a coming position mode */
  uint8_t fault_waits;      /* 1: the fault was latched between two ticks, and acts in the next */
} axis_t;

#endif
