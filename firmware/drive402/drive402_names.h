#ifndef FIRMWARE_DRIVE402_DRIVE402_NAMES_H_
#define FIRMWARE_DRIVE402_DRIVE402_NAMES_H_

/* Names and texts for what the master of a drive reports: the phase of the master, the state of the
 * drive, and the reason of a failure. Each list exists only once, as a macro with X(name, text) for
 * each entry. */

/* Phases of the master in the order in which they follow each other. */
#define DRIVE402_PHASES(X)                                         \
  X(RESETTING, "waits for the boot-up of the drive after a reset") \
  X(CONFIGURING, "writes and reads back the objects of the drive") \
  X(STARTING, "waits for the first TPDO and an operational drive") \
  X(RUNNING, "exchanges cyclic frames with the drive")

/* States of the drive that its statusword shows, IEC 61800-7-201 (CiA 402). */
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

/* Objects that the master writes. A drive may not have some of them, or may keep its own value.
 * X(name, bit, key, what): <bit> is the bit of the object in `without` and `differs` of the
 * configuration. lacks_<key> and differs_<key> are the keys of the object in the settings of
 * axis_linux. <what> is the end of a sentence that begins with "the drive has no". */
#define DRIVE402_VALUES(X)                                                                       \
  X(SYNC_ID, 0x0001, "1005h", "object 1005h, the identifier of SYNC")                            \
  X(SYNC_PERIOD, 0x0002, "1006h", "object 1006h, the period of SYNC")                            \
  X(INTERPOLATION, 0x0004, "60C2h", "object 60C2h, the period of targets")                       \
  X(ABORT_OPTION, 0x0008, "6007h", "object 6007h, the abort option")                             \
  X(CONSUMER, 0x0010, "1016h", "object 1016h, by which it monitors the heartbeat of its master") \
  X(PRODUCER, 0x0020, "1017h", "object 1017h, the period of its heartbeat")                      \
  X(RPDO_TYPE, 0x0080, "1400h_2", "object 1400h:2, the transmission type of its RPDO")           \
  X(TPDO_TYPE, 0x0200, "1800h_2", "object 1800h:2, the transmission type of its TPDO")           \
  X(MODE, 0x0400, "6060h", "object 6060h, the mode of operation")

/* All objects and bits that a drive need not have. A drive cannot keep its own PDO mapping, because
 * the master would then read the statusword and the position from wrong bytes. */
#define DRIVE402_OBJECTS(X)                                                                 \
  DRIVE402_VALUES(X)                                                                        \
  X(RPDO_MAPPING, 0x0040, "1600h", "mapping in 1600h and 1400h:1 that could be changed")    \
  X(TPDO_MAPPING, 0x0100, "1A00h", "mapping in 1A00h and 1800h:1 that could be changed")    \
  X(TORQUE, 0x0800, "6077h", "object 6077h, the torque, for its TPDO")                      \
  X(REQUEST_BIT, 0x1000, "1800h_bit_30", "bit 30 in 1800h:1, no answer to remote requests") \
  X(REMOTE, 0x2000, "bit_9", "bit 9 in its statusword, remote")                             \
  X(FOLLOWS, 0x4000, "bit_12", "bit 12 in its statusword, drive follows the command value")

