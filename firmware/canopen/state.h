#ifndef FIRMWARE_CANOPEN_STATE_H_
#define FIRMWARE_CANOPEN_STATE_H_

/* The state of a CANopen node, which all of its services use, and small sets of bits in it. node.h
 * is the interface. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/output.h"
#include "firmware/canopen/timers.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"
#include "firmware/objects/generated/axis_objects.h"

enum { EMCY_WAITING = 4, EMCY_HISTORY = 8 };

typedef struct {
  uint16_t code;
  uint8_t error_register;
  uint8_t info;
  uint32_t detail; /* the last four bytes of the message, the lowest byte first */
} emergency_t;

typedef struct {
  /* messages that wait for the inhibit time or for room in the queue, oldest first */
  emergency_t waiting[EMCY_WAITING];
  uint16_t drive_code;      /* error code of the drive that was last reported */
  uint8_t count;            /* number of messages in `waiting` */
  uint8_t overrun_reported; /* 1: 8110h was reported since all frames were last sent */
} emcy_t;

enum { PDO_ENTRIES = 8, PDO_BYTES = 8, PDO_BITS = 64 };

typedef struct {
  uint64_t value;   /* RPDO: value that is applied at the next SYNC */
  uint32_t sent[2]; /* TPDO: bytes of the last frame, least significant first */
  /* RPDO: number of the object of each entry (AXIS_OBJ_), none for a dummy; TPDO: offset in the
   * dictionary of each of its 8 bytes */
  uint16_t places[PDO_ENTRIES];
  /* TPDO: ticks at which its event time and inhibit time end, if they run */
  uint32_t event_tick;
  uint32_t inhibit_tick;
  uint8_t bits;     /* sum of the bits of all mapped objects; 0: the PDO does nothing */
  uint8_t pending;  /* RPDO: `value` waits for a SYNC; TPDO: must be sent even without a change */
  uint8_t syncs;    /* TPDO: number of SYNCs since it was last sent, or PDO_SYNC_AWAITED */
  uint8_t reported; /* RPDO: emergency messages since its last correct frame, PDO_REPORTED_ */
} pdo_t;

enum { PDO_REPORTED_SHORT = 1, PDO_REPORTED_LONG = 2, PDO_REPORTED_REFUSED = 4 };

/* States of an SDO transfer: none; by segments; by blocks, first those of an upload in their order,
 * then those of a download. */
enum {
  SDO_IDLE,
  SDO_DOWNLOAD,
  SDO_UPLOAD,
  SDO_BLOCK_OFFERED,  /* the server waits for the client to start the block upload */
  SDO_BLOCK_SENDING,  /* the server sends segments */
  SDO_BLOCK_SENT,     /* the server waits for the client to acknowledge the block */
  SDO_BLOCK_ENDED,    /* the server waits for the client to confirm the end of the upload */
  SDO_BLOCK_AWAITED,  /* the server waits for a segment of the client */
  SDO_BLOCK_RECEIVED, /* the server waits for the client to end the download */
};

/* An SDO transfer in progress. An expedited transfer needs no state. */
typedef struct {
  uint32_t size;        /* upload: size of all bytes; download: announced size */
  uint32_t offset;      /* number of bytes transferred */
  uint32_t block_begin; /* block upload: offset at which the present block begins */
  uint32_t crc_end;     /* block upload: number of bytes that `crc` includes */
  uint16_t index;
  uint16_t object; /* download: AXIS_OBJ_ */
  uint16_t crc;
  uint8_t sub;
  uint8_t what;       /* upload: AXIS_ADDRESS_TEXT, _DOMAIN, otherwise `data` */
  uint8_t state;      /* SDO_ */
  uint8_t toggle;     /* toggle bit of the next segment */
  uint8_t sized;      /* 1: download whose size was announced */
  uint8_t replaced;   /* 1: the recording was replaced after its upload began */
  uint8_t with_crc;   /* 1: block transfer for which the client requests a CRC */
  uint8_t block_size; /* block upload: number of segments in a block */
  uint8_t sequence;   /* block upload: number of the last segment that was sent */
  uint8_t data[8];    /* bytes of a download, or of a value that is uploaded */
} sdo_server_t;

