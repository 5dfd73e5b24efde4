#ifndef FIRMWARE_CANOPEN_NODE_H_
#define FIRMWARE_CANOPEN_NODE_H_

/* A CANopen node (CiA 301): NMT, heartbeat producer and consumers, SYNC consumer, SDO servers,
 * PDOs, EMCY, LSS slave (lss.h). The node is passive: canopen_receive() accepts frames between
 * ticks, which act in the next tick, and canopen_transmit() returns frames to send. Times of the
 * object table are rounded up to ticks.
 *
 * In the state pre-operational all services except PDOs work; in the state stopped only NMT and
 * heartbeat work, and emergency messages wait. Remote requests are ignored, so there is no node
 * guarding. The first service that accepts a frame receives it: NMT, heartbeat consumers, SYNC,
 * SDO, RPDOs. A frame with an identifier that this node itself sends (heartbeat, EMCY, SDO answer,
 * valid TPDO) shows another node with the same id; the node then requests the fault duplicate_node.
 * Ports do not receive their own frames. If NMT stops the node or resets its communication while
 * the axis is active, an owner on this bus is lost (fault source_lost), because no master could
 * then stop the axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* State of the axis that the node needs. */
typedef struct {
  uint16_t error_code; /* AXIS_ERROR_CODE_ */
  uint8_t fault;       /* AXIS_FAULT_ that is latched, or that a fault reaction will latch */
  uint8_t active;      /* 1: a mode other than disabled is active */
} canopen_axis_t;

/* Initialises the node with default parameters and adds the node id to the COB-IDs that contain it.
 * The node does not send until canopen_start(). node_id is 1..127; with LSS_NO_NODE_ID the node
 * only answers LSS requests. */
void canopen_init(canopen_t *canopen, uint8_t node_id);

/* Starts the node with its boot-up message: after power-up and after every reset, when the stored
 * parameters have been loaded. */
void canopen_start(canopen_t *canopen, const dictionary_t *objects);

void canopen_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* Returns the requests of the node since the last call. Call it after every other function of the
 * node, because the loss of a source must act before the next function. */
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

/* The work of the node in a tick: timers, PDOs, emergency messages; after the axis.
 * canopen_tick_begin() does what most ticks need, which is one event-driven TPDO. A tick with more
 * work, with the argument `defer`, or with a changed error code of the drive is deferred
 * completely. Between ticks, while canopen_is_behind(), one deferred tick is computed: first its
 * timers; then, after the requests are fetched, canopen_tick_end() with the resulting state of the
 * axis. The frames and their order are the same with and without deferring. Up to 255 ticks that
 * begin before a deferred tick is computed are computed after it. */
void canopen_tick_begin(canopen_t *canopen, const dictionary_t *objects, bool active, bool defer);
void canopen_tick_end(canopen_t *canopen, const dictionary_t *objects, const canopen_axis_t *axis);

static inline bool canopen_is_behind(const canopen_t *canopen) {
  return canopen->deferred != CANOPEN_DEFERRED_NOTHING;
}

/* Returns false if no timer expired and nothing was requested. */
void canopen_serve_timers(canopen_t *canopen, bool active);
static inline bool canopen_tick_timers(canopen_t *canopen, bool active) {
  const bool due = canopen->deferred == CANOPEN_DEFERRED_ALL &&
                   *canopen_timer_slot(&canopen->timers, canopen->timers.now) != 0;
  if (due) {
    canopen_serve_timers(canopen, active);
  }
  return due;
}

/* Whether the error code of the drive equals the error code that was last reported. */
static inline bool canopen_has_reported(const canopen_t *canopen, uint16_t error_code) {
  return canopen->emcy.drive_code == error_code;
}

/* Accounts for ticks that did not run because the processor was stalled; call it only while
 * canopen_is_behind() is false. A frame that was due in these ticks is sent once in the next tick.
 * Deadlines of reception are extended by the missed ticks, in which nothing could be received. */
void canopen_missed(canopen_t *canopen, uint32_t ticks);

/* Returns the next frame to send; false: there is no frame. */
bool canopen_transmit(canopen_t *canopen, can_frame_t *frame);

/* Lets `ticks` ticks pass during a change of the bit rate; see lss_is_silent(). */
void canopen_lss_tick(canopen_t *canopen, uint32_t ticks);

/* Returns the reset that NMT has requested since the last call, CANOPEN_RESET_. The caller carries
 * it out. */
uint8_t canopen_take_reset(canopen_t *canopen);

/* Received frames were lost: requests that they are counted, and sends an emergency message. */
void canopen_lost(canopen_t *canopen, uint16_t frames);

/* Sets the bus state that the controller reports, CAN_BUS_. Each change sends an emergency message;
 * with bus off all sources on the bus are lost. */
void canopen_bus(canopen_t *canopen, uint8_t state);

/* Sends an emergency message that is no fault of the axis: CiA code and manufacturer bytes. */
void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info);
void canopen_emergency_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);

/* Whether a value within its range may now be written to an object of the node: FW_OK,
 * FW_ERROR_RANGE, FW_ERROR_STATE or FW_ERROR_MAPPING; FW_ERROR_NO_OBJECT if a mapping entry names
 * no object. */
int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value);

/* Acts on a write to an object of the node, whose value was `previous` and now is `value`. A write
 * of an equal value has no effect. */
void canopen_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object,
                     int32_t previous, int32_t value);

/* Canopen owns the axis from now on: starts the deadlines of RPDOs that are not running. */
void canopen_owns(canopen_t *canopen);

/* Returns the reason why no master can be reached over the node, as a fault (AXIS_FAULT_): bus off,
 * lost heartbeat or stopped node. Returns AXIS_FAULT_NONE otherwise. */
uint8_t canopen_lost_for(const canopen_t *canopen);

/* Whether the loss of a master would be detected, because a heartbeat is monitored or an RPDO has a
 * deadline. */
bool canopen_is_watched(const canopen_t *canopen);

/* Whether an object determines if the loss of a master is detected: 1016h, or the COB-ID or
 * deadline of an RPDO. */
bool canopen_watches_by(uint16_t object);

/* The recorder was stopped or armed, so its earlier recording is lost: aborts an upload of that
 * recording. */
void canopen_recording_replaced(canopen_t *canopen);

#endif
