#ifndef FIRMWARE_CANOPEN_STATE_H_
#define FIRMWARE_CANOPEN_STATE_H_

/* The state of a CANopen node, and functions for the sets of bits in this state. All services of
 * the node use this state. node.h is the interface of the node. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/output.h"
#include "firmware/canopen/timers.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"
#include "firmware/objects/generated/axis_objects_canopen.h"

enum { EMCY_WAITING = 4, EMCY_HISTORY = 8 };

typedef struct {
  uint16_t code;
  uint8_t error_register;
  uint8_t info;
  uint32_t detail; /* last four bytes of the emergency message, lowest byte first */
} emergency_t;

typedef struct {
  /* emergency messages that wait for the end of the inhibit time or for room in the output queue,
   * oldest first */
  emergency_t waiting[EMCY_WAITING];
  uint16_t drive_code; /* error code of the drive that was reported last */
  uint8_t count;       /* number of waiting emergency messages */
  /* 1: error code 8110h has reported lost frames, and since then the output queue was never
   * empty */
  uint8_t overrun_reported;
} emcy_t;

enum { PDO_ENTRIES = 8, PDO_BYTES = 8, PDO_BITS = 64 };

typedef struct {
  uint64_t value;   /* RPDO: received value that is applied at the next SYNC */
  uint32_t sent[2]; /* TPDO: bytes of the last frame that was sent, least significant byte first */
  /* RPDO: number (AXIS_OBJ_) of the object of each mapping entry, or AXIS_OBJ_NONE for a dummy
   * entry. TPDO: for each of the 8 bytes of the frame, the offset of the byte in the dictionary. */
  uint16_t places[PDO_ENTRIES];
  /* TPDO: tick in which the event time ends, and tick in which the inhibit time ends, while these
   * times run */
  uint32_t event_tick;
  uint32_t inhibit_tick;
  uint8_t bits; /* total number of bits of all mapped objects; 0: the PDO is not used */
  /* RPDO: 1 while `value` waits for a SYNC. TPDO: 1 if the TPDO must be sent although its values
   * have not changed. */
  uint8_t pending;
  /* TPDO: number of SYNC messages since the TPDO was last sent; PDO_SYNC_AWAITED while it waits for
   * its start value */
  uint8_t syncs;
  /* RPDO: set of PDO_REPORTED_ bits for the emergency messages that were sent since the last
   * correct frame */
  uint8_t reported;
} pdo_t;

enum { PDO_REPORTED_SHORT = 1, PDO_REPORTED_LONG = 2, PDO_REPORTED_REFUSED = 4 };

/* States of an SDO server: no transfer, a segmented download or upload, then the states of a block
 * upload and of a block download. The states of a block transfer follow each other in this
 * order. */
enum {
  SDO_IDLE,
  SDO_DOWNLOAD,
  SDO_UPLOAD,
  SDO_BLOCK_OFFERED,  /* the SDO server waits for the client to start the block upload */
  SDO_BLOCK_SENDING,  /* the SDO server sends the segments of a block */
  SDO_BLOCK_SENT,     /* the SDO server waits for the client to acknowledge the block */
  SDO_BLOCK_ENDED,    /* the SDO server waits for the client to confirm the end of the upload */
  SDO_BLOCK_AWAITED,  /* the SDO server waits for a segment from the client */
  SDO_BLOCK_RECEIVED, /* the SDO server waits for the client to end the block download */
};

/* State of an SDO transfer in progress. An expedited transfer needs no such state. */
typedef struct {
  uint32_t size; /* SDO upload: size of all data in bytes; SDO download: announced size in bytes */
  uint32_t offset;      /* number of bytes that have been transferred so far */
  uint32_t block_begin; /* block upload: offset in bytes at which the present block begins */
  uint32_t crc_end;     /* block upload: number of uploaded bytes that `crc` includes */
  uint32_t limit;       /* SDO download: largest permitted number of bytes */
  uint16_t index;
  uint16_t object; /* download: number (AXIS_OBJ_) of the object */
  uint16_t crc;
  uint8_t sub;
  /* kind of the transferred data. Upload: AXIS_ADDRESS_TEXT or AXIS_ADDRESS_DOMAIN; any other kind
   * means a value in `data`. Download: AXIS_ADDRESS_DOWNLOAD, or AXIS_ADDRESS_OBJECT for a value in
   * `data` */
  uint8_t what;
  uint8_t state;      /* state of the server, SDO_ */
  uint8_t toggle;     /* toggle bit of the next SDO segment */
  uint8_t sized;      /* 1: the client has announced the size of the download */
  uint8_t replaced;   /* 1: a domain is being uploaded, and its bytes are lost */
  uint8_t with_crc;   /* 1: the client requests a CRC for the block transfer */
  uint8_t block_size; /* block transfer: number of segments in a block */
  /* block upload: number of the last segment that was sent; block download: number of the last
   * segment before the first missing one */
  uint8_t sequence;
  /* block download: 1 if `data` holds the last received segment; its number of valid bytes is not
   * known yet */
  uint8_t held;
  uint8_t data[8]; /* bytes of a downloaded or uploaded value, or of a held segment */
} sdo_server_t;

/* LSS settings, see lss.h. A reset of communication changes only the fields `state`, `selected`,
 * `identified` and `scanned`. */
