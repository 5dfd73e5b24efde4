#ifndef FIRMWARE_DRIVE402_DRIVE402_SDO_H_
#define FIRMWARE_DRIVE402_DRIVE402_SDO_H_

/* SDO client for expedited transfers of 1, 2 or 4 bytes, one at a time (CiA 301). An answer about
 * another object, or without a request, is ignored. */

#include <stdint.h>

#include "firmware/canopen/can.h"

typedef struct {
  uint16_t index;
  uint8_t sub;
  uint8_t bytes; /* 1, 2 or 4 */
  uint32_t value;
} drive402_entry_t;

enum {
  DRIVE402_TRANSFER_IDLE,
  DRIVE402_TRANSFER_WAITING,
  DRIVE402_TRANSFER_DONE,
  DRIVE402_TRANSFER_TIMED_OUT,
  DRIVE402_TRANSFER_ABORTED,   /* `answer` is the abort code */
  DRIVE402_TRANSFER_UNEXPECTED /* the answer has another command or another size */
};

typedef struct {
  drive402_entry_t entry; /* object of the transfer */
  uint32_t answer;        /* value that was read, or abort code */
  uint32_t ticks;         /* until the transfer has timed out, at least 1 while it waits */
  uint8_t writes;         /* 1: download, 0: upload */
  uint8_t state;          /* DRIVE402_TRANSFER_ */
} drive402_sdo_t;

/* Starts a transfer: fills the 8 bytes of the request. */
void drive402_sdo_write(drive402_sdo_t *sdo, const drive402_entry_t *entry, uint8_t data[8]);
void drive402_sdo_read(drive402_sdo_t *sdo, const drive402_entry_t *entry, uint8_t data[8]);

/* Takes an answer of the server. */
void drive402_sdo_receive(drive402_sdo_t *sdo, const can_frame_t *frame);

/* Counts a tick of the wait for an answer. */
void drive402_sdo_tick(drive402_sdo_t *sdo);

#endif