/* LSS settings, see lss.h. All except `state` keep their values in a reset of communication. */
typedef struct {
  uint32_t delay_ticks; /* activate bit timing: ticks of each of the two silences */
  uint32_t ticks;       /* remaining ticks of the present silence */
  uint16_t rates;       /* set of supported bit rates, a bit for each index; 0: all */
  uint8_t rate;         /* index of the present bit rate */
  uint8_t next_rate;    /* index of the bit rate after the next activation */
  uint8_t node_id;      /* node id after the next reset of communication, or LSS_NO_NODE_ID */
  uint8_t fixed;        /* 1: the port has fixed the node id */
  uint8_t state;        /* state waiting or configuration */
  uint8_t selected;     /* matching parts of the address in switch state selective */
  uint8_t identified;   /* matching parts of the address in identify remote slave */
  uint8_t scanned;      /* part of the address that fast scan searches */
  /* 1 or 2: the first or the second silence of the present change of the bit rate; 0: no change */
  uint8_t silence;
  uint8_t store; /* LSS_STORE_ */
} lss_t;

/* The part of a tick that is deferred: nothing, the part after the PDOs, or all. */
enum { CANOPEN_DEFERRED_NOTHING = 0, CANOPEN_DEFERRED_OUTPUT = 1, CANOPEN_DEFERRED_ALL = 2 };

enum { CANOPEN_RESET_NONE = 0, CANOPEN_RESET_COMMUNICATION = 1, CANOPEN_RESET_NODE = 2 };

/* Requests of the node to the firmware, see canopen_take_requests(). */
typedef struct {
  uint16_t frames_lost;
  uint8_t sources_lost; /* set of FW_SOURCE_ that can no longer reach the axis over this bus */
  uint8_t fault;        /* reason for the first of these losses: AXIS_FAULT_ */
  uint8_t stop;         /* 1: this reason must stop the axis for every owner */
  uint8_t duplicate;    /* 1: another node has the same node id */
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
  /* Sets of bits; element i is bit i. */
  uint8_t heartbeats_lost;
  uint8_t rpdos_late;      /* RPDOs whose deadline expired while the axis was active */
  uint8_t rpdos_waiting;   /* RPDOs whose deadline starts when the axis becomes active */
  uint8_t tpdos_watched;   /* TPDOs that are sent when their values change */
  uint8_t tpdos_timed;     /* TPDOs of these that are sent at their event_tick at the latest */
  uint8_t tpdos_inhibited; /* TPDOs that are not sent before their inhibit_tick */
  uint8_t sdos_sending;    /* SDO servers that have segments of a block to send */
  uint8_t sync_reported;   /* 1: 8240h was reported since the last correct SYNC */
  uint8_t bus;             /* CAN_BUS_ */
  uint8_t reset;           /* CANOPEN_RESET_ that the firmware has not fetched yet */
  uint8_t deferred;        /* CANOPEN_DEFERRED_ */
  uint8_t late;            /* number of ticks that began before the deferred tick was computed */
  uint8_t node_id;         /* 1..127, LSS_NO_NODE_ID */
} canopen_t;

/* Whether a set contains element i; and the changes of one element. */
static inline bool canopen_has(uint8_t set, uint32_t i) { return (set & fx_bit(i)) != 0; }
static inline void canopen_put(uint8_t *set, uint32_t i) { *set = (uint8_t)(*set | fx_bit(i)); }
static inline void canopen_drop(uint8_t *set, uint32_t i) { *set = (uint8_t)(*set & ~fx_bit(i)); }

/* Reports to the firmware that a source (FW_SOURCE_) can no longer reach the axis. */
static inline void canopen_lose(canopen_t *canopen, uint8_t source, uint8_t fault) {
  if (canopen->requests.sources_lost == 0) {
    canopen->requests.fault = fault;
  }
  canopen_put(&canopen->requests.sources_lost, source);
}

/* Reports to the firmware that all sources on this bus can no longer reach the axis. */
static inline void canopen_lose_all(canopen_t *canopen, uint8_t fault) {
  canopen_lose(canopen, FW_SOURCE_CANOPEN, fault);
  canopen_lose(canopen, FW_SOURCE_MODBUS, fault);
  canopen_lose(canopen, FW_SOURCE_LCM, fault);
}

/* Returns the position of an object in an array of `count` objects that begins with `first`, or
 * -1. */
static inline int canopen_element(uint16_t object, uint16_t first, uint16_t count) {
  return (object >= first && object < first + count) ? object - first : -1;
}

#endif
