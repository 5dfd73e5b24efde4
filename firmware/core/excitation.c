#include "firmware/core/excitation.h"

#include "firmware/fx/fx.h"

int32_t excitation_step(excitation_t *excitation, const axis_params_t *params, bool start) {
  const uint32_t seed = params->excitation_seed;
  const int32_t period = params->excitation_period;
  if (start || (period != 0 && excitation->age_tick >= period)) {
    /* The multiplication by 2^32 divided by the golden ratio turns similar seeds into very
     * different states of the noise generator. */
    excitation->random = seed * UINT32_C(2654435769);
    excitation->phase_q32 = seed * UINT32_C(65536);
    excitation->swept_q32 = 0;
    excitation->age_tick = 0;
    excitation->held_tick = 0;
  }
  /* The age of the waveform saturates at INT32_MAX. After this age the end of a period can no
   * longer be detected. */
  excitation->age_tick += (excitation->age_tick < INT32_MAX) ? 1 : 0;
  if (params->excitation_waveform == AXIS_EXCITATION_WAVEFORM_SINE) {
    const int32_t value = fx_sine_q15(excitation->phase_q32);
    excitation->phase_q32 += params->excitation_frequency + excitation->swept_q32;
    excitation->swept_q32 += (uint32_t)params->excitation_sweep;
    return value;
  }
  if (excitation->held_tick == 0) {
    /* The noise generator is a linear congruential generator with modulus 2^32 (Knuth). Only the
     * upper 16 bits of its state are sufficiently random. */
    excitation->random = excitation->random * UINT32_C(1664525) + UINT32_C(1013904223);
    excitation->held_tick = params->excitation_hold;
  }
  excitation->held_tick = (uint16_t)(excitation->held_tick - 1);
  return fx_floor_shift(fx_s32_from_u32(excitation->random), 16);
}
