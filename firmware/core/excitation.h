#ifndef FIRMWARE_CORE_EXCITATION_H_
#define FIRMWARE_CORE_EXCITATION_H_

/* The waveform of excitation mode: noise, or a sine whose frequency may rise (a chirp). Both can
 * repeat exactly, so that a measurement over complete periods has no spectral leakage. Frequency
 * and amplitude may be written while the waveform runs: its phase continues, which gives a stepped
 * sine. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

typedef struct {
  uint32_t random;    /* state of the noise generator */
  uint32_t phase_q32; /* phase of the sine, in turns */
  uint32_t swept_q32; /* frequency that the chirp has added, in turns per tick modulo 1 */
  int32_t age_tick;   /* since the waveform started */
  uint16_t held_tick; /* ticks for which the present noise value still remains */
} excitation_t;

/* Returns the value of the waveform in this tick, -32768..32767 in Q15. `start` begins the waveform
 * again. The value depends only on the parameters excitation_... and on the age of the waveform. */
int32_t excitation_step(excitation_t *excitation, const axis_params_t *params, bool start);

#endif
