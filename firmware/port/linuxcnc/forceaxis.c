/* The firmware of one axis as a realtime component of LinuxCNC (HAL, uspace). README.md beside this
 * file lists the pins. */

#include <hal.h>
#include <math.h>
#include <pthread.h>
#include <rtapi.h>
#include <rtapi_app.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "firmware/app/fw.h"
#include "firmware/objects/generated/axis_objects_meta.h"
#include "firmware/port/linuxcnc/parameters.h"

enum {
  PERIOD_NS = 666667,
  PERIOD_TOLERANCE_NS = 1,
  /* largest number of HAL pins that write objects; also the largest number of HAL pins that show
   * objects */
  OBJECTS_MAX = 32,
  LATE_TICKS = 3,           /* initial value of the HAL parameter late-ticks-max */
  LATE_TICKS_MAX = 1000,    /* largest value of late-ticks-max */
  WATCH_UNTIMED_TICKS = 15, /* number of ticks between two checks for a new fault */
  AGE_MAX = 255
};

/* HAL pins and HAL parameters of the component. This structure is in memory of HAL. */
typedef struct {
  hal_s32_t *encoder_count;
  hal_u32_t *force_code;
  hal_float_t *force;
  hal_u32_t *current_code;
  hal_bit_t *sensor_valid;
  hal_u32_t *position_age;
  hal_u32_t *force_age;
  hal_bit_t *enable;
  hal_bit_t *limit_pos;
  hal_bit_t *limit_neg;
  hal_bit_t *index;
  hal_bit_t *home;
  hal_bit_t *drive_fitted;
  hal_bit_t *drive_on;
  hal_bit_t *drive_fault;
  hal_bit_t *drive_limit;
  hal_float_t *command;
  hal_s32_t *code;
  hal_bit_t *amp_enable;
  hal_bit_t *brake_release;
  hal_bit_t *fault;
  hal_u32_t *fault_code;
  hal_bit_t *contact;
  hal_u32_t *limit_reason;
  hal_u32_t *refused;
  hal_s32_t *inputs[OBJECTS_MAX];
  hal_s32_t *outputs[OBJECTS_MAX];
  hal_float_t command_scale;
  hal_float_t force_scale;
  hal_float_t force_offset;
  hal_u32_t late_ticks_max;
} pins_t;

typedef struct {
  const char *name;
  hal_type_t type;
  int direction; /* direction of the pin or parameter, hal_pin_dir_t or hal_param_dir_t */
  size_t offset; /* offset of the pin or parameter in pins_t, in bytes */
} pin_t;

#define PIN(name, type, direction, member) \
  { name, type, direction, offsetof(pins_t, member) }
static const pin_t fixed_pins[] = {
    PIN("encoder-count", HAL_S32, HAL_IN, encoder_count),
    PIN("force-code", HAL_U32, HAL_IN, force_code),
    PIN("force", HAL_FLOAT, HAL_IN, force),
    PIN("current-code", HAL_U32, HAL_IN, current_code),
    PIN("sensor-valid", HAL_BIT, HAL_IN, sensor_valid),
    PIN("position-age", HAL_U32, HAL_IN, position_age),
    PIN("force-age", HAL_U32, HAL_IN, force_age),
    PIN("enable", HAL_BIT, HAL_IN, enable),
    PIN("limit-pos", HAL_BIT, HAL_IN, limit_pos),
    PIN("limit-neg", HAL_BIT, HAL_IN, limit_neg),
    PIN("index", HAL_BIT, HAL_IN, index),
    PIN("home", HAL_BIT, HAL_IN, home),
    PIN("drive-fitted", HAL_BIT, HAL_IN, drive_fitted),
    PIN("drive-on", HAL_BIT, HAL_IN, drive_on),
    PIN("drive-fault", HAL_BIT, HAL_IN, drive_fault),
    PIN("drive-limit", HAL_BIT, HAL_IN, drive_limit),
    PIN("command", HAL_FLOAT, HAL_OUT, command),
    PIN("code", HAL_S32, HAL_OUT, code),
    PIN("amp-enable", HAL_BIT, HAL_OUT, amp_enable),
    PIN("brake-release", HAL_BIT, HAL_OUT, brake_release),
    PIN("fault", HAL_BIT, HAL_OUT, fault),
    PIN("fault-code", HAL_U32, HAL_OUT, fault_code),
    PIN("contact", HAL_BIT, HAL_OUT, contact),
    PIN("limit-reason", HAL_U32, HAL_OUT, limit_reason),
    PIN("refused", HAL_U32, HAL_OUT, refused),
};
static const pin_t hal_parameters[] = {
    PIN("command-scale", HAL_FLOAT, HAL_RW, command_scale),
    PIN("force-scale", HAL_FLOAT, HAL_RW, force_scale),
    PIN("force-offset", HAL_FLOAT, HAL_RW, force_offset),
    PIN("late-ticks-max", HAL_U32, HAL_RW, late_ticks_max),
};

