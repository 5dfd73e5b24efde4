#ifndef FIRMWARE_CANOPEN_NODE_H_
#define FIRMWARE_CANOPEN_NODE_H_

/* A CANopen node (CiA 301): NMT, heartbeat producer and consumers, SYNC consumer, SDO servers,
 * PDOs, EMCY, LSS slave (lss.h). The node is passive: canopen_receive() accepts frames between
 * ticks, which act in the next tick, and canopen_transmit() returns frames to send. Times of the
 * object table are rounded up to ticks.
 *
 * In the state pre-operational all services except PDOs work. In the state stopped only NMT and
 * heartbeat work, and emergency messages wait. Remote requests are ignored, so there is no node
 * guarding. The first of these services that accepts a frame receives the frame: NMT, heartbeat
 * consumers, SYNC, SDO, RPDOs.
 *
 * The code for a board does not pass the node its own frames. A received frame with an identifier
 * that this node itself sends (heartbeat, EMCY, SDO answer, valid TPDO) therefore shows another
 * node with the same id; the node then requests the fault duplicate_node. If NMT stops the node or
 * resets its communication while the axis is active, an owner on this bus is lost (fault
 * source_lost), because no master could then stop the axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/state.h"
#include "firmware/objects/access.h"

/* The part of the state of the axis that the node needs in canopen_tick_end(). */
typedef struct {
  uint16_t error_code; /* error code of the drive, AXIS_ERROR_CODE_ */
  /* latched fault (AXIS_FAULT_), or fault that the present fault reaction will latch */
  uint8_t fault;
  uint8_t active; /* 1: a mode other than disabled is active */
} canopen_axis_t;

/* Initialises the node with default parameters and adds the node id to the COB-IDs that contain a
 * node id. The node sends no frame before canopen_start(). node_id is 1..127; with LSS_NO_NODE_ID
 * the node only answers LSS requests. */
void canopen_init(canopen_t *canopen, uint8_t node_id);

/* Starts the node. Its first frame is the boot-up message. Call canopen_start() after power-up and
 * after every reset, when the stored parameters have been loaded. */
void canopen_start(canopen_t *canopen, const dictionary_t *objects);

void canopen_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame);

/* canopen_take_requests() returns the requests of the node since the last call. Call
 * canopen_take_requests() after every other function of the node, because the loss of a command
 * source must act before the next function is called. */
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

/* The work of the node in a tick: timers, PDOs, emergency messages. This work follows the
 * computation of the axis.
 *
 * canopen_tick_begin() does the work of most ticks, at most one event-driven TPDO. A tick is
 * deferred completely if it has more work, if the argument `defer` is true, or if the error code of
 * the drive has changed. Between ticks, while canopen_is_behind() is true, the caller computes one
 * deferred tick: first canopen_tick_timers(), then the requests of the node, then
 * canopen_tick_end() with the resulting state of the axis. The frames and their order are the same
 * with and without deferring. Up to 255 more ticks may begin before a deferred tick is computed.
 * These ticks are computed after the deferred tick. */
void canopen_tick_begin(canopen_t *canopen, const dictionary_t *objects, bool active, bool defer);
void canopen_tick_end(canopen_t *canopen, const dictionary_t *objects, const canopen_axis_t *axis);

static inline bool canopen_is_behind(const canopen_t *canopen) {
  return canopen->deferred != CANOPEN_DEFERRED_NOTHING;
}

/* Processes the timers that expire in a deferred tick. If canopen_tick_timers() returns false, no
 * timer has expired and the node has made no request. */
void canopen_serve_timers(canopen_t *canopen, bool active);
static inline bool canopen_tick_timers(canopen_t *canopen, bool active) {
  const bool due = canopen->deferred == CANOPEN_DEFERRED_ALL &&
                   *canopen_timer_slot(&canopen->timers, canopen->timers.now) != 0;
  if (due) {
    canopen_serve_timers(canopen, active);
  }
  return due;
}

/* Returns true if error_code, the error code of the drive, equals the error code that the node
 * reported last. */
static inline bool canopen_has_reported(const canopen_t *canopen, uint16_t error_code) {
  return canopen->emcy.drive_code == error_code;
}

/* Accounts for ticks that did not run because the processor was stalled. Call this function only
 * while canopen_is_behind() is false. A frame that was due in these ticks is sent once in the next
 * tick. Deadlines for received frames are extended by the missed ticks, because the node could not
 * receive frames in these ticks. */
void canopen_missed(canopen_t *canopen, uint32_t ticks);

/* Removes the next frame to send from the output queue. Returns false if there is no frame. */
bool canopen_transmit(canopen_t *canopen, can_frame_t *frame);

/* During a change of the bit rate, reduces the remaining silence of the node by `ticks` ticks; see
 * lss_is_silent(). */
void canopen_lss_tick(canopen_t *canopen, uint32_t ticks);

/* Returns the reset (CANOPEN_RESET_) that NMT or LSS has requested since the last call. The caller
 * must carry out this reset. */
uint8_t canopen_take_reset(canopen_t *canopen);

/* Reports that `frames` received frames were lost. The node requests that the firmware counts these
 * frames, and sends an emergency message. */
void canopen_lost(canopen_t *canopen, uint16_t frames);

/* Sets the bus state (CAN_BUS_) that the CAN controller reports. The node sends an emergency
 * message about each change of the state. If the state is bus off, all command sources on the bus
 * are lost. */
void canopen_bus(canopen_t *canopen, uint8_t state);

/* Sends an emergency message about an event that is no fault of the axis. `code` is the error code
 * of CiA 301; `info` and `detail` are the manufacturer bytes. */
void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info);
void canopen_emergency_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);

/* Checks whether an object of the node may now be set to `value`. The value is within the range of
 * the object. Returns FW_OK, FW_ERROR_RANGE, FW_ERROR_STATE or FW_ERROR_MAPPING, or
 * FW_ERROR_NO_OBJECT if a mapping entry contains an object that does not exist. */
int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value);

/* Acts on a write that has changed an object of the node from `previous` to `value`. If the two
 * values are equal, the function does nothing. */
void canopen_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object,
                     int32_t previous, int32_t value);

/* Call canopen_owns() when CANopen becomes the owner of the axis. The deadlines of RPDOs that are
 * not running then start as soon as the axis is active. */
void canopen_owns(canopen_t *canopen);

/* Returns the reason (AXIS_FAULT_) why no master can reach the axis over this node: bus off, lost
 * heartbeat or stopped node. Returns AXIS_FAULT_NONE if there is no such reason. */
uint8_t canopen_lost_for(const canopen_t *canopen);

/* Returns true if the node would detect the loss of a master, because a heartbeat is monitored or
 * an RPDO has a deadline. */
bool canopen_is_watched(const canopen_t *canopen);

/* Returns true if the detection of a lost master depends on this object: an entry of 1016h, or the
 * COB-ID or the deadline of an RPDO. */
bool canopen_watches_by(uint16_t object);

/* Aborts an upload of the domain with the index `index`, because the bytes of the domain are
 * lost. */
void canopen_domain_replaced(canopen_t *canopen, uint16_t index);

#endif
