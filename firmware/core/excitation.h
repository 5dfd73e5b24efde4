#ifndef FIRMWARE_CORE_EXCITATION_H_
#define FIRMWARE_CORE_EXCITATION_H_

/* The waveform of excitation mode: noise, or a sine whose frequency may rise (a chirp). Noise and
 * sine can repeat exactly, so that a measurement over complete periods has no spectral leakage.
 * Frequency and amplitude may be written while the waveform runs. The phase of the sine is then
 * continuous. So a stepped sine is possible. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects_axis.h"

typedef struct {
  uint32_t random;    /* state of the generator of pseudo-random noise */
  uint32_t phase_q32; /* phase of the sine in 2^-32 turn */
  /* increase of the frequency of the chirp since its start, in 2^-32 turn per tick, modulo 1 turn
   * per tick */
  uint32_t swept_q32;
  int32_t age_tick;   /* number of ticks since the waveform started */
  uint16_t held_tick; /* number of ticks in which the present noise value is still output */
} excitation_t;

/* Returns the value of the waveform in this tick, -32768..32767 in Q15. If `start` is true, the
 * waveform starts with its first value. The returned value depends only on the parameters
 * excitation_... and on the age of the waveform. */
int32_t excitation_step(excitation_t *excitation, const axis_params_t *params, bool start);

#endif
