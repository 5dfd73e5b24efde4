#ifndef FIRMWARE_CORE_AXIS_H_
#define FIRMWARE_CORE_AXIS_H_

/* One axis: counts in, codes out, once per tick of 1/1500 s.
 *
 * axis_tick() is the whole loop. It is a pure function of the state, the inputs and nothing else:
 * no heap, no floating point, no input or output, bounded time (at most 250 instructions on a
 * Cortex-M4). The caller owns the state, so any number of axes can run side by side.
 *
 * Parameters are the fields of axis->params and signals those of axis->signals, both generated from
 * firmware/objects/axis_objects.toml. Signals may be read between ticks. Parameters are written
 * through fw_object_write() (firmware/app/fw.h), which refuses what is out of range and then calls
 * axis_parameter_written(); axis_tick() relies on their ranges.
 *
 * Signs: positive motion is toward the workpiece, contact force is positive in compression, a
 * positive code drives toward the workpiece. With f_d = 30 counts and a reading of 28, a gain of 5
 * gives the code +10: the robot presses harder. */

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

/* Power-up: disabled, code 0, no fault, parameters at their defaults. */
void axis_init(axis_t *axis);

/* One tick.
 *
 * Faults (faults.h) are answered in the same tick: code 0, amplifier off, brake on, whatever
 * latency_ticks is; the fault is latched and the requested mode set back to disabled. Limits
 * (limits.h) only change the code, and only the one put out: with latency_ticks 1 a code computed
 * a tick ago is limited by the present position and switches, and limit_reason refers to it; and by
 * the bounds of both ticks, so that none ends a tick early (output_limit is of the present one).
 * Nothing is added behind them.
 *
 * Taking over a mode or gain: the code computed in that tick equals the one put out just before it
 * (0 after disabled); the difference to the law becomes a bias that shrinks by 2^-n a tick, at
 * least 1/65536 code, to exactly 0. n is the bump_decay_shift at the change: writing another one
 * does not change an existing bias. n = 0: no bias, the change is a step.
 *
 * Entering position mode with a position_setpoint written since position mode was last active
 * makes it active; otherwise position_setpoint is set to the present position, so the axis holds
 * it. The profile starts at rest at the present position. A fault drops a set-point that was not
 * active yet: commands from before a fault must be repeated.
 *
 * Excitation mode starts its waveform (excitation.h) in the tick that enters it.
 *
 * latency_ticks 1: the code goes out one tick after it was computed; enabling, disabling and faults
 * act at once.
 *
 * The three arguments must not overlap. */
void axis_tick(axis_t *axis, const axis_inputs_t *inputs, axis_outputs_t *outputs);

/* Whether a value within its range may be written to the parameter `object` (AXIS_OBJ_): FW_OK,
 * FW_ERROR_RANGE or, a force_tare with a tare_band while a mode is on, FW_ERROR_STATE. */
int axis_check(const axis_t *axis, uint16_t object, int32_t value);

/* Reports that the parameter `object` (AXIS_OBJ_) was `previous` and now is `value`. Writing
 * the same value again changes nothing, except that a position_setpoint is new each time. */
void axis_parameter_written(axis_t *axis, uint16_t object, int32_t previous, int32_t value);

/* axis->law.bank now is that of `number` (1..4, law_bank.h), or force_gain alone is the law (0).
 * Taken over without a bump in force mode, as another gain is; the integral goes on if the new law
 * has one. */
void axis_bank_selected(axis_t *axis, uint8_t number);

/* The gain of the force law, of force_gain and of banks alike, is halved so often (0..15) from the
 * coming tick on. Taken over without a bump. */
void axis_halve_force_gain(axis_t *axis, uint8_t halvings);

/* Latches a fault from outside the axis (AXIS_FAULT_), unless one is latched already; the axis is
 * disabled in the next tick, and the latched fault, older or not, is not cleared before it. */
void axis_fault(axis_t *axis, uint8_t fault);

/* Latches a fault that was found in the signals of a tick, and takes back the outputs of that tick:
 * code 0, amplifier off, brake on. */
void axis_trip(axis_t *axis, uint8_t fault, axis_outputs_t *outputs);

/* Clears the latched fault. The axis stays disabled until a mode is written. False: the fault still
 * waits for the tick that it acts in, and stays. */
bool axis_fault_reset(axis_t *axis);

#endif
