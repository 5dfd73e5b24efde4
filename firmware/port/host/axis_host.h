#ifndef FIRMWARE_PORT_HOST_AXIS_HOST_H_
#define FIRMWARE_PORT_HOST_AXIS_HOST_H_

/* The firmware as a part of a program on the host, for Python, nodes and tests. These functions
 * create and destroy a firmware. The functions of firmware/app/fw.h run it. Two axes share no data.
 * Two threads must not use one axis at the same time. */

/* The headers of the firmware contain no preprocessor conditions for C++. So a C++ program gets
 * their functions with C linkage from this file. */
#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/app/fw.h"

/* Creates an axis on no bus in its state after power-up, with a recorder buffer of
 * FW_RECORDER_BYTES. Returns NULL if there is not enough memory. */
fw_t *axis_host_create(void);

/* Creates an axis with a configuration. If the configuration has no recorder buffer, a buffer is
 * allocated. If it has no memory for cycle programs or for a curve, FW_PROGRAM_BYTES or
 * FW_CURVE_BYTES are allocated. If the axis is on buses and has no black box, a black box is
 * allocated too. */
fw_t *axis_host_create_with(const fw_config_t *config);

/* Returns the code of a DAC with `bits` bits, 12..16, that is nearest to the output: floor(dac_fine
 * / 2^(16 - bits) + 1/2). The code is exact if dac_bits is at most `bits`. */
int16_t axis_host_dac_code(const axis_outputs_t *outputs, int bits);

/* Destroys an axis that axis_host_create() or axis_host_create_with() created. NULL is
 * permitted. */
void axis_host_destroy(fw_t *fw);

#ifdef __cplusplus
}
#endif

#endif
