/* This file uses threads, clocks and scheduling of Linux. */
#define _GNU_SOURCE

#include "firmware/port/linux/axis_linux.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "firmware/port/bus_drive.h"
#include "firmware/port/host/store_file.h"
#include "firmware/port/linux/can_line.h"
#include "firmware/port/linux/lateness.h"
#include "firmware/port/port.h"

/* The function main() of firmware/port/main.c. The build renames it for this program. */
int port_main(void);

enum {
  NS_IN_S = 1000000000,
  NS_IN_THREE_TICKS = 2000000,
  NS_IN_TICK = NS_IN_THREE_TICKS / 3,
  TICKS_IN_S = 1500,
  ADC_MIDDLE = 32768, /* ADC code of a force of 0 or a motor current of 0 */
  AGE_MAX = 255,      /* largest age of an input in ticks */
  /* largest number of frames that one tick receives from the bus of the drive */
  FRAMES_AT_ONCE = 64,
  /* longest time to wait for values of the drive and of the force sensor before the axis starts: 5
   * s */
  START_TICKS_MAX = 7500,
  STOP_TICKS = 300, /* time from a quick stop to the end of the process: 0.2 s */
  IDLE_MS = 2
};

static const axis_linux_config_t *config;
static fw_config_t firmware_config;
static uint8_t recorder_buffer[FW_RECORDER_BYTES];
static blackbox_t blackbox;
static uint32_t programs[FW_PROGRAM_BYTES / sizeof(uint32_t)];
static cycle_part_t results[FW_RESULTS];
static uint32_t curve[FW_CURVE_BYTES / sizeof(uint32_t)];
static store_file_t store;
static store_file_t archive;
static can_line_t supervisor;
static can_line_t drive_line;
static bus_drive_t drive;
static iio_t converter;
static lateness_t lateness;
static pthread_mutex_t mutex;
static pthread_t tick_thread;
static int wake; /* descriptor of the event that ends port_idle() */
static atomic_bool is_stopping;

/* The following variables belong to the tick thread. */
static uint16_t force_code = ADC_MIDDLE;
static uint32_t force_age = AGE_MAX;
static bool has_force;  /* true: a measured force was received */
static bool is_enabled; /* true: the last tick has enabled the axis */
static bool is_too_late;
/* number of missed ticks since the last call of port_overran(); port_lock() protects this
 * variable */
static uint32_t missed;

const fw_config_t *port_config(void) { return &firmware_config; }

void port_init(void) {}

void port_lock(void) { (void)pthread_mutex_lock(&mutex); }

void port_unlock(void) { (void)pthread_mutex_unlock(&mutex); }

bool port_overran(uint32_t *count) {
  *count = missed;
  missed = 0;
  return *count > 0;
}

/* Does nothing, because there is no watchdog timer: the drive monitors the heartbeat of this
 * process instead. */
void port_feed_watchdog(void) {}

/* If an SDO transfer of an object of the drive has failed, writes to standard error the key of the
 * settings with which the axis does not need this transfer. */
static void report_key(const drive402_feedback_t *said) {
  const char *key = drive402_key(said);
  if (key != NULL && said->reason == DRIVE402_SDO_DIFFERS) {
    (void)fprintf(stderr, "; set differs_%s = true if its own value is right", key);
  } else if (key != NULL) {
    (void)fprintf(stderr, "; set lacks_%s = true if it does the same by its own settings", key);
  }
}

/* Writes to standard error why the drive has failed, once for each failure. */
static void report_drive(void) {
  static uint8_t reported;
  port_lock();
  const drive402_feedback_t said = drive402_feedback(&drive.master);
  port_unlock();
  if (said.reason != reported && said.reason != DRIVE402_NONE) {
    (void)fprintf(stderr, "axis_linux: %s; statusword %04Xh, error code %04Xh",
                  drive402_reason_text(said.reason), said.statusword, said.error_code);
    if (said.failed_index != 0) {
      (void)fprintf(stderr, ", object %04Xh:%u", said.failed_index, said.failed_sub);
      if (said.abort_code != 0) {
        (void)fprintf(stderr, ", abort code %08" PRIX32 "h", said.abort_code);
      }
      report_key(&said);
    }
    (void)fputc('\n', stderr);
  }
  reported = said.reason;
}

/* Writes to standard error the reason why a CAN bus is off, and later that the bus works again. */
static void report_bus(const char *interface, const can_line_t *line, const char **reported) {
  port_lock();
  const char *trouble = can_line_trouble(line);
  port_unlock();
  if (trouble != *reported) {
    (void)fprintf(stderr, "axis_linux: %s: %s\n", interface,
                  (trouble != NULL) ? trouble : "the bus works again");
    *reported = trouble;
  }
}

