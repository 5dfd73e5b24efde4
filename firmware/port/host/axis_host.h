#ifndef FIRMWARE_PORT_HOST_AXIS_HOST_H_
#define FIRMWARE_PORT_HOST_AXIS_HOST_H_

/* The firmware on a host, for Python, nodes and tests. These functions create a firmware, which the
 * functions of firmware/app/fw.h then use. Axes share no data; two threads must not use one axis at
 * the same time. */

/* The headers of the firmware contain no conditionals, so a C++ program gets their C linkage
 * here. */
#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/app/fw.h"

/* Creates a powered-up axis on no bus, with a recorder buffer of FW_RECORDER_BYTES. Returns NULL if
 * there is not enough memory. */
fw_t *axis_host_create(void);

/* Creates an axis with a configuration. If the configuration has no recorder buffer, one is
 * allocated, and on buses also a black box. */
fw_t *axis_host_create_with(const fw_config_t *config);

/* Destroys an axis that these functions created; NULL is permitted. */
void axis_host_destroy(fw_t *fw);

#ifdef __cplusplus
}
#endif

#endif