static char *parameters;
RTAPI_MP_STRING(parameters, "file of `forceaxis axis params dump`");
static char *inputs[OBJECTS_MAX];
RTAPI_MP_ARRAY_STRING(inputs, OBJECTS_MAX, "objects that pins write");
static char *outputs[OBJECTS_MAX];
RTAPI_MP_ARRAY_STRING(outputs, OBJECTS_MAX, "objects that pins show");
static const char *const usual_inputs[] = {"force_setpoint", "position_setpoint", "open_loop_code",
                                           "fault_reset", "mode"};
static const char *const usual_outputs[] = {"force", "position"};

/* An object of the firmware whose value a HAL pin sets or shows. */
typedef struct {
  const axis_object_meta_t *meta;
  int32_t last; /* value of the HAL pin in the last tick */
} object_t;

static fw_t firmware;
static pins_t *pins;
static object_t written[OBJECTS_MAX];
static object_t shown[OBJECTS_MAX];
static uint8_t written_count;
static uint8_t shown_count;
static long long last_ns; /* time at which the last tick began, in ns; 0 before the first tick */
/* true if the last tick has enabled the axis; the watcher thread may have cleared the HAL pin since
 * then */
static bool was_enabled;
static int component;
static pthread_t watcher;
static atomic_uint ticks;
/* true: the watcher thread has found that the HAL thread that computes the ticks no longer runs */
static atomic_bool is_halted;
static atomic_bool is_ending;

static void set_outputs(const axis_outputs_t *outputs_now) {
  *pins->code = outputs_now->dac_code;
  *pins->command = ldexp(outputs_now->dac_fine, -AXIS_FINE_BITS) * pins->command_scale;
  *pins->amp_enable = outputs_now->amp_enable != 0;
  *pins->brake_release = outputs_now->brake_release != 0;
}

static void set_safe_outputs(void) {
  const axis_outputs_t safe = {0};
  set_outputs(&safe);
}

/* Writes each object whose HAL pin has changed. If the object is a command, the value 0 does not
 * execute it. */
static void write_objects(void) {
  for (uint8_t i = 0; i < written_count; i++) {
    object_t *object = &written[i];
    const int32_t value = *pins->inputs[i];
    if (value == object->last) {
      continue;
    }
    object->last = value;
    const bool is_idle = value == 0 && strcmp(object->meta->kind, "command") == 0;
    if (!is_idle &&
        fw_object_write(&firmware, FW_SOURCE_LOCAL, object->meta->object, value) != FW_OK) {
      *pins->refused += 1;
    }
  }
}

static int32_t object_value(uint16_t object) {
  int32_t value = 0;
  (void)fw_object_read(&firmware, object, &value);
  return value;
}

static void show_objects(void) {
  for (uint8_t i = 0; i < shown_count; i++) {
    *pins->outputs[i] = object_value(shown[i].meta->object);
  }
  *pins->fault_code = (uint32_t)object_value(AXIS_OBJ_FAULT);
  *pins->fault = *pins->fault_code != AXIS_FAULT_NONE;
  *pins->contact = object_value(AXIS_OBJ_CONTACT) != 0;
  *pins->limit_reason = (uint32_t)object_value(AXIS_OBJ_LIMIT_REASON);
}