static void report_buses(void) {
  static const char *reported[2];
  report_bus(config->supervisor_can, &supervisor, &reported[0]);
  report_bus(config->drive_can, &drive_line, &reported[1]);
}

static bool has_converter(void) { return config->iio.device != NULL; }

/* Writes to standard error why the converter gives no force, once for each reason. */
static void report_converter(void) {
  static const char *reported;
  port_lock();
  const char *trouble = has_converter() ? iio_trouble(&converter) : NULL;
  port_unlock();
  if (trouble != NULL && trouble != reported) {
    (void)fprintf(stderr, "axis_linux: %s: %s\n", config->iio.buffer, trouble);
  }
  reported = trouble;
}

/* Some objects of the axis contain times that may be too short for the bus of the drive. Writes a
 * line to standard error for each such object, once for each value of the object. */
static void report_times(void) {
  static uint32_t reported_on = UINT32_MAX;
  static uint32_t reported_age = UINT32_MAX;
  port_lock();
  const uint32_t on = port_firmware()->axis.params.drive_on_ticks_max;
  const uint32_t age = port_firmware()->drive.params.cycle_age_max;
  port_unlock();
  const uint32_t wait = fx_ticks_from_ms(config->drive.wait_ms);
  const uint32_t oldest = 2 * fx_ticks_from_ms(config->drive.cycle_ms) - 1;
  if (on != reported_on && on <= wait) {
    (void)fprintf(stderr,
                  "axis_linux: drive_on_ticks_max is %" PRIu32
                  ", but wait_ms grants the drive %" PRIu32
                  " ticks: a drive that needs longer is drive_not_ready without its reason; set "
                  "drive_on_ticks_max to more, or wait_ms to less\n",
                  on, wait);
  }
  if (age != reported_age && age < oldest) {
    (void)fprintf(stderr,
                  "axis_linux: cycle_age_max is %" PRIu32
                  ", but with this cycle_ms a position is up "
                  "to %" PRIu32
                  " ticks old while none is missing, and a part that is pressed with it "
                  "is bad; set cycle_age_max to %" PRIu32 "\n",
                  age, oldest, oldest);
  }
  reported_on = on;
  reported_age = age;
}

void port_idle(void) {
  report_times();
  report_buses();
  report_converter();
  report_drive();
  struct pollfd events[] = {{.fd = wake, .events = POLLIN},
                            {.fd = supervisor.raw.fd, .events = POLLIN}};
  uint64_t count;
  if (poll(events, 2, IDLE_MS) > 0 && (events[0].revents & POLLIN) != 0) {
    (void)!read(wake, &count, sizeof(count));
  }
}

bool port_can_receive(can_frame_t *frame) { return can_line_receive(&supervisor, frame); }
bool port_can_transmit(const can_frame_t *frame) { return can_line_send(&supervisor, frame); }
uint8_t port_can_bus(void) { return can_line_state(&supervisor); }
uint16_t port_can_lost(void) { return can_line_lost(&supervisor); }
/* Does nothing, because the user sets the bit rate with `ip link`. */
void port_can_rate(uint16_t kbit_s) { (void)kbit_s; }

/* Returns 0, because the axis has no serial line. */
uint16_t port_serial_receive(uint8_t *bytes, uint16_t room) {
  (void)bytes;
  (void)room;
  return 0;
}

uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count) {
  (void)bytes;
  return count;
}

static void note_force(void) {
  force_age = 0;
  has_force = true;
}

/* Receives all values that the drive, the load cell and the converter have sent since the last
 * tick. */
static void receive_all(void) {
  if (force_age < AGE_MAX) {
    force_age++;
  }
  if (has_converter() && iio_take(&converter, &force_code)) {
    note_force();
  }
  can_frame_t frame;
  for (int i = 0; i < FRAMES_AT_ONCE && can_line_receive(&drive_line, &frame); i++) {
    if (load_cell_take(&config->load_cell, &frame, &force_code)) {
      note_force();
    }
    drive402_receive(&drive.master, &frame);
  }
  drive402_bus(&drive.master, can_line_state(&drive_line), can_line_lost(&drive_line));
}

static void send_drive(void) {
  can_frame_t frame;
  while (drive402_transmit(&drive.master, &frame)) {
    /* If the interface refuses the frame, the frame is lost. The drive and its master detect this
     * loss. */
    (void)can_line_send(&drive_line, &frame);
  }
}

