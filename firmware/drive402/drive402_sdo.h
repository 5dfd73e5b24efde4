#ifndef FIRMWARE_DRIVE402_DRIVE402_SDO_H_
#define FIRMWARE_DRIVE402_DRIVE402_SDO_H_

/* SDO client for objects of 1, 2 or 4 bytes, one transfer at a time (CiA 301). Downloads are
 * expedited. The answer to an upload may be expedited, with or without a size, or have one segment.
 * If the answer has more bytes than the object, the lowest bytes are used; if it has fewer bytes,
 * it is refused. A request without an answer is repeated once. The time between two requests is at
 * least DRIVE402_SDO_PAUSE ticks, because some drives lose frames that arrive within less than 3
 * ms. An answer that no request asked for, or that belongs to another object, is ignored. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"

typedef struct {
  uint16_t index;
  uint8_t sub;
  uint8_t bytes; /* size of the object in bytes: 1, 2 or 4 */
  uint32_t value;
} drive402_entry_t;

enum { DRIVE402_SDO_PAUSE = 5 };

enum {
  DRIVE402_TRANSFER_IDLE,
  DRIVE402_TRANSFER_ASKS, /* a request must be sent */
  DRIVE402_TRANSFER_WAITING,
  DRIVE402_TRANSFER_DONE,
  DRIVE402_TRANSFER_TIMED_OUT,
  DRIVE402_TRANSFER_ABORTED,   /* `answer` is the abort code */
  DRIVE402_TRANSFER_UNEXPECTED /* the SDO answer has an unexpected command or too few bytes */
};

typedef struct {
  drive402_entry_t entry; /* object of the present SDO transfer */
  uint32_t answer;        /* value that was uploaded by SDO, or the SDO abort code */
  /* number of ticks until the SDO answer counts as missing; at least 1 while it is awaited */
  uint32_t ticks;
  uint8_t writes;       /* 1: download, 0: upload */
  uint8_t state;        /* state of the SDO transfer, a DRIVE402_TRANSFER_ value */
  uint8_t pause;        /* number of ticks until the next SDO request may be sent */
  uint8_t is_repeated;  /* 1: the request was repeated */
  uint8_t is_segmented; /* 1: the upload waits for the segment that contains the value */
  uint8_t has_late_ack; /* 1: the last download was sent twice, so the drive may answer it
                         * twice */
  uint8_t doubled;      /* number of SDO downloads that were sent once and answered twice */
} drive402_sdo_t;

/* Initialises an SDO client: no transfer is in progress. */
void drive402_sdo_init(drive402_sdo_t *sdo);

/* Starts an SDO transfer for an entry of the configuration: the download of its value if `writes`
 * is true, otherwise the upload of its object. */
void drive402_sdo_start(drive402_sdo_t *sdo, const drive402_entry_t *entry, bool writes);

/* Counts a tick of the SDO client. Returns true if the client must send a request in this tick. */
bool drive402_sdo_tick(drive402_sdo_t *sdo);

/* Writes the 8 bytes of the request to `data`. After `ticks` ticks without an answer, the answer
 * counts as missing. */
void drive402_sdo_request(drive402_sdo_t *sdo, uint32_t ticks, uint8_t data[8]);

/* Processes an answer of the SDO server. */
void drive402_sdo_receive(drive402_sdo_t *sdo, const can_frame_t *frame);

#endif