/* Reasons of a failure. With a reason of the first group a configuration is refused. After a reason
 * of the second group or of the last group, `reset` only resets the fault of the drive. The last
 * group begins with NOT_REMOTE. After any other reason `reset` begins with a reset of the node,
 * because the configuration of the drive may have changed. */
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
  X(REFUSED_ENTRIES, "extra: expected entries of 1, 2 or 4 bytes; differs: expected no mapping") \
  X(DRIVE_FAULT, "the statusword of the drive reports a fault; its error code says which")       \
  X(DRIVE_EMERGENCY, "the drive has sent an emergency message; its error code says why")         \
  X(DRIVE_OFF,                                                                                   \
    "the drive has left operation enabled without a command: check power, STO and enable "       \
    "inputs")                                                                                    \
  X(BOOT_TIMEOUT,                                                                                \
    "the drive has sent no boot-up message within wait_ms after the reset of its node: check "   \
    "supply, wiring, bit rate and node id")                                                      \
  X(SDO_TIMEOUT,                                                                                 \
    "the drive has not answered an SDO request within twice sdo_timeout_ms: check the "          \
    "wiring, or set a longer sdo_timeout_ms")                                                    \
  X(SDO_ABORTED, "the drive has aborted an SDO transfer")                                        \
  X(SDO_UNEXPECTED, "the drive has answered an SDO request with another command or fewer bytes") \
  X(SDO_DIFFERS, "an object of the drive has another value than was written")                    \
  X(START_TIMEOUT,                                                                               \
    "no heartbeat of the drive has said operational within wait_ms after the command to start: " \
    "check 1017h")                                                                               \
  X(TPDO_MISSING,                                                                                \
    "two TPDOs of the drive in succession are missing: check the wiring, or give the bus a "     \
    "longer cycle_ms")                                                                           \
  X(HEARTBEAT_LOST,                                                                              \
    "the heartbeat of the drive is missing: check the wiring, or set heartbeat_timeout_ms to "   \
    "three times the period of the drive")                                                       \
  X(BOOTED, "the drive has started again without a command: check its supply")                   \
  X(NOT_OPERATIONAL,                                                                             \
    "the drive has left the NMT state operational without a command: check that no other "       \
    "master commands it")                                                                        \
  X(MODE_LOST, "6061h displays another mode than was written: the drive has to have this mode")  \
  X(BUS_OFF, "the CAN controller is bus off: check wiring, termination and bit rate")            \
  X(FRAMES_LOST,                                                                                 \
    "received frames were lost before the master saw them: check the load of the bus and of "    \
    "the processor")                                                                             \
  X(FRAMES_KEPT, "frames of the last tick were not fetched for transmission")                    \
  X(NO_TPDO,                                                                                     \
    "the drive has sent no TPDO within wait_ms after the command to start: check that 1800h "    \
    "and 1A00h act at once, and the node id")                                                    \
  X(TPDO_LENGTH,                                                                                 \
    "the TPDO of the drive has another length than 6041h, 6064h and 6077h: check 1A00h, or set " \
    "lacks_6077h")                                                                               \
  X(DOUBLED, "two nodes answer as the drive: give each drive on the bus a node id of its own")   \
  X(NOT_REMOTE,                                                                                  \
    "bit 9 of the statusword is 0: end the local control of the drive, or set lacks_bit_9")      \
  X(NOT_ENABLED,                                                                                 \
    "the drive has not come to operation enabled within wait_ms: check power, STO and enable "   \
    "inputs")                                                                                    \
  X(TARGET_IGNORED,                                                                              \
    "bit 12 of the statusword is 0, so the enabled drive ignores its target: end its halt or "   \
    "limit, or set lacks_bit_12")

#define DRIVE402_NAME_(name, text) DRIVE402_##name,
enum { DRIVE402_PHASES(DRIVE402_NAME_) DRIVE402_PHASE_COUNT };
enum { DRIVE402_STATES(DRIVE402_NAME_) DRIVE402_STATE_COUNT };
enum { DRIVE402_REASONS(DRIVE402_NAME_) DRIVE402_REASON_COUNT };
#undef DRIVE402_NAME_

/* Bits of drive402_config_t.without, and the set of all bits that are permitted in `differs`. */
#define DRIVE402_WITHOUT_(name, bit, key, what) DRIVE402_WITHOUT_##name = (bit),
#define DRIVE402_DIFFERS_(name, bit, key, what) | (bit)
enum {
  DRIVE402_OBJECTS(DRIVE402_WITHOUT_) DRIVE402_DIFFERS_ALL = 0 DRIVE402_VALUES(DRIVE402_DIFFERS_)
};
#undef DRIVE402_WITHOUT_
#undef DRIVE402_DIFFERS_

enum {
  DRIVE402_REFUSED_LAST = DRIVE402_REFUSED_ENTRIES,
  DRIVE402_RESET_IN_PLACE_LAST = DRIVE402_DRIVE_OFF,
  DRIVE402_RESET_IN_PLACE_AGAIN = DRIVE402_NOT_REMOTE
};

#endif
