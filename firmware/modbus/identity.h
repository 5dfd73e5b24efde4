#ifndef FIRMWARE_MODBUS_IDENTITY_H_
#define FIRMWARE_MODBUS_IDENTITY_H_

/* Functions 17 and 43: the identity of the axis. Texts are cut at 30 characters.
 *
 * The calls below start the work of a request; modbus_identity_resume() continues it to its end. */

#include "firmware/modbus/step.h"

/* Function 17: unit, whether operation is enabled (FFh), the device's name. */
void modbus_report_server(modbus_request_t *r);

/* Function 43 with MEI type 14, of a request of 4 bytes. All requested objects fit into one
 * response. */
void modbus_identify(modbus_request_t *r);

void modbus_identity_resume(modbus_request_t *r);

#endif