/* Computes the ADC code of the force from the HAL pins. Returns false if this code is outside the
 * range of ADC codes. */
static bool read_force(uint16_t *code) {
  if (pins->force_scale == 0.0) {
    *code = (uint16_t)*pins->force_code;
    return *pins->force_code <= UINT16_MAX;
  }
  const double exact = rint(*pins->force * pins->force_scale + pins->force_offset);
  const bool is_code = exact >= 0.0 && exact < ldexp(1.0, firmware.axis.params.adc_bits);
  *code = is_code ? (uint16_t)exact : 0;
  return is_code;
}

static uint8_t age(uint32_t pin) { return (uint8_t)((pin < AGE_MAX) ? pin : AGE_MAX); }

static uint8_t bit(bool pin, uint8_t mask) { return pin ? mask : 0; }

static axis_inputs_t read_inputs(void) {
  axis_inputs_t now = {
      .encoder_cnt = *pins->encoder_count,
      .position_age = age(*pins->position_age),
      .force_age = age(*pins->force_age),
      .din = (uint8_t)(bit(*pins->enable, AXIS_DIGITAL_INPUTS_ENABLE) |
                       bit(*pins->limit_pos, AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE) |
                       bit(*pins->limit_neg, AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE) |
                       bit(*pins->index, AXIS_DIGITAL_INPUTS_INDEX) |
                       bit(*pins->home, AXIS_DIGITAL_INPUTS_HOME)),
      .drive =
          (uint8_t)(bit(*pins->drive_on, AXIS_DRIVE_REPORT_ON) |
                    bit(*pins->drive_fault, AXIS_DRIVE_REPORT_FAULT) |
                    bit(*pins->drive_limit, AXIS_DRIVE_REPORT_LIMIT) | AXIS_DRIVE_REPORT_FITTED),
  };
  if (!*pins->drive_fitted) {
    now.drive = 0;
  }
  now.adc_code[1] = (uint16_t)*pins->current_code;
  const bool has_force = read_force(&now.adc_code[0]);
  now.sensor_valid = has_force && *pins->current_code <= UINT16_MAX && *pins->sensor_valid;
  return now;
}

/* Returns the number of whole ticks by which this tick is late. If late-ticks-max is 0, the
 * lateness of ticks is not measured. */
static uint32_t late_ticks(void) {
  const long long now_ns = rtapi_get_time();
  const long long elapsed_ns = (last_ns == 0) ? 0 : now_ns - last_ns;
  last_ns = now_ns;
  if (pins->late_ticks_max == 0 || elapsed_ns < 2 * PERIOD_NS) {
    return 0;
  }
  return (uint32_t)(elapsed_ns / PERIOD_NS - 1);
}

static bool is_wrong_period(long period_ns) {
  static bool is_reported;
  const bool is_wrong = period_ns < PERIOD_NS - PERIOD_TOLERANCE_NS || period_ns > PERIOD_NS;
  if (is_wrong && !is_reported) {
    rtapi_print_msg(RTAPI_MSG_ERR,
                    "forceaxis: expected a thread of %d ns, got %ld ns; the axis stays disabled: "
                    "add forceaxis.update to a thread with period1=%d\n",
                    PERIOD_NS, period_ns, PERIOD_NS);
    is_reported = true;
  }
  return is_wrong;
}

/* Computes one tick. A thread of HAL calls this function. */
static void update(void *unused, long period_ns) {
  (void)unused;
  const uint32_t late = late_ticks();
  const bool was_halted = atomic_exchange(&is_halted, false);
  /* A disabled axis may be late, so late ticks are then only counted. */
  const bool is_late = was_enabled && (was_halted || late > pins->late_ticks_max);
  const bool is_timely = !is_wrong_period(period_ns) && !is_late;
  const axis_inputs_t now = read_inputs();
  axis_outputs_t outputs_now;
  write_objects();
  fw_prepare(&firmware);
  fw_board(&firmware, is_timely ? 0 : AXIS_BOARD_STATE_TICK, 0);
  fw_control(&firmware, &now, &outputs_now);
  set_outputs(&outputs_now);
  was_enabled = outputs_now.amp_enable != 0;
  (void)fw_report(&firmware);
  fw_between(&firmware);
  if (late > 0) {
    /* HAL computes each late tick afterwards, so the number of missed ticks is 0 */
    fw_overrun(&firmware, 0);
  }
  show_objects();
  (void)atomic_fetch_add(&ticks, 1);
}

