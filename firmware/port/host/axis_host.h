#ifndef FIRMWARE_PORT_HOST_AXIS_HOST_H_
#define FIRMWARE_PORT_HOST_AXIS_HOST_H_

/* The firmware on a host: one axis behind one pointer, for Python, nodes and tests. The tick is the
 * firmware's own fw_tick() and nothing else. Axes share nothing; one axis must not be used from two
 * threads at once. Errors are those of firmware/app/fw.h. */

#include <stdbool.h>
#include <stdint.h>

/* The firmware's own headers carry no conditional, so a C++ program gets their C linkage here. */
#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/app/fw.h"

typedef struct axis_host axis_host_t;

/* A powered-up axis on no bus, with a recorder buffer of FW_RECORDER_BYTES, or NULL without
 * memory. */
axis_host_t *axis_host_create(void);

/* The same with a configuration; where that has no recorder buffer, one is allocated. */
axis_host_t *axis_host_create_with(const fw_config_t *config);

/* NULL is allowed. */
void axis_host_destroy(axis_host_t *host);

void axis_host_tick(axis_host_t *host, const axis_inputs_t *inputs, axis_outputs_t *outputs);

int axis_host_read(const axis_host_t *host, uint16_t object, int32_t *value);

/* The present signals of the axis, for callers that read them every tick. */
const axis_signals_t *axis_host_signals(const axis_host_t *host);

/* The firmware itself, for state that is no object. */
const fw_t *axis_host_firmware(const axis_host_t *host);

/* As FW_SOURCE_LOCAL: the source lock does not apply. */
int axis_host_write(axis_host_t *host, uint16_t object, int32_t value);

/* The buses, as the functions of fw.h. */
void axis_host_can_receive(axis_host_t *host, const can_frame_t *frame);
bool axis_host_can_transmit(axis_host_t *host, can_frame_t *frame);
void axis_host_can_lost(axis_host_t *host, uint16_t frames);
void axis_host_can_bus(axis_host_t *host, uint8_t state);
void axis_host_modbus_receive(axis_host_t *host, const uint8_t *bytes, uint16_t count);
uint16_t axis_host_modbus_transmit(axis_host_t *host, uint8_t *bytes, uint16_t room);
void axis_host_overrun(axis_host_t *host);

int axis_host_recorder_read(const axis_host_t *host, uint32_t index,
                            int32_t values[RECORDER_CHANNELS]);

#ifdef __cplusplus
}
#endif

#endif
