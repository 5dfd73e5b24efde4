/* The axis on a drive as a run in process: the firmware and the master of the drive for this
 * machine, with the interface of test_drive_bus.py. */

#include "firmware/app/fw.h"
#include "firmware/port/bus_drive.h"

static fw_t firmware;
static bus_drive_t drive;
static drive402_config_t config;

void begin(const int32_t *objects, const int32_t *values, int count) {
  const fw_config_t alone = {.node_id = 1, .buses = 1};
  firmware = (fw_t){0};
  drive = (bus_drive_t){0};
  fw_init(&firmware, &alone);
  for (int i = 0; i < count; i++) {
    (void)fw_object_write(&firmware, FW_SOURCE_LOCAL, (uint16_t)objects[i], values[i]);
  }
  (void)bus_drive_config(&firmware.device, &config);
  (void)bus_drive_init(&drive, &config);
}

int object_write(int object, int value) {
  return fw_object_write(&firmware, FW_SOURCE_LOCAL, (uint16_t)object, value);
}

int object_read(int object) {
  int32_t value = 0;
  (void)fw_object_read(&firmware, (uint16_t)object, &value);
  return value;
}

void receive(const can_frame_t *frame) { drive402_receive(&drive.master, frame); }

bool transmit(can_frame_t *frame) { return drive402_transmit(&drive.master, frame); }

/* A tick with the ADC code of the force in `bits` bits; the inputs get what the drive has said. The
 * master begins when the controller has joined the bus. */
void tick(axis_inputs_t *inputs, axis_outputs_t *outputs, int bits, bool has_joined) {
  drive402_bus(&drive.master, CAN_BUS_ACTIVE, 0);
  bus_drive_sample(&drive, inputs);
  const int32_t torque = drive402_feedback(&drive.master).torque;
  inputs->adc_code[1] = (uint16_t)((torque + 32768) >> (16 - bits));
  fw_tick(&firmware, inputs, outputs);
  if (has_joined) {
    bus_drive_act(&drive, outputs);
  }
}