/* If there is a new fault, reports its name. */
static void report_fault(void) {
  static uint32_t reported = AXIS_FAULT_NONE;
  const uint32_t code = *pins->fault_code;
  const char *name = axis_objects_meta[AXIS_OBJ_FAULT - 1].enum_texts;
  for (uint32_t i = 0; i < code && name != NULL; i++) {
    name = strchr(name, ',');
    name = (name != NULL) ? name + 1 : NULL;
  }
  if (code != reported && code != AXIS_FAULT_NONE && name != NULL) {
    rtapi_print_msg(RTAPI_MSG_ERR, "forceaxis: fault %u, %.*s\n", code, (int)strcspn(name, ","),
                    name);
  }
  reported = code;
}

/* Sleeps for longer than late-ticks-max ticks. Returns false if the lateness of ticks is not
 * measured. */
static bool wait_for_ticks(void) {
  const uint32_t limit = pins->late_ticks_max;
  const uint32_t timed = (limit < LATE_TICKS_MAX) ? limit + 1 : LATE_TICKS_MAX + 1;
  const struct timespec wait = {.tv_nsec =
                                    (long)((limit > 0) ? timed : WATCH_UNTIMED_TICKS) * PERIOD_NS};
  (void)nanosleep(&wait, NULL);
  return limit > 0;
}

/* The watcher thread. It makes the outputs safe when the HAL thread that computes the ticks no
 * longer runs. Nothing else makes them safe in this case. */
static void *watch(void *unused) {
  (void)unused;
  unsigned seen = 0;
  while (!atomic_load(&is_ending)) {
    const bool is_timed = wait_for_ticks();
    const unsigned now = atomic_load(&ticks);
    if (is_timed && now == seen) {
      atomic_store(&is_halted, now > 0);
      set_safe_outputs();
    }
    seen = now;
    report_fault();
  }
  return NULL;
}

static int refuse(const char *text) {
  rtapi_print_msg(RTAPI_MSG_ERR, "forceaxis: %s\n", text);
  return -1;
}

static int load_parameters(void) {
  static uint8_t recorder_buffer[FW_RECORDER_BYTES];
  const fw_config_t config = {.recorder_buffer = recorder_buffer,
                              .recorder_bytes = sizeof(recorder_buffer),
                              .hardware = "linuxcnc"};
  fw_init(&firmware, &config);
  const char *error = (parameters != NULL) ? parameters_load(&firmware, parameters) : NULL;
  if (error != NULL) {
    return refuse(error);
  }
  /* Starts the drive by a write to one of its objects, because the drive computes the signal
   * `contact`. */
  return fw_object_write(&firmware, FW_SOURCE_LOCAL, AXIS_OBJ_VELOCITY_THRESHOLD,
                         object_value(AXIS_OBJ_VELOCITY_THRESHOLD));
}

static int make_fixed_pins(void) {
  char name[HAL_NAME_LEN + 1];
  int status = 0;
  for (size_t i = 0; i < sizeof(fixed_pins) / sizeof(fixed_pins[0]) && status == 0; i++) {
    const pin_t *pin = &fixed_pins[i];
    (void)snprintf(name, sizeof(name), "forceaxis.%s", pin->name);
    status = hal_pin_new(name, pin->type, (hal_pin_dir_t)pin->direction,
                         (void **)((char *)pins + pin->offset), component);
  }
  for (size_t i = 0; i < sizeof(hal_parameters) / sizeof(hal_parameters[0]) && status == 0; i++) {
    const pin_t *pin = &hal_parameters[i];
    (void)snprintf(name, sizeof(name), "forceaxis.%s", pin->name);
    status = hal_param_new(name, pin->type, (hal_param_dir_t)pin->direction,
                           (char *)pins + pin->offset, component);
  }
  if (status == 0) {
    *pins->drive_fitted = true;
    pins->command_scale = 1.0;
    pins->late_ticks_max = LATE_TICKS;
  }
  return status;
}