bool port_sample(axis_inputs_t *inputs) {
  receive_all();
  /* The emergency stop acts directly on the drive (STO), so this process has no enable chain. */
  *inputs = (axis_inputs_t){.din = AXIS_DIGITAL_INPUTS_ENABLE, .sensor_valid = has_force};
  inputs->adc_code[0] = force_code;
  inputs->force_age = (uint8_t)force_age;
  bus_drive_sample(&drive, inputs);
  inputs->adc_code[1] = (uint16_t)(drive402_feedback(&drive.master).torque + ADC_MIDDLE);
  return true;
}

void port_sense(axis_inputs_t *inputs) {
  (void)inputs;
  fw_board(port_firmware(), is_too_late ? AXIS_BOARD_STATE_TICK : 0, 0);
}

void port_act(const axis_outputs_t *outputs) {
  is_enabled = outputs->amp_enable != 0;
  bus_drive_act(&drive, outputs);
  send_drive();
}

/* Computes one tick of the master of the drive without the axis. The drive must stop in this
 * tick. */
static void stop_tick(void) {
  const axis_outputs_t outputs = {0};
  port_lock();
  receive_all();
  port_act(&outputs);
  port_unlock();
}

/* Returns true if the drive and the force sensor have sent values, or if the axis has waited for
 * them for the longest permitted time. */
static bool is_ready(uint64_t ticks) {
  return (has_force && drive402_feedback(&drive.master).age_ticks < AGE_MAX) ||
         ticks >= START_TICKS_MAX;
}

static uint64_t now_ns(void) {
  struct timespec now;
  (void)clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * NS_IN_S + (uint64_t)now.tv_nsec;
}

/* Converts the time `ns`, which is less than a tick, from nanoseconds to microseconds, rounded
 * up. */
static uint16_t us_of(uint64_t ns) {
  return (uint16_t)(((ns < NS_IN_TICK) ? ns : NS_IN_TICK) / 1000 + 1);
}

/* Sleeps until tick number `tick` is due. Returns the time in nanoseconds by which the thread is
 * late. */
static uint64_t wait_for(const struct timespec *start, uint64_t tick) {
  const uint64_t due_ns = (uint64_t)start->tv_nsec + tick * NS_IN_THREE_TICKS / 3;
  const struct timespec due = {.tv_sec = start->tv_sec + (time_t)(due_ns / NS_IN_S),
                               .tv_nsec = (long)(due_ns % NS_IN_S)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR) {
  }
  return now_ns() - ((uint64_t)due.tv_sec * NS_IN_S + (uint64_t)due.tv_nsec);
}

/* Stops the drive and ends the process. */
static void end(const struct timespec *start, uint64_t tick) {
  for (uint64_t last = tick + STOP_TICKS; tick <= last; tick++) {
    (void)wait_for(start, tick);
    stop_tick();
    last += (drive.master.stop_ticks > 0) ? 1 : 0;
  }
  lateness_print(&lateness);
  exit(EXIT_SUCCESS);
}

static void *run_ticks(void *unused) {
  (void)unused;
  struct timespec start;
  (void)clock_gettime(CLOCK_MONOTONIC, &start);
  bool is_running = false;
  for (uint64_t tick = 1;; tick++) {
    const uint64_t late_ns = wait_for(&start, tick);
    const uint64_t late_ticks = late_ns / NS_IN_TICK;
    if (atomic_load(&is_stopping)) {
      end(&start, tick + late_ticks);
      return NULL;
    }
    is_running = is_running || is_ready(tick);
    if (!is_running) {
      stop_tick();
      tick += late_ticks;
      continue;
    }
    lateness_add(&lateness, late_ns);
    /* A disabled axis may miss ticks, so these ticks are only counted. */
    is_too_late = is_enabled && late_ticks > config->late_ticks_max;
    tick += late_ticks;
    lateness.missed += late_ticks;
    port_lock();
    missed += (uint32_t)late_ticks;
    const uint64_t begin_ns = now_ns();
    port_tick();
    fw_tick_times(port_firmware(), us_of(now_ns() - begin_ns), us_of(late_ns % NS_IN_TICK));
    port_unlock();
    const uint64_t one = 1;
    (void)!write(wake, &one, sizeof(one));
  }
}

/* Computes ticks for `lateness_s` seconds and measures their lateness, without buses, sensors and
 * drive. */
