#ifndef FIRMWARE_PORT_BUS_DRIVE_H_
#define FIRMWARE_PORT_BUS_DRIVE_H_

/* A drive on CANopen in place of a DAC and an encoder: connects the inputs and outputs of the axis
 * with the master of the drive (firmware/drive402). A port calls in each tick
 *
 *   drive402_receive(&drive.master, &frame);  each frame since the last tick
 *   bus_drive_sample(&drive, &inputs);        in port_sample()
 *   bus_drive_act(&drive, &outputs);          in port_act()
 *   while (drive402_transmit(&drive.master, &frame)) send it
 *
 * The output becomes the target of the drive: floor(code x scale_num / scale_den + 1/2), with the
 * numbers of the configuration. With scale_shift AXIS_FINE_BITS the code is dac_fine / 16, which
 * has the dac_bits of the axis; with scale_shift 0 it is dac_code. When the axis enables its
 * amplifier, the master first resets what has failed before. */

#include "firmware/core/axis_state.h"
#include "firmware/drive402/drive402.h"
#include "firmware/objects/generated/axis_objects_device.h"

typedef struct {
  drive402_t master;
  uint8_t was_enabled; /* amp_enable of the last tick */
} bus_drive_t;

/* Makes the configuration of the master from the parameters drive_ of the object table. Returns
 * false if drive_node_id is 0: there is no drive. */
bool bus_drive_config(const device_params_t *params, drive402_config_t *config);

/* Starts the master. *drive must be all zeros, and *config must exist as long as *drive. Returns
 * DRIVE402_NONE or the reason of a refusal. */
uint8_t bus_drive_init(bus_drive_t *drive, const drive402_config_t *config);

/* Sets encoder_cnt, drive and position_age of the inputs from what the drive has sent. A failure is
 * reported while the axis is enabled, the age of the position while the drive is on. */
void bus_drive_sample(const bus_drive_t *drive, axis_inputs_t *inputs);

/* Computes the frames of this tick from the outputs of the axis. */
void bus_drive_act(bus_drive_t *drive, const axis_outputs_t *outputs);

#endif
