#ifndef FIRMWARE_DRIVE402_DRIVE402_NAMES_H_
#define FIRMWARE_DRIVE402_DRIVE402_NAMES_H_

/* Names of what the master of a drive reports: its phase, the state of the drive, and the reason of
 * a failure with its text. Each list is written once: X(name, text) for each entry. */

/* Phases of the master, in their order. */
#define DRIVE402_PHASES(X)                                         \
  X(RESETTING, "waits for the boot-up of the drive after a reset") \
  X(CONFIGURING, "writes and reads back the objects of the drive") \
  X(STARTING, "waits for the first TPDO and an operational drive") \
  X(RUNNING, "exchanges cyclic frames with the drive")

/* States of the drive by its statusword, IEC 61800-7-201 (CiA 402). */
#define DRIVE402_STATES(X)                    \
  X(NOT_READY, "not ready to switch on")      \
  X(SWITCH_ON_DISABLED, "switch on disabled") \
  X(READY, "ready to switch on")              \
  X(SWITCHED_ON, "switched on")               \
  X(OPERATION_ENABLED, "operation enabled")   \
  X(QUICK_STOP_ACTIVE, "quick stop active")   \
  X(FAULT_REACTION, "fault reaction active")  \
  X(FAULT, "fault")                           \
  X(UNKNOWN, "a statusword that the standard does not define")

/* Reasons of a failure. The first group refuses a configuration. After a reason of the second group
 * a reset resets the fault of the drive. After any other reason a reset starts again with a reset
 * of the node, because the configuration of the drive is no longer certain. */
#define DRIVE402_REASONS(X)                                                                      \
  X(NONE, "nothing has failed")                                                                  \
  X(REFUSED_NODE, "node_id and own_node_id: expected two different numbers from 1 to 127")       \
  X(REFUSED_MODE, "mode: expected 8 (csp), 9 (csv) or 10 (cst)")                                 \
  X(REFUSED_CYCLE, "cycle_ms: expected an even number from 2 to 100")                            \
  X(REFUSED_TYPE, "rpdo_type: expected 1 (synchronous), 254 or 255 (acts on reception)")         \
  X(REFUSED_SCALE,                                                                               \
    "scale: expected two numbers from 1 to 2147483647, also in fractions of a code (times 16)")  \
  X(REFUSED_TARGET, "target_max: expected 1 to 2147483642, in cst 1 to 32767")                   \
  X(REFUSED_TIMES,                                                                               \
    "times: expected heartbeat_ms from 1 and below heartbeat_timeout_ms, sdo_timeout_ms and "    \
    "wait_ms from 1")                                                                            \
  X(REFUSED_ENTRIES, "extra: expected entries of 1, 2 or 4 bytes")                               \
  X(DRIVE_FAULT, "the statusword of the drive reports a fault")                                  \
  X(DRIVE_EMERGENCY, "the drive has sent an emergency message")                                  \
  X(DRIVE_OFF, "the drive has left operation enabled without a command")                         \
  X(BOOT_TIMEOUT, "the drive has sent no boot-up message after the reset of its node")           \
  X(SDO_TIMEOUT, "the drive has not answered an SDO request in time")                            \
  X(SDO_ABORTED, "the drive has aborted an SDO transfer")                                        \
  X(SDO_UNEXPECTED, "the drive has answered an SDO request with another command or size")        \
  X(SDO_DIFFERS, "an object of the drive has another value than was written")                    \
  X(START_TIMEOUT, "the drive sends no TPDO, or is not operational, after the command to start") \
  X(TPDO_MISSING, "two TPDOs of the drive in succession are missing")                            \
  X(HEARTBEAT_LOST, "the heartbeat of the drive is missing")                                     \
  X(BOOTED, "the drive has started again without a command")                                     \
  X(NOT_OPERATIONAL, "the drive has left the NMT state operational without a command")           \
  X(MODE_LOST, "6061h of the enabled drive displays another mode")                               \
  X(BUS_OFF, "the CAN controller is bus off")                                                    \
  X(FRAMES_LOST, "received frames were lost before the master saw them")                         \
  X(FRAMES_KEPT, "frames of the last tick were not fetched for transmission")

#define DRIVE402_NAME_(name, text) DRIVE402_##name,
enum { DRIVE402_PHASES(DRIVE402_NAME_) DRIVE402_PHASE_COUNT };
enum { DRIVE402_STATES(DRIVE402_NAME_) DRIVE402_STATE_COUNT };
enum { DRIVE402_REASONS(DRIVE402_NAME_) DRIVE402_REASON_COUNT };
#undef DRIVE402_NAME_

enum {
  DRIVE402_REFUSED_LAST = DRIVE402_REFUSED_ENTRIES,
  DRIVE402_RESET_IN_PLACE_LAST = DRIVE402_DRIVE_OFF
};

#endif
