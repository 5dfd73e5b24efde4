#ifndef FIRMWARE_MODBUS_IDENTITY_H_
#define FIRMWARE_MODBUS_IDENTITY_H_

/* Modbus functions 17 and 43, which report the identity of the axis. Each text of the identity has
 * at most 30 characters; a longer text is truncated.
 *
 * The functions below start the work of a request; modbus_identity_resume() continues the request
 * to its end.*/

#include "firmware/modbus/step.h"

/* Answers Modbus function 17 with the unit, the run status (FFh: operation is enabled) and the name
 * of the device. */
void modbus_report_server(modbus_request_t *r);

/* Answers Modbus function 43 with MEI type 14. The request has 4 bytes. One response has room for
 * all requested identification objects. */
void modbus_identify(modbus_request_t *r);

void modbus_identity_resume(modbus_request_t *r);

#endif