static const axis_object_meta_t *find_object(const char *name, const char *without_access) {
  for (size_t i = 0; i < AXIS_OBJECTS_META_COUNT; i++) {
    const axis_object_meta_t *meta = &axis_objects_meta[i];
    if (strcmp(meta->name, name) == 0 && strcmp(meta->access, without_access) != 0) {
      return meta;
    }
  }
  return NULL;
}

/* Makes the HAL pin forceaxis.in.NAME or forceaxis.out.NAME of an object. NAME is the name of the
 * object, with each "_" replaced by "-". */
static int make_object_pin(object_t *object, const char *name, hal_pin_dir_t direction,
                           hal_s32_t **pin) {
  char text[160];
  char pin_name[HAL_NAME_LEN + 1];
  const bool is_input = direction == HAL_IN;
  object->meta = find_object(name, is_input ? "ro" : "wo");
  if (object->meta == NULL) {
    (void)snprintf(text, sizeof(text),
                   "%s: expected the name of an object that can be %s, got %.40s; choose one of "
                   "docs/objects/objects.md",
                   is_input ? "inputs" : "outputs", is_input ? "written" : "read", name);
    return refuse(text);
  }
  (void)snprintf(pin_name, sizeof(pin_name), "forceaxis.%s.%s", is_input ? "in" : "out", name);
  for (char *at = pin_name; *at != '\0'; at++) {
    *at = (char)((*at == '_') ? '-' : *at);
  }
  const int status = hal_pin_s32_new(pin_name, direction, pin, component);
  if (status == 0) {
    object->last = object_value(object->meta->object);
    **pin = object->last;
  }
  return status;
}

/* Returns the name with the index i of `given`, the names of objects in the command loadrt. If this
 * command names no object, returns the name with the index i of `usual`. */
static const char *name_of(char *const *given, const char *const *usual, size_t count, size_t i) {
  if (given[0] != NULL) {
    return (i < OBJECTS_MAX) ? given[i] : NULL;
  }
  return (i < count) ? usual[i] : NULL;
}

static int make_object_pins(void) {
  const size_t ins = sizeof(usual_inputs) / sizeof(usual_inputs[0]);
  const size_t outs = sizeof(usual_outputs) / sizeof(usual_outputs[0]);
  const char *name;
  int status = 0;
  while (status == 0 && (name = name_of(inputs, usual_inputs, ins, written_count)) != NULL) {
    status = make_object_pin(&written[written_count], name, HAL_IN, &pins->inputs[written_count]);
    written_count++;
  }
  while (status == 0 && (name = name_of(outputs, usual_outputs, outs, shown_count)) != NULL) {
    status = make_object_pin(&shown[shown_count], name, HAL_OUT, &pins->outputs[shown_count]);
    shown_count++;
  }
  return status;
}

static int load(void) {
  pins = hal_malloc(sizeof(*pins));
  if (pins == NULL) {
    return refuse("expected memory of HAL, got none; unload other components");
  }
  (void)memset(pins, 0, sizeof(*pins));
  int status = load_parameters();
  status = (status == 0) ? make_fixed_pins() : status;
  status = (status == 0) ? make_object_pins() : status;
  status =
      (status == 0) ? hal_export_funct("forceaxis.update", update, NULL, 1, 0, component) : status;
  return (status == 0) ? pthread_create(&watcher, NULL, watch, NULL) : status;
}

int rtapi_app_main(void) {
  component = hal_init("forceaxis");
  if (component < 0) {
    return component;
  }
  if (load() != 0) {
    (void)hal_exit(component);
    return -1;
  }
  return hal_ready(component);
}

void rtapi_app_exit(void) {
  atomic_store(&is_ending, true);
  (void)pthread_join(watcher, NULL);
  set_safe_outputs();
  (void)hal_exit(component);
}
