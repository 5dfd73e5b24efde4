#ifndef FIRMWARE_DRIVE402_DRIVE402_H_
#define FIRMWARE_DRIVE402_DRIVE402_H_

/* The CANopen master of one drive with the CiA 402 profile, in cyclic synchronous velocity, torque
 * or position mode. Its functions only receive and return frames: they access no CAN device and no
 * clock. A port (firmware/port) uses the master so that an axis commands a drive of the user:
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
 * Start. The master resets the node of the drive and waits for the boot-up message of the node.
 * Then it writes a list of objects and reads back each object: no SYNC counter, heartbeats in both
 * directions, abort connection option, first RPDO {6040h, target} and first TPDO {6041h, 6064h,
 * 6077h} on every SYNC, period, mode. If the drive refuses a write, the object is still right if it
 * already has the value. `without` leaves objects out, and `differs` lets the drive keep other
 * values. Then the master starts the node. The phase RUNNING begins when the drive is operational
 * and has sent a TPDO. The master neither needs nor changes other PDOs, and uses the predefined
 * connection set of CiA 301.
 *
 * Bus cycle. In each bus cycle the master sends SYNC and RPDO. A bus cycle lasts a multiple of 2
 * ms, which is 3 ticks. If no TPDO is received in a cycle, the last values are kept and their age
 * grows. If this happens in two consecutive cycles, the fault is TPDO_MISSING. If two TPDOs are
 * received in a cycle, the newest one is used. If this happens in two consecutive cycles, the fault
 * is DOUBLED; two answers to each of two downloads are the same fault. The first TPDO after a
 * missing one may be the missing TPDO itself, so its age is counted from the earlier SYNC. A drive
 * that answers each SYNC only after the next SYNC is not detected: choose a longer cycle for such a
 * drive.
 *
 * States of the drive. While `enable` is 1 and nothing has failed, the master brings the drive to
 * the state operation enabled, by one transition in each cycle. The feedback reports `on`, and
 * targets act, when the drive is enabled, bits 9 (remote) and 12 (follows its target) of the
 * statusword are 1, and 6061h displays the mode. The master reads 6061h by SDO every 10 ms.
 * Otherwise the master sends the target 0, or in csp mode the position of the drive. If the drive
 * is not on after wait_ms, this is a failure, and its reason is the missing condition.
 *
 * Stop. If `enable` becomes 0 or something fails, the master sends an RPDO with quick stop and
 * target 0 in the same tick, also between two cycles. When the statusword shows switch on disabled
 * or fault, and at the latest after quick_stop_ms, the master commands disable voltage. The master
 * accepts a stop in every state, and continues the bus cycle after a failure. The drive is enabled
 * again only from the state switch on disabled.
 *
 * Emergency messages. The feedback keeps the last error code. If the error register (1001h) in an
 * emergency message is not 0, the message is a failure; if the register is 0, the message is a
 * warning. A message with error code 0 is neither: it reports the end of an error.
 *
 * Failures. The reason of the first failure since the last reset stays in the feedback; for a
 * failed SDO transfer, also its object and abort code. Nothing is retried without `reset`, with one
 * exception: an SDO request without an answer is repeated once. A fault of the drive (DRIVE_FAULT,
 * DRIVE_EMERGENCY, DRIVE_OFF) is reset without a restart of the node: bit 7 of 6040h is 1 until the
 * fault has ended, at most for wait_ms. After this time the fault is reported again. After
 * NOT_REMOTE, NOT_ENABLED and TARGET_IGNORED the drive has no fault that must be reset. After every
 * other failure `reset` begins with the reset of the node, as soon as a stop has ended. If the
 * heartbeat of the master is missing, the drive itself must stop, by its objects 1016h and 6007h.
 *
 * Cost of a tick: at most DRIVE402_FRAMES frames, no loop of more than eight steps (the state
 * codings), no division. */

#include "firmware/drive402/drive402_state.h"

/* Starts a master. All bytes of *master must be 0, and *config must exist as long as *master.
 * Returns DRIVE402_NONE, or the reason why the configuration is refused. If it is refused, the
 * master sends nothing and always reports a fault. */
uint8_t drive402_init(drive402_t *master, const drive402_config_t *config);

/* Processes a received frame. Frames of other nodes and remote requests are ignored. */
void drive402_receive(drive402_t *master, const can_frame_t *frame);

/* Reports to the master the state of the CAN bus (CAN_BUS_), and the number of received frames that
 * were lost since the last call. Bus off and lost frames are failures. */
void drive402_bus(drive402_t *master, uint8_t state, uint16_t frames_lost);

/* Returns the state and the measured values of the drive, as known from all frames received so
 * far. */
drive402_feedback_t drive402_feedback(const drive402_t *master);

/* Call this function once in each tick of 1/1500 s. If the caller has not fetched all frames of the
 * last tick, these frames are discarded, and this is a failure. */
void drive402_tick(drive402_t *master, const drive402_command_t *command);

/* Fetches the next frame to send. Returns false if there is no more frame. */
bool drive402_transmit(drive402_t *master, can_frame_t *frame);

/* The following functions return a text for users that describes a phase of the master, a state of
 * the drive, or the reason of a failure. The text is a sentence without a full stop. */
const char *drive402_phase_text(uint8_t phase);
const char *drive402_state_text(uint8_t state);
const char *drive402_reason_text(uint8_t reason);

/* The settings of axis_linux have the keys lacks_<key> and differs_<key>. With the first key a user
 * states that the drive does not have an object, with the second key that the drive keeps its own
 * value of this object. Returns the <key> of the object whose transfer has failed, or NULL if there
 * is no such key. */
const char *drive402_key(const drive402_feedback_t *feedback);

#endif
