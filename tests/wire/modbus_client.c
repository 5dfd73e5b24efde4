/* libmodbus on a serial line, an independent client, driven by commands.
 *
 * usage: modbus_client DEVICE BAUD UNIT
 *
 * Each line of standard input is one request, numbers decimal:
 *   1|2|3|4 FIRST COUNT         5|6 ADDRESS VALUE      15|16 FIRST VALUE...
 *   22 ADDRESS AND OR           23 READ_FIRST READ_COUNT WRITE_FIRST VALUE...
 *   17                          unit UNIT
 * and is answered by one line: "ok" and what was read, "exception N", or "error TEXT". */

#include <errno.h>
#include <modbus/modbus.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NUMBERS = 140, TIMEOUT_S = 3 };

static void show_failure(void) {
  const int code = errno - MODBUS_ENOBASE;
  if (code >= 1 && code <= 11) {
    printf("exception %d\n", code);
  } else {
    printf("error %s\n", modbus_strerror(errno));
  }
}

static void show_words(int count, const uint16_t *words) {
  printf("ok");
  for (int i = 0; i < count; i++) {
    printf(" %u", words[i]);
  }
  printf("\n");
}

static void show_bytes(int count, const uint8_t *bytes) {
  printf("ok");
  for (int i = 0; i < count; i++) {
    printf(" %u", bytes[i]);
  }
  printf("\n");
}

static void request(modbus_t *bus, int function, int count, const int *n) {
  uint16_t words[MODBUS_MAX_READ_REGISTERS] = {0};
  uint8_t bits[MODBUS_MAX_READ_BITS] = {0};
  const bool writes_words = function == 16 || function == 23;
  const int first_value = (function == 23) ? 3 : 1;
  const int values = count - first_value;
  for (int i = 0; i < values && i < MODBUS_MAX_READ_REGISTERS; i++) {
    words[i] = (uint16_t)n[first_value + i];
    bits[i] = (uint8_t)n[first_value + i];
  }
  int done = -1;
  switch (function) {
    case 1:
      done = modbus_read_bits(bus, n[0], n[1], bits);
      break;
    case 2:
      done = modbus_read_input_bits(bus, n[0], n[1], bits);
      break;
    case 3:
      done = modbus_read_registers(bus, n[0], n[1], words);
      break;
    case 4:
      done = modbus_read_input_registers(bus, n[0], n[1], words);
      break;
    case 5:
      done = modbus_write_bit(bus, n[0], n[1]);
      break;
    case 6:
      done = modbus_write_register(bus, n[0], (uint16_t)n[1]);
      break;
    case 15:
      done = modbus_write_bits(bus, n[0], values, bits);
      break;
    case 16:
      done = modbus_write_registers(bus, n[0], values, words);
      break;
    case 17:
      done = modbus_report_slave_id(bus, sizeof(bits), bits);
      break;
    case 22:
      done = modbus_mask_write_register(bus, n[0], (uint16_t)n[1], (uint16_t)n[2]);
      break;
    case 23: {
      uint16_t out[NUMBERS];
      memcpy(out, words, sizeof(words));
      done = modbus_write_and_read_registers(bus, n[2], values, out, n[0], n[1], words);
      break;
    }
    default:
      errno = EINVAL;
      break;
  }
  if (done < 0) {
    show_failure();
  } else if (function == 1 || function == 2 || function == 17) {
    show_bytes(done, bits);
  } else {
    show_words((function == 3 || function == 4 || (writes_words && function == 23)) ? done : 0,
               words);
  }
}

int main(int argc, char **argv) {
  if (argc != 4) {
    fprintf(stderr, "usage: modbus_client DEVICE BAUD UNIT\n");
    return 2;
  }
  modbus_t *bus = modbus_new_rtu(argv[1], atoi(argv[2]), 'E', 8, 1);
  if (bus == NULL || modbus_set_slave(bus, atoi(argv[3])) != 0 || modbus_connect(bus) != 0) {
    fprintf(stderr, "modbus_client: %s: %s\n", argv[1], modbus_strerror(errno));
    return 1;
  }
  modbus_set_response_timeout(bus, TIMEOUT_S, 0);
  modbus_set_error_recovery(bus, MODBUS_ERROR_RECOVERY_PROTOCOL);
  char line[2048];
  while (fgets(line, sizeof(line), stdin) != NULL) {
    int numbers[NUMBERS] = {0};
    int count = 0;
    const char *word = strtok(line, " \n");
    const bool is_unit = word != NULL && strcmp(word, "unit") == 0;
    const int function = (word == NULL) ? 0 : atoi(word);
    while ((word = strtok(NULL, " \n")) != NULL && count < NUMBERS) {
      numbers[count++] = atoi(word);
    }
    if (is_unit) {
      modbus_set_slave(bus, numbers[0]);
      printf("ok\n");
    } else {
      request(bus, function, count, numbers);
    }
    fflush(stdout);
  }
  modbus_close(bus);
  modbus_free(bus);
  return 0;
}
