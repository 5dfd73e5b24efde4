#include "firmware/guard/tare.h"

#include "firmware/fx/fx.h"
#include "firmware/guard/sensor.h"

/* Largest magnitude of force_tare, in 1/256 count. */
#define TARE_MAX_Q8 INT32_C(65536)

void tare_begin(tare_t *tare, drive_signals_t *signals) {
  tare->running = 1;
  tare->found = 0;
  tare->sum = 0;
  tare->count = 0;
  signals->tare_state = AXIS_TARE_STATE_RUNNING;
}

/* Converts a difference of ADC codes to a force in 1/256 count. */
static int32_t q8_of(const axis_t *axis, int32_t codes) {
  return fx_scale(codes, (uint32_t)16 - axis->params.adc_bits);
}

static void add(tare_t *tare, const axis_t *axis, uint8_t averaging) {
  const uint16_t code = axis->signals.force_raw;
  if (tare->count == 0) {
    tare->averaging = averaging;
    tare->start_cnt = axis->signals.position;
    tare->low = code;
    tare->high = code;
  }
  tare->low = (code < tare->low) ? code : tare->low;
  tare->high = (code > tare->high) ? code : tare->high;
  tare->sum += code;
  tare->count = (uint16_t)(tare->count + 1);
}

/* Returns the mean of the measured forces in 1/256 count, rounded half up: floor((2 sum + n) / (2
 * n)). */
static int64_t mean_q8(const tare_t *tare, const axis_t *axis) {
  const axis_params_t *params = &axis->params;
  const int64_t above_zero = (int64_t)tare->sum - (int64_t)tare->count * params->force_zero_code;
  int64_t mean = above_zero * params->force_sign * q8_of(axis, 2) + tare->count;
  /* The value is shifted bit by bit, because on some processors a 64-bit shift by a variable calls
   * a library function. */
  for (uint8_t i = 0; i <= tare->averaging; i++) {
    mean = fx_floor_shift_wide(mean, 1);
  }
  return mean;
}

static uint8_t conclude(tare_t *tare, const axis_t *axis) {
  const int64_t mean = mean_q8(tare, axis);
  const int32_t band = axis->params.tare_band;
  const int32_t most = (band != 0) ? band : TARE_MAX_Q8;
  if (mean < -most || mean > most) {
    return AXIS_TARE_STATE_REFUSED_BAND;
  }
  tare->tare_q8 = (int32_t)mean;
  tare->found = 1;
  return AXIS_TARE_STATE_RUNNING;
}

/* Adds the force code of a tick to the tare measurement. Returns AXIS_TARE_STATE_RUNNING, or the
 * state that gives the reason of a refusal. */
static uint8_t measure(tare_t *tare, const drive_params_t *params, const axis_t *axis) {
  if (axis->signals.active_mode != AXIS_MODE_DISABLED) {
    return AXIS_TARE_STATE_REFUSED_ENABLED;
  }
  if (axis->primed == 0 || sensor_is_railed(axis)) {
    return AXIS_TARE_STATE_REFUSED_SENSOR;
  }
  add(tare, axis, params->tare_averaging);
  if (!fx_within(fx_diff_wrap(axis->signals.position, tare->start_cnt), TARE_JITTER_CNT)) {
    return AXIS_TARE_STATE_REFUSED_MOVING;
  }
  if (params->tare_noise != 0 && q8_of(axis, tare->high - tare->low) > params->tare_noise) {
    return AXIS_TARE_STATE_REFUSED_NOISY;
  }
  return (tare->count == fx_scale(1, tare->averaging)) ? conclude(tare, axis)
                                                       : AXIS_TARE_STATE_RUNNING;
}

void tare_add_sample(tare_t *tare, const drive_params_t *params, drive_signals_t *signals,
                     const axis_t *axis) {
  signals->tare_state = measure(tare, params, axis);
  if (signals->tare_state != AXIS_TARE_STATE_RUNNING || tare->found != 0) {
    tare->running = 0;
  }
}

void tare_done(tare_t *tare, drive_signals_t *signals, uint8_t state) {
  tare->found = 0;
  signals->tare_state = state;
}
