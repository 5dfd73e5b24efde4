#ifndef FIRMWARE_PORT_BUS_DRIVE_H_
#define FIRMWARE_PORT_BUS_DRIVE_H_

/* A drive on CANopen that replaces a DAC and an encoder. These functions connect the inputs and
 * outputs of the axis with the master of the drive (firmware/drive402). A port calls in each tick
 *
 *   drive402_receive(&drive.master, &frame);  each frame since the last tick
 *   bus_drive_sample(&drive, &inputs);        in port_sample()
 *   bus_drive_act(&drive, &outputs);          in port_act()
 *   while (drive402_transmit(&drive.master, &frame)) send it
 *
 * The DAC code becomes the target of the drive: floor(code x scale_num / scale_den + 1/2), with
 * scale_num and scale_den of the configuration. If scale_shift is AXIS_FINE_BITS, the code is
 * dac_fine / 16, which has the resolution of dac_bits. If scale_shift is 0, the code is dac_code.
 * When the axis enables its amplifier, the master first resets an earlier failure. */

#include "firmware/core/axis_state.h"
#include "firmware/drive402/drive402.h"
#include "firmware/objects/generated/axis_objects_device.h"

typedef struct {
  drive402_t master;
  uint8_t was_enabled; /* value of the output amp_enable in the last tick */
} bus_drive_t;

/* Computes the configuration of the master from the parameters of the object table whose names
 * begin with drive_. Returns false if drive_node_id is 0: there is no drive on a bus. */
bool bus_drive_config(const device_params_t *params, drive402_config_t *config);

/* Starts the master of the drive. All bytes of *drive must be 0, and *config must exist as long as
 * *drive. Returns DRIVE402_NONE, or the reason why the configuration is refused. */
uint8_t bus_drive_init(bus_drive_t *drive, const drive402_config_t *config);

/* Sets encoder_cnt, drive and position_age of the inputs from the frames that the drive has sent. A
 * failure is reported only while the axis is enabled, and the age of the position only while the
 * drive is on. */
void bus_drive_sample(const bus_drive_t *drive, axis_inputs_t *inputs);

/* Computes the frames for the drive in this tick from the outputs of the axis. */
void bus_drive_act(bus_drive_t *drive, const axis_outputs_t *outputs);

#endif
