#ifndef FIRMWARE_DRIVE402_DRIVE402_WORD_H_
#define FIRMWARE_DRIVE402_DRIVE402_WORD_H_

/* The state machine of a drive, seen through its statusword (6041h) and its controlword (6040h),
 * IEC 61800-7-201. */

#include <stdint.h>

/* Values of the controlword (6040h), one for each command. */
enum {
  DRIVE402_DISABLE_VOLTAGE = 0x00,
  DRIVE402_QUICK_STOP = 0x02,
  DRIVE402_SHUTDOWN = 0x06,
  DRIVE402_SWITCH_ON = 0x07,
  DRIVE402_ENABLE_OPERATION = 0x0F,
  DRIVE402_FAULT_RESET = 0x80
};

/* Bits of the statusword. Bit 9: the drive obeys the controlword. Bit 11: an internal limit is
 * active. Bit 12: in a cyclic mode, the drive follows its target. */
enum { DRIVE402_REMOTE = 0x0200, DRIVE402_LIMIT_ACTIVE = 0x0800, DRIVE402_FOLLOWS = 0x1000 };

/* Returns the state (DRIVE402_STATES) that a statusword shows. */
uint8_t drive402_state_of(uint16_t statusword);

/* Returns the controlword that brings a drive by one transition nearer to operation enabled. If the
 * drive leaves the state by itself, or only by a reset of its fault, the controlword is `disable
 * voltage`. */
uint16_t drive402_step(uint8_t state);

#endif