static void *measure_ticks(void *unused) {
  (void)unused;
  struct timespec start;
  fw_t *firmware = port_firmware();
  fw_init(firmware, &firmware_config);
  (void)clock_gettime(CLOCK_MONOTONIC, &start);
  const uint64_t last = (uint64_t)config->lateness_s * TICKS_IN_S;
  for (uint64_t tick = 1; tick <= last && !atomic_load(&is_stopping); tick++) {
    const uint64_t late_ns = wait_for(&start, tick);
    const axis_inputs_t inputs = {.sensor_valid = 0};
    axis_outputs_t outputs;
    lateness_add(&lateness, late_ns);
    tick += late_ns / NS_IN_TICK;
    lateness.missed += late_ns / NS_IN_TICK;
    fw_prepare(firmware);
    fw_control(firmware, &inputs, &outputs);
    (void)fw_report(firmware);
    fw_between(firmware);
  }
  return NULL;
}

/* Starts a thread with the priority and on the CPU that the configuration gives. */
static void start_thread(void *(*run)(void *)) {
  pthread_attr_t attributes;
  (void)pthread_attr_init(&attributes);
  if (config->priority > 0) {
    const struct sched_param parameters = {.sched_priority = config->priority};
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_FIFO);
    (void)pthread_attr_setschedparam(&attributes, &parameters);
  }
  if (config->cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET((size_t)config->cpu, &cpus);
    (void)pthread_attr_setaffinity_np(&attributes, sizeof(cpus), &cpus);
  }
  const int error = pthread_create(&tick_thread, &attributes, run, NULL);
  if (error != 0) {
    (void)fprintf(
        stderr,
        "axis_linux: expected permission for SCHED_FIFO and CPU %d, got: %s; run as root, "
        "or set priority = 0\n",
        config->cpu, strerror(error));
    exit(2);
  }
}

void port_start(void) { start_thread(run_ticks); }

static void ask_for_stop(int signal_number) {
  (void)signal_number;
  atomic_store(&is_stopping, true);
}

static const char *open_bus(can_line_t *line, const char *interface) {
  const can_raw_result_t result = can_line_open(line, interface);
  return (result == CAN_RAW_OPEN) ? NULL : can_line_error(result);
}

/* Opens the CAN interfaces and all files. Returns NULL, or a text with the error. */
static const char *open_all(void) {
  static char text[1536];
  const char *const names[] = {config->supervisor_can, config->drive_can, config->store_path,
                               config->archive_path, config->iio.device};
  const char *const errors[] = {
      open_bus(&supervisor, names[0]),
      open_bus(&drive_line, names[1]),
      (names[2] != NULL) ? store_file_open(&store, names[2]) : NULL,
      (names[3] != NULL) ? archive_file_open(&archive, names[3]) : NULL,
      has_converter() ? iio_open(&converter, &config->iio) : NULL,
  };
  for (size_t i = 0; i < sizeof(errors) / sizeof(errors[0]); i++) {
    if (errors[i] != NULL) {
      (void)snprintf(text, sizeof(text), "%s: %s", names[i], errors[i]);
      return text;
    }
  }
  return NULL;
}

const char *axis_linux_run(const axis_linux_config_t *given) {
  config = given;
  const char *error = (config->lateness_s == 0) ? open_all() : NULL;
  if (error != NULL) {
    return error;
  }
  const uint8_t refused = bus_drive_init(&drive, &config->drive);
  if (refused != DRIVE402_NONE) {
    return drive402_reason_text(refused);
  }
  firmware_config = (fw_config_t){
      .recorder_buffer = recorder_buffer,
      .recorder_bytes = sizeof(recorder_buffer),
      .blackbox = &blackbox,
      .memory = (config->store_path != NULL) ? &store.memory : NULL,
      .archive = (config->archive_path != NULL) ? &archive.memory : NULL,
      .hardware = "linux",
      .node_id = config->node_id,
      .buses = 1,
      .program_memory = programs,
      .program_bytes = sizeof(programs),
      .result_memory = results,
      .result_bytes = sizeof(results),
      .curve_memory = curve,
      .curve_bytes = sizeof(curve),
  };
  pthread_mutexattr_t attributes;
  (void)pthread_mutexattr_init(&attributes);
  (void)pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
  (void)pthread_mutex_init(&mutex, &attributes);
  wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (config->priority > 0 && mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    return "expected permission to lock memory; run as root, or set priority = 0";
  }
  const struct sigaction stop = {.sa_handler = ask_for_stop};
  (void)sigaction(SIGTERM, &stop, NULL);
  (void)sigaction(SIGINT, &stop, NULL);
  if (config->lateness_s > 0) {
    start_thread(measure_ticks);
    (void)pthread_join(tick_thread, NULL);
    lateness_print(&lateness);
    exit(EXIT_SUCCESS);
  }
  (void)printf("ready\n");
  (void)fflush(stdout);
  (void)port_main();
  return NULL;
}
