#ifndef FIRMWARE_MODBUS_IDENTITY_H_
#define FIRMWARE_MODBUS_IDENTITY_H_

/* Functions 17 and 43: which axis this is. Texts are cut at 30 characters.
 *
 * The calls below begin what a request is to do; modbus_identity_resume() goes on until it ends. */

#include "firmware/modbus/step.h"

/* Function 17: unit, whether operation is enabled (FFh), the device's name. */
void modbus_report_server(modbus_request_t *r);

/* Function 43 with MEI type 14, of a request of 4 bytes. All that is asked for fits into one
 * answer. */
void modbus_identify(modbus_request_t *r);

void modbus_identity_resume(modbus_request_t *r);

#endif
