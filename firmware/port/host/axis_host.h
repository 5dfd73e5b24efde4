#ifndef FIRMWARE_PORT_HOST_AXIS_HOST_H_
#define FIRMWARE_PORT_HOST_AXIS_HOST_H_

/* The firmware on a host, for Python, nodes and tests: makes one, which is then used by the calls
 * of firmware/app/fw.h. Axes share nothing; one axis must not be used from two threads at once. */

/* The firmware's own headers carry no conditional, so a C++ program gets their C linkage here. */
#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/app/fw.h"

/* A powered-up axis on no bus, with a recorder buffer of FW_RECORDER_BYTES, or NULL without
 * memory. */
fw_t *axis_host_create(void);

/* The same with a configuration; where that has no recorder buffer, one is allocated, and
 * on buses a black box. */
fw_t *axis_host_create_with(const fw_config_t *config);

/* Of one that was made here; NULL is allowed. */
void axis_host_destroy(fw_t *fw);

#ifdef __cplusplus
}
#endif

#endif
