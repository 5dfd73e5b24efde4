#ifndef FIRMWARE_DRIVE402_DRIVE402_H_
#define FIRMWARE_DRIVE402_DRIVE402_H_

/* Master of one drive with the CiA 402 profile on CANopen, in cyclic synchronous velocity, torque
 * or position mode. Frames in, frames out: it has no device and no clock. A port uses it so that an
 * axis commands a drive that the user has:
 *
 *   drive402_t master = {0};
 *   drive402_init(&master, &config);           configuration: drive402_state.h
 *   in each tick of 1/1500 s:
 *     drive402_receive(&master, &frame);       each frame since the last tick
 *     drive402_bus(&master, state, lost);      if the bus has a state to report
 *     feedback = drive402_feedback(&master);   inputs of the axis
 *     drive402_tick(&master, &command);        outputs of the axis
 *     while (drive402_transmit(&master, &frame))  at most DRIVE402_FRAMES frames to send
 *
 * Start. The master resets the node of the drive, waits for its boot-up message, writes the list of
 * objects and reads back each one: no SYNC counter, heartbeats both ways, abort connection option,
 * first RPDO {6040h, target} and first TPDO {6041h, 6064h, 6077h} on every SYNC, period, mode. An
 * object whose write the drive refuses is right if it has the value already. `without` leaves
 * objects out, `differs` lets the drive keep other values. Then it starts the node, and runs once
 * the drive is operational and has sent a TPDO. It neither needs nor changes other PDOs, and uses
 * the predefined connection set of CiA 301.
 *
 * Cycle. In each bus cycle the master sends SYNC and RPDO. A cycle is a multiple of 2 ms, that is
 * of 3 ticks. A cycle without TPDO keeps the last values, whose age grows; after a second one in
 * succession the fault TPDO_MISSING acts. Of two TPDOs in a cycle the newest one counts; in two
 * cycles in succession they are the fault DOUBLED, as are two answers to two downloads. The first
 * frame after a missing one may be the missing one, so its age is counted from the earlier SYNC. A
 * drive that answers each SYNC after the next one is not noticed: give it a longer cycle.
 *
 * States. While `enable` is 1 and nothing has failed, the master brings the drive to operation
 * enabled, one transition in a cycle. The feedback reports `on`, and targets act, once the drive is
 * enabled, bits 9 (remote) and 12 (follows its target) of the statusword are 1, and 6061h displays
 * the mode; the master reads 6061h by SDO every 10 ms. Otherwise the target is 0, in csp the
 * position of the drive. A drive that is not on after wait_ms fails with what is missing.
 *
 * Stop. If `enable` becomes 0 or something fails, the next frame commands quick stop and target 0.
 * It is sent in the same tick, also between two cycles. When the drive shows switch on disabled or
 * fault, at the latest after quick_stop_ms, the master disables voltage. It accepts a stop in every
 * state and keeps the cycle going after a failure. The drive is enabled again only from the state
 * switch on disabled.
 *
 * Emergency messages. The code of each one is kept. It is a failure if the error register in it
 * (1001h) is not 0; with the register 0 it is a warning. Code 0, the end of an error, is neither.
 *
 * Failures. The first reason since the last reset stays in the feedback, for SDO with its object
 * and abort code. Nothing is retried without `reset`, but an SDO request without an answer is,
 * once. A fault of the drive (DRIVE_FAULT, DRIVE_EMERGENCY, DRIVE_OFF) is reset in place by 6040h
 * bit 7, which is 1 until the fault has gone, at most for wait_ms; after it the fault is reported
 * again. After NOT_REMOTE, NOT_ENABLED and TARGET_IGNORED nothing is to be reset. After every other
 * failure `reset` starts with the reset of the node, once a stop has ended. Without the master's
 * heartbeat the drive itself has to stop, by 1016h and 6007h.
 *
 * Cost of a tick: at most DRIVE402_FRAMES frames, no loop beyond the eight codings of a state, no
 * division. */

#include "firmware/drive402/drive402_state.h"

/* Starts a master. *master must be all zeros, and *config must exist as long as *master. Returns
 * DRIVE402_NONE, or the reason of a refusal; a refused master sends nothing and stays in fault. */
uint8_t drive402_init(drive402_t *master, const drive402_config_t *config);

/* Processes a received frame. Frames that are not from the drive, and remote requests, are
 * ignored. */
void drive402_receive(drive402_t *master, const can_frame_t *frame);

/* Call this function to report the state of the bus (CAN_BUS_) and the number of received frames
 * that were lost since the last call. Bus off and lost frames are failures. */
void drive402_bus(drive402_t *master, uint8_t state, uint16_t frames_lost);

/* Returns the state and the values of the drive, from all frames received so far. */
drive402_feedback_t drive402_feedback(const drive402_t *master);

/* Call this function once in each tick of 1/1500 s. If frames of the last tick were not fetched,
 * they are discarded, and this is a failure. */
void drive402_tick(drive402_t *master, const drive402_command_t *command);

/* Fetches the next frame to send. Returns false if there is none. */
bool drive402_transmit(drive402_t *master, can_frame_t *frame);

/* Return the text for a phase, state or reason, for a user: a sentence without a full stop. */
const char *drive402_phase_text(uint8_t phase);
const char *drive402_state_text(uint8_t state);
const char *drive402_reason_text(uint8_t reason);

/* Returns the end of a key in the settings of axis_linux, after lacks_ or differs_. With this key a
 * user states that the drive lacks the object that has failed, or keeps its own value. Returns NULL
 * if there is no such key. */
const char *drive402_key(const drive402_feedback_t *feedback);

#endif