typedef struct {
  /* switch delay of CiA 305 in ticks. The node neither sends nor receives for this time before a
   * change of the bit rate, and again for this time after it */
  uint32_t delay_ticks;
  uint32_t ticks; /* number of remaining ticks of the present switch delay */
  /* set of the bit rates that the board supports, one bit for each index; 0: all bit rates */
  uint16_t rates;
  uint8_t rate; /* index of the present bit rate */
  /* index of the bit rate that becomes active by the next command `activate bit timing` */
  uint8_t next_rate;
  uint8_t node_id; /* node id after the next reset of communication, or LSS_NO_NODE_ID */
  uint8_t fixed;   /* 1: the board fixes the node id, so that LSS cannot change it */
  uint8_t state;   /* state of the LSS slave (CiA 305): waiting or configuration */
  /* number of parts of the LSS address that have matched in the command `switch state selective` */
  uint8_t selected;
  /* number of parts of the LSS address that have matched in the command `identify remote slave` */
  uint8_t identified;
  uint8_t scanned; /* number of the part of the LSS address that fast scan searches */
  /* phase of a change of the bit rate. 0: no change in progress; 1: switch delay before the new
   * rate; 2: switch delay after the new rate */
  uint8_t silence;
  uint8_t store; /* state of the command `store configuration`, LSS_STORE_ */
} lss_t;

/* Work of a tick that the node defers to fw_between(): no work, the work that follows the PDOs, or
 * the complete tick. */
enum { CANOPEN_DEFERRED_NOTHING = 0, CANOPEN_DEFERRED_OUTPUT = 1, CANOPEN_DEFERRED_ALL = 2 };

enum { CANOPEN_RESET_NONE = 0, CANOPEN_RESET_COMMUNICATION = 1, CANOPEN_RESET_NODE = 2 };

/* Requests of the node to the firmware, which canopen_take_requests() returns. */
typedef struct {
  uint16_t frames_lost;
  /* set of the command sources (FW_SOURCE_) that can no longer reach the axis over the CAN bus */
  uint8_t sources_lost;
  uint8_t fault; /* reason (AXIS_FAULT_) for the loss of the first command source in sources_lost */
  /* 1: the axis must stop for the reason in `fault`, whichever bus owns the axis */
  uint8_t stop;
  uint8_t duplicate; /* 1: another node has the same node id */
} canopen_requests_t;

typedef struct canopen {
  canopen_params_t params;
  canopen_signals_t signals;
  canopen_timers_t timers;
  can_output_t output;
  pdo_t rpdo[CANOPEN_PDOS];
  pdo_t tpdo[CANOPEN_PDOS];
  sdo_server_t sdo[CANOPEN_SDOS];
  emcy_t emcy;
  lss_t lss;
  canopen_requests_t requests;
  /* heartbeats_lost: set of the heartbeat consumers whose heartbeat is missing. Bit i of a set of
   * services is 1 if the service with the number i belongs to the set. */
  uint8_t heartbeats_lost;
  uint8_t rpdos_late;      /* set of the RPDOs whose deadline expired while the axis was active */
  uint8_t rpdos_waiting;   /* set of the RPDOs whose deadline starts when the axis becomes active */
  uint8_t tpdos_watched;   /* set of the TPDOs that are sent when their values change */
  uint8_t tpdos_timed;     /* set of the TPDOs that are sent at their event_tick at the latest */
  uint8_t tpdos_inhibited; /* set of the TPDOs that are not sent before their inhibit_tick */
  uint8_t sdos_sending;    /* set of the SDO servers that still have to send segments of a block */
  uint8_t sync_reported;   /* 1: error code 8240h was reported since the last correct SYNC */
  uint8_t bus;             /* state of the CAN bus, CAN_BUS_ */
  uint8_t reset;           /* reset (CANOPEN_RESET_) that the firmware has not yet fetched */
  uint8_t deferred;        /* deferred work of the present tick, CANOPEN_DEFERRED_ */
  uint8_t late;            /* number of ticks that have begun since a tick was deferred */
  uint8_t node_id;         /* node id, 1..127; LSS_NO_NODE_ID: the node has no node id */
} canopen_t;

/* canopen_has() returns true if a set of services contains element i. canopen_put() adds element i
 * to a set, and canopen_drop() removes element i. */
static inline bool canopen_has(uint8_t set, uint32_t i) { return (set & fx_bit(i)) != 0; }
static inline void canopen_put(uint8_t *set, uint32_t i) { *set = (uint8_t)(*set | fx_bit(i)); }
static inline void canopen_drop(uint8_t *set, uint32_t i) { *set = (uint8_t)(*set & ~fx_bit(i)); }

/* Requests that the firmware treats a command source (FW_SOURCE_) as lost, because the source can
 * no longer reach the axis. */
static inline void canopen_lose(canopen_t *canopen, uint8_t source, uint8_t fault) {
  if (canopen->requests.sources_lost == 0) {
    canopen->requests.fault = fault;
  }
  canopen_put(&canopen->requests.sources_lost, source);
}

/* Requests that the firmware treats all command sources on the CAN bus as lost, because they can no
 * longer reach the axis. */
static inline void canopen_lose_all(canopen_t *canopen, uint8_t fault) {
  canopen_lose(canopen, FW_SOURCE_CANOPEN, fault);
  canopen_lose(canopen, FW_SOURCE_MODBUS, fault);
  canopen_lose(canopen, FW_SOURCE_LCM, fault);
}

/* The objects from `first` to `first` + `count` - 1 are an array. Returns the index of `object` in
 * this array, or -1 if the object is not in the array. */
static inline int canopen_element(uint16_t object, uint16_t first, uint16_t count) {
  return (object >= first && object < first + count) ? object - first : -1;
}

#endif
