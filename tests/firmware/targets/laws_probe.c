/* The control laws over pseudo-random operands, as one number: the same on every target. */

#include <stdint.h>

#include "firmware/core/laws.h"
#include "firmware/fx/fx.h"

uint32_t laws_probe(uint32_t rounds);

static uint32_t step(uint32_t x) { return x * UINT32_C(1664525) + UINT32_C(1013904223); }

static uint32_t mix(uint32_t hash, int32_t value) {
  return (hash ^ (uint32_t)value) * UINT32_C(16777619);
}

uint32_t laws_probe(uint32_t rounds) {
  uint32_t hash = UINT32_C(2166136261);
  uint32_t random = 1;
  for (uint32_t i = 0; i < rounds; i++) {
    const uint32_t a = random = step(random);
    const uint32_t b = random = step(random);
    const uint32_t c = random = step(random);
    random = step(random);
    /* Operands of every width, so that neither the rails nor the small numbers are missed. */
    const uint32_t width = random >> 27;
    const int32_t x = fx_floor_shift(fx_s32_from_u32(b), width);
    const int32_t y = fx_floor_shift(fx_s32_from_u32(c), (a >> 3) & 31u);
    const int8_t sign = ((c & 1u) != 0) ? 1 : -1;
    const int32_t force = law_force_reading((uint16_t)a, (uint16_t)b, sign,
                                            (uint8_t)(8u + (c >> 1) % 9u), fx_floor_shift(x, 15));
    hash = mix(hash, force);
    hash = mix(hash, law_force((uint16_t)(a >> 16), fx_floor_shift(y, 14), force));
    hash = mix(hash, fx_round_q16(law_force((uint16_t)(a >> 22), fx_floor_shift(y, 14), force)));
    hash = mix(hash, law_excitation((int16_t)fx_floor_shift(y, 20), (uint16_t)(a & 2047u),
                                    fx_sine_q15(b)));
    hash = mix(hash, law_position((uint16_t)a, (uint16_t)(a >> 16), x, y));
    hash = mix(hash, fx_round_q16(law_position((uint16_t)(a >> 20), (uint16_t)(c >> 18), x, y)));
    hash = mix(hash, law_open_loop((int16_t)fx_floor_shift(y, 20)));
    hash = mix(hash, fx_decay(x, width));
    hash = mix(hash, fx_diff_wrap(x, y));
    hash = mix(hash, fx_within(x, 1000) ? 1 : 0);
  }
  return hash;
}
