#ifndef FIRMWARE_PROTO_CANOPEN_H_
#define FIRMWARE_PROTO_CANOPEN_H_

/* A CANopen node, CiA 301: NMT, heartbeat, SYNC, SDO, PDO, EMCY. Passive: frames go in by
 * canopen_receive() between ticks and come out by canopen_transmit(). */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/proto/access.h"
#include "firmware/proto/can.h"

enum { CANOPEN_RESET_NONE = 0, CANOPEN_RESET_COMMUNICATION = 1, CANOPEN_RESET_NODE = 2 };

typedef struct {
  canopen_params_t params;
  canopen_signals_t signals;
  uint8_t node_id;
} canopen_t;

/* Parameters at their defaults, with the node id added where it belongs; silent until
 * canopen_start(). node_id 1..31. */
void canopen_init(canopen_t *canopen, uint8_t node_id);

/* Boot-up: after power-up and after every reset, once the stored parameters are loaded. */
void canopen_start(canopen_t *canopen);

void canopen_receive(canopen_t *canopen, fw_t *fw, const can_frame_t *frame);

/* Once a tick, after the axis: timers, PDOs, emergencies. */
void canopen_tick(canopen_t *canopen, fw_t *fw);

/* The next frame to be sent; false: none. */
bool canopen_transmit(canopen_t *canopen, can_frame_t *frame);

/* A reset that NMT asked for since the last call, CANOPEN_RESET_; the caller carries it out. */
uint8_t canopen_take_reset(canopen_t *canopen);

/* Frames were lost on the way in: counted in can_lost, and an emergency. */
void canopen_lost(canopen_t *canopen, fw_t *fw, uint16_t frames);

/* State of the bus as the controller tells it, CAN_BUS_; each change is an emergency, bus off takes
 * the owner away. */
void canopen_bus(canopen_t *canopen, fw_t *fw, uint8_t state);

/* An emergency that is no fault of the axis: CiA code, and what is put in its manufacturer bytes.
 */
void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info);

/* Whether a value within its range may be written now to an object of the node. */
int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value);

/* An object of the node was `previous` and now is `value`. */
void canopen_written(canopen_t *canopen, uint16_t object, int32_t previous, int32_t value);

#endif
