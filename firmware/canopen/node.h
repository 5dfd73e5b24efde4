#ifndef FIRMWARE_CANOPEN_NODE_H_
#define FIRMWARE_CANOPEN_NODE_H_

/* A CANopen node, CiA 301: NMT, heartbeat producer and consumers, SYNC consumer, SDO servers, PDOs,
 * EMCY, LSS slave (lss.h). Passive: frames go in by canopen_receive() between ticks and count as of
 * the coming tick; they come out by canopen_transmit(). Times of the object table are rounded up to
 * ticks.
 *
 * By state: pre-operational has all but PDOs, stopped has NMT and the heartbeat alone; emergencies
 * of a stopped node are queued. Remote requests are ignored, so there is no node guarding. A frame
 * goes to the first service that accepts it: NMT, heartbeat consumers, SYNC, SDO, RPDOs. One with
 * an identifier that this node sends itself (heartbeat, EMCY, SDO answer, valid TPDO) comes from
 * another node of its id: a request to latch the fault duplicate_node. Ports do not receive own
 * frames. A node that is stopped, or whose communication is reset, while the axis is active has
 * lost its owner (fault source_lost) if that one reaches it over this bus, since no master could
 * stop it then. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* The state of the axis that the node needs. */
typedef struct {
  uint16_t error_code; /* AXIS_ERROR_CODE_ */
  uint8_t fault;       /* AXIS_FAULT_, latched or about to be */
  uint8_t active;      /* 1: active_mode is not disabled */
} canopen_axis_t;

/* Parameters at their defaults, with the node id added where it belongs; silent until
 * canopen_start(). node_id 1..127; LSS_NO_NODE_ID: the node stays silent, but for LSS. */
void canopen_init(canopen_t *canopen, uint8_t node_id);

/* Boot-up: after power-up and after every reset, once the stored parameters are loaded. */
void canopen_start(canopen_t *canopen, const dictionary_t *objects);

void canopen_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* The node's requests since the last call. To be fetched after every other call, because the loss
 * of a source must take effect before the next one. */
static inline bool canopen_has_requests(const canopen_t *canopen) {
  const canopen_requests_t *requests = &canopen->requests;
  return requests->frames_lost != 0 || requests->sources_lost != 0 || requests->duplicate != 0;
}
static inline canopen_requests_t canopen_take_requests(canopen_t *canopen) {
  const canopen_requests_t requests = canopen->requests;
  canopen->requests.frames_lost = 0;
  canopen->requests.sources_lost = 0;
  canopen->requests.stop = 0;
  canopen->requests.duplicate = 0;
  return requests;
}

/* Once a tick, after the axis: timers, PDOs, emergencies. What is due in most ticks, one
 * event-driven TPDO, is done by canopen_tick_begin(); a tick with more to do, or one that it is
 * asked to `defer`, is deferred as a whole; so must be one with another error code of the drive.
 * Between ticks, while canopen_is_behind(), one such tick is done: its timers, then, once the
 * requests are taken, canopen_tick_end() with the state of the axis that they led to. Frames are
 * the same, in the same order, either way. Ticks that begin before a deferred one is done are made
 * up for after it, up to 255 of them. */
void canopen_tick_begin(canopen_t *canopen, const dictionary_t *objects, bool active, bool defer);
void canopen_tick_end(canopen_t *canopen, const dictionary_t *objects, const canopen_axis_t *axis);

static inline bool canopen_is_behind(const canopen_t *canopen) {
  return canopen->deferred != CANOPEN_DEFERRED_NOTHING;
}

/* False: none ran out, and nothing was requested. */
void canopen_serve_timers(canopen_t *canopen, bool active);
static inline bool canopen_tick_timers(canopen_t *canopen, bool active) {
  const bool due = canopen->deferred == CANOPEN_DEFERRED_ALL &&
                   *canopen_timer_slot(&canopen->timers, canopen->timers.now) != 0;
  if (due) {
    canopen_serve_timers(canopen, active);
  }
  return due;
}

/* Whether the error code of the drive is the one that was last reported. */
static inline bool canopen_has_reported(const canopen_t *canopen, uint16_t error_code) {
  return canopen->emcy.drive_code == error_code;
}

/* Accounts for ticks that did not run because the processor was stalled; not while
 * canopen_is_behind(). Frames due meanwhile are sent in the coming tick, once. Deadlines of
 * reception are extended by as much: nothing could be received. */
void canopen_missed(canopen_t *canopen, uint32_t ticks);

/* The next frame to be sent; false: none. */
bool canopen_transmit(canopen_t *canopen, can_frame_t *frame);

/* `ticks` ticks have passed, while the bit rate changes: lss_is_silent(). */
void canopen_lss_tick(canopen_t *canopen, uint32_t ticks);

/* A reset that NMT asked for since the last call, CANOPEN_RESET_; the caller carries it out. */
uint8_t canopen_take_reset(canopen_t *canopen);

/* Received frames were lost: a request to count them, and an emergency. */
void canopen_lost(canopen_t *canopen, uint16_t frames);

/* State of the bus as the controller reports it, CAN_BUS_; each change is an emergency, and with
 * bus off the sources on it are lost. */
void canopen_bus(canopen_t *canopen, uint8_t state);

/* An emergency that is no fault of the axis: CiA code and manufacturer bytes. */
void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info);
void canopen_emergency_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);

/* Whether a value within its range may be written now to an object of the node: FW_OK,
 * FW_ERROR_RANGE, FW_ERROR_STATE, FW_ERROR_MAPPING, or FW_ERROR_NO_OBJECT for an entry of a mapping
 * that names none. */
int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value);

/* An object of the node was `previous` and now is `value`. Writing the same value changes nothing.
 */
void canopen_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object,
                     int32_t previous, int32_t value);

/* The node owns the axis from now on: deadlines of RPDOs that are not running begin anew. */
void canopen_owns(canopen_t *canopen);

/* Why no master can be reached over the node: the fault (AXIS_FAULT_) of a bus that is off, a lost
 * heartbeat, a stopped node; AXIS_FAULT_NONE. */
uint8_t canopen_lost_for(const canopen_t *canopen);

/* Whether the loss of a master would be detected: a heartbeat is supervised, or an RPDO has a
 * deadline. */
bool canopen_is_watched(const canopen_t *canopen);

/* Whether that follows from an object: 1016h, a COB-ID or deadline of an RPDO. */
bool canopen_watches_by(uint16_t object);

/* The recorder was stopped or armed: an upload of the recording ends with an abort. */
void canopen_recording_replaced(canopen_t *canopen);

#endif
