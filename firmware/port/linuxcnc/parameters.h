#ifndef FIRMWARE_PORT_LINUXCNC_PARAMETERS_H_
#define FIRMWARE_PORT_LINUXCNC_PARAMETERS_H_

/* The headers of the firmware contain no preprocessor conditions for C++. So a C++ program gets
 * their functions with C linkage from this file. */
#ifdef __cplusplus
extern "C" {
#endif

#include "firmware/app/fw.h"

/* Writes the parameters in a file to the firmware. The file comes from `forceaxis axis params
 * dump`. Its table [canopen] is skipped, because the component is on no bus. Returns NULL, or one
 * line that states where the file is wrong, what was expected and what to do. The line is valid
 * until the next call. host/linuxcnc/parameters.cpp implements this function. */
const char *parameters_load(fw_t *firmware, const char *file);

#ifdef __cplusplus
}
#endif

#endif
