#ifndef FIRMWARE_DRIVE402_DRIVE402_WORD_H_
#define FIRMWARE_DRIVE402_DRIVE402_WORD_H_

/* State machine of a drive by statusword (6041h) and controlword (6040h), IEC 61800-7-201. */

#include <stdint.h>

/* Commands of the controlword. */
enum {
  DRIVE402_DISABLE_VOLTAGE = 0x00,
  DRIVE402_QUICK_STOP = 0x02,
  DRIVE402_SHUTDOWN = 0x06,
  DRIVE402_SWITCH_ON = 0x07,
  DRIVE402_ENABLE_OPERATION = 0x0F,
  DRIVE402_FAULT_RESET = 0x80
};

/* Bits of the statusword: the drive obeys the controlword (9), internal limit active (11), and in a
 * cyclic mode, the drive follows its target (12). */
enum { DRIVE402_REMOTE = 0x0200, DRIVE402_LIMIT_ACTIVE = 0x0800, DRIVE402_FOLLOWS = 0x1000 };

/* Returns the state (DRIVE402_STATES) that a statusword shows. */
uint8_t drive402_state_of(uint16_t statusword);

/* Returns the controlword that brings a drive by one transition nearer to operation enabled. In a
 * state that a drive leaves by itself, or by a fault reset only, it is "disable voltage". */
uint16_t drive402_step(uint8_t state);

#endif
