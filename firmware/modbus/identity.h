#ifndef FIRMWARE_MODBUS_IDENTITY_H_
#define FIRMWARE_MODBUS_IDENTITY_H_

/* Functions 17 and 43: the identity of the axis. Texts have at most 30 characters; longer ones are
 * truncated.
 *
 * The functions below start the work of a request; modbus_identity_resume() continues it to its
 * end. */

#include "firmware/modbus/step.h"

/* Function 17: answers with the unit, whether operation is enabled (FFh), and the name of the
 * device. */
void modbus_report_server(modbus_request_t *r);

/* Function 43 with MEI type 14: answers a request of 4 bytes. One response has room for all
 * requested objects. */
void modbus_identify(modbus_request_t *r);

void modbus_identity_resume(modbus_request_t *r);

#endif
