/* The inputs and outputs of an emulated board. The host sends inputs and receives outputs as
 * messages (records). host/link/chip_side.hpp defines the bytes of a record. Each tick interrupt
 * waits for a record and answers it. The time of the emulator stops while an interrupt waits.
 * Without a host the sensors read zero and the outputs are discarded. */

#include "firmware/port/emulated/host_link.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/port/emulated/semihosting.h"
#include "firmware/port/port.h"
#include "firmware/port/tick.h"

enum { RECORD_BYTES = 16, ANSWER_BYTES = 8, LINE_BYTES = 256 };
enum { RECORD_TICK = 1, RECORD_WRITE = 2, RECORD_END = 3, RECORD_READ = 4, RECORD_CYCLE = 5 };

static int32_t from_host;
static int32_t to_host;
static bool has_host;
static uint32_t ticks;
/* number of ticks that began before the main loop had completed the previous tick */
static uint32_t late_ticks;

/* Opens the two files in the command line "forceaxis FROM_HOST TO_HOST". */
void host_link_open(void) {
  static char line[LINE_BYTES];
  char *words[3];
  uint32_t count = 0;
  semihosting_command_line(line, sizeof(line));
  for (char *at = line; *at != 0 && count < 3;) {
    words[count] = at;
    count++;
    while (*at != 0 && *at != ' ') {
      at++;
    }
    while (*at == ' ') {
      *at = 0;
      at++;
    }
  }
  if (count == 3) {
    from_host = semihosting_open(words[1], SEMIHOSTING_READ);
    to_host = semihosting_open(words[2], SEMIHOSTING_WRITE);
    has_host = from_host >= 0 && to_host >= 0;
  }
}

bool host_link_is_open(void) { return has_host; }

static void answer(uint32_t first, uint32_t second) {
  uint8_t bytes[ANSWER_BYTES];
  fx_store_le(bytes, first, 4);
  fx_store_le(&bytes[4], second, 4);
  semihosting_write(to_host, bytes, sizeof(bytes));
}

static void write_object(const uint8_t *record) {
  const uint16_t object = (uint16_t)fx_load_le(&record[2], 2);
  const int32_t value = fx_s32_from_u32(fx_load_le(&record[4], 4));
  answer((uint32_t)fw_object_write(port_firmware(), FW_SOURCE_LOCAL, object, value), 0);
}

static void read_object(const uint8_t *record) {
  int32_t value = 0;
  const int refusal = fw_object_read(port_firmware(), (uint16_t)fx_load_le(&record[2], 2), &value);
  answer((uint32_t)refusal, (uint32_t)value);
}

/* Serves the records of the host up to the record of the next tick, and returns this last record in
 * `record`. If the host waits for each tick, the previous tick is completed first. The order is
 * then the same as without an emulator, and the results do not depend on the speed of the main
 * loop. Writes of the host make an interrupt longer, so no tick is reported as late until the main
 * loop has processed them. */
static void serve_host(uint8_t *record) {
  static bool is_behind;
  const bool is_late = port_firmware()->ticks_alone != 0;
  is_behind = is_behind && is_late;
  late_ticks += (is_late && !is_behind) ? 1 : 0;
  port_settle();
  for (;;) {
    semihosting_read(from_host, record, RECORD_BYTES);
    switch (record[0]) {
      case RECORD_TICK:
        return;
      case RECORD_WRITE:
        write_object(record);
        is_behind = true;
        break;
      case RECORD_READ:
        read_object(record);
        break;
      case RECORD_CYCLE:
        answer(port_firmware()->drive.cycle.failed_phase, late_ticks);
        break;
      default:
        /* the present interrupt is not counted, because it has computed no tick */
        answer(tick_entries() - 1, ticks);
        semihosting_exit();
    }
  }
}

bool port_sample(axis_inputs_t *inputs) {
  uint8_t record[RECORD_BYTES];
  if (!has_host) {
    *inputs = (axis_inputs_t){.din = AXIS_DIGITAL_INPUTS_ENABLE, .sensor_valid = 1};
    return true;
  }
  serve_host(record);
  ticks++;
  inputs->din = record[1];
  inputs->sensor_valid = record[2];
  inputs->drive = record[3];
  inputs->encoder_cnt = fx_s32_from_u32(fx_load_le(&record[4], 4));
  inputs->adc_code[0] = (uint16_t)fx_load_le(&record[8], 2);
  inputs->adc_code[1] = (uint16_t)fx_load_le(&record[10], 2);
  inputs->position_age = record[12];
  inputs->force_age = record[13];
  return true;
}

void port_sense(axis_inputs_t *inputs) { (void)inputs; }

void port_act(const axis_outputs_t *outputs) {
  const axis_signals_t *signals = &port_firmware()->axis.signals;
  const uint32_t out =
      (outputs->amp_enable != 0 ? 1u : 0u) | (outputs->brake_release != 0 ? 2u : 0u);
  if (has_host) {
    answer((uint16_t)outputs->dac_code | out << 16 | (uint32_t)signals->fault << 24,
           signals->limit_reason | tick_entries() << 16);
  }
}
