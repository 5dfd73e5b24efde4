#include "firmware/drive/shaper.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_drive.h"

static uint8_t state_of(uint8_t impulses, const uint32_t *amplitude, const uint8_t *delay_tick) {
  if (impulses == 0) {
    return AXIS_FORCE_SHAPER_STATE_OFF;
  }
  uint32_t sum = 0;
  for (uint8_t i = 0; i < impulses; i++) {
    if ((i == 0) ? delay_tick[i] != 0 : delay_tick[i] <= delay_tick[i - 1]) {
      return AXIS_FORCE_SHAPER_STATE_WRONG_ORDER;
    }
    sum += amplitude[i];
  }
  return (sum == 65536) ? AXIS_FORCE_SHAPER_STATE_VALID : AXIS_FORCE_SHAPER_STATE_WRONG_SUM;
}

uint8_t shaper_set(shaper_t *shaper, uint8_t impulses, const uint32_t amplitude[SHAPER_IMPULSES],
                   const uint8_t delay_tick[SHAPER_IMPULSES]) {
  const uint8_t state = state_of(impulses, amplitude, delay_tick);
  shaper->impulses = (state == AXIS_FORCE_SHAPER_STATE_VALID) ? impulses : 0;
  for (uint8_t i = 0; i < SHAPER_IMPULSES; i++) {
    shaper->amplitude_q16[i] = (int32_t)amplitude[i];
    shaper->delay_tick[i] = delay_tick[i];
  }
  shaper->next = 0;
  shaper_clear(shaper);
  return state;
}

int32_t shaper_step(shaper_t *shaper, int32_t x, int32_t before) {
  fx_assert(shaper->impulses >= 1 && shaper->impulses <= SHAPER_IMPULSES &&
            shaper->age <= SHAPER_TICKS && shaper->delay_tick[0] == 0);
  if (shaper->age == 0) {
    shaper->before = before;
    shaper->remainder_q16 = 0;
  }
  shaper->history[shaper->next] = x;
  int64_t sum_q16 = fx_mul(shaper->amplitude_q16[0], x) + shaper->remainder_q16;
  for (uint8_t i = 1; i < shaper->impulses; i++) {
    const uint8_t delay = shaper->delay_tick[i];
    const int32_t late =
        (delay <= shaper->age) ? shaper->history[(uint8_t)(shaper->next - delay)] : shaper->before;
    sum_q16 += fx_mul(shaper->amplitude_q16[i], late);
  }
  if (shaper->age < SHAPER_TICKS) {
    shaper->age = (uint16_t)(shaper->age + 1);
  }
  shaper->next = (uint8_t)(shaper->next + 1);
  shaper->remainder_q16 = fx_field((uint32_t)sum_q16, 0, 16);
  fx_assert(fx_floor_shift_wide(sum_q16, 16) >= INT32_MIN &&
            fx_floor_shift_wide(sum_q16, 16) <= INT32_MAX);
  return (int32_t)fx_floor_shift_wide(sum_q16, 16);
}
