#ifndef FIRMWARE_CANOPEN_STATE_H_
#define FIRMWARE_CANOPEN_STATE_H_

/* The state of a CANopen node, below all of its services, and the small sets in it. node.h is the
 * interface. */

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
  uint32_t detail; /* the last four bytes, the lowest first */
} emergency_t;

typedef struct {
  emergency_t waiting[EMCY_WAITING]; /* for the inhibit time or for a place, oldest first */
  uint16_t drive_code;               /* error code of the drive, as last reported */
  uint8_t count;                     /* of waiting */
  uint8_t overrun_reported;          /* 8110h, since all frames were last sent */
} emcy_t;

enum { PDO_ENTRIES = 8, PDO_BYTES = 8, PDO_BITS = 64 };

typedef struct {
  uint64_t value;               /* RPDO: taken over at the next SYNC */
  uint32_t sent[2];             /* TPDO: its bytes as last sent, least significant first */
  uint16_t places[PDO_ENTRIES]; /* RPDO: AXIS_OBJ_ of each entry, none: a dummy; TPDO: the
                                   dictionary_place() of each of its 8 bytes */
  uint32_t event_tick;          /* TPDO: when its event and inhibit times end, if they run */
  uint32_t inhibit_tick;
  uint8_t bits;     /* of all mapped objects, 0: does nothing */
  uint8_t pending;  /* RPDO: `value` waits; TPDO: is to be sent whether it changed or not */
  uint8_t syncs;    /* TPDO: since it was last sent, or PDO_SYNC_AWAITED */
  uint8_t reported; /* RPDO: the emergencies since one was all right, PDO_REPORTED_ */
} pdo_t;

enum { PDO_REPORTED_SHORT = 1, PDO_REPORTED_LONG = 2, PDO_REPORTED_REFUSED = 4 };

/* Of one transfer: none; by segments; by blocks, those of an upload in their order, then those of a
 * download. */
enum {
  SDO_IDLE,
  SDO_DOWNLOAD,
  SDO_UPLOAD,
  SDO_BLOCK_OFFERED,  /* the client is to start it */
  SDO_BLOCK_SENDING,  /* segments go out */
  SDO_BLOCK_SENT,     /* the client is to acknowledge the block */
  SDO_BLOCK_ENDED,    /* the client is to confirm the end */
  SDO_BLOCK_AWAITED,  /* the client is to send the segment */
  SDO_BLOCK_RECEIVED, /* the client is to end it */
};

/* A transfer under way; an expedited one has no state. */
typedef struct {
  uint32_t size;        /* upload: of all; download: as announced */
  uint32_t offset;      /* bytes transferred */
  uint32_t block_begin; /* block upload: the offset at which the present block begins */
  uint32_t crc_end;     /* block upload: how many bytes `crc` is of */
  uint16_t index;
  uint16_t object; /* download: AXIS_OBJ_ */
  uint16_t crc;
  uint8_t sub;
  uint8_t what;       /* upload: AXIS_ADDRESS_TEXT, _DOMAIN, else `data` */
  uint8_t state;      /* SDO_ */
  uint8_t toggle;     /* of the next segment */
  uint8_t sized;      /* download: the size was announced */
  uint8_t replaced;   /* upload: the recording is no longer the one that was begun */
  uint8_t with_crc;   /* blocks: the client wants a CRC */
  uint8_t block_size; /* block upload: segments of a block */
  uint8_t sequence;   /* block upload: number of the segment that was sent last */
  uint8_t data[8];    /* download, and values that are uploaded */
} sdo_server_t;

/* Layer settings; lss.h. But for the state they outlast a reset of communication. */
typedef struct {
  uint32_t delay_ticks; /* activate bit timing: each of the two silences */
  uint32_t ticks;       /* remaining of the present one */
  uint16_t rates;       /* set of supported bit rates, by their place; 0: all */
  uint8_t rate;         /* place in the table of bit rates: of the present one */
  uint8_t next_rate;    /* after the next activation */
  uint8_t node_id;      /* after the next reset of communication; LSS_NO_NODE_ID */
  uint8_t fixed;        /* 1: the port has fixed the node id */
  uint8_t state;        /* waiting or configuration */
  uint8_t selected;     /* parts of the address that matched: switch state selective */
  uint8_t identified;   /* the same: identify remote slave */
  uint8_t scanned;      /* part of the address that fast scan is at */
  uint8_t silence;      /* which of the two */
  uint8_t store;        /* LSS_STORE_ */
} lss_t;

/* The part of a tick that is still to be done: all, or what follows the PDOs. */
enum { CANOPEN_DEFERRED_NOTHING = 0, CANOPEN_DEFERRED_OUTPUT = 1, CANOPEN_DEFERRED_ALL = 2 };

enum { CANOPEN_RESET_NONE = 0, CANOPEN_RESET_COMMUNICATION = 1, CANOPEN_RESET_NODE = 2 };

/* The node's requests to the firmware; canopen_take_requests(). */
typedef struct {
  uint16_t frames_lost;
  uint8_t sources_lost; /* set of FW_SOURCE_ that can no longer reach the axis over this bus */
  uint8_t fault;        /* the reason, that of the first of them: AXIS_FAULT_ */
  uint8_t stop;         /* 1: the axis is to be stopped for that reason, whoever owns it */
  uint8_t duplicate;    /* 1: another node has this one's id */
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
  /* Sets, one bit each from bit 0 up. */
  uint8_t heartbeats_lost;
  uint8_t rpdos_late;      /* did not come in time while the axis was active */
  uint8_t rpdos_waiting;   /* their deadline starts when the axis becomes active */
  uint8_t tpdos_watched;   /* are sent when they change */
  uint8_t tpdos_timed;     /* of those: are sent at their event_tick at the latest */
  uint8_t tpdos_inhibited; /* are not sent before their inhibit_tick */
  uint8_t sdos_sending;    /* servers that have segments of a block to send */
  uint8_t sync_reported;   /* 8240h, since a SYNC was all right */
  uint8_t bus;             /* CAN_BUS_ */
  uint8_t reset;           /* CANOPEN_RESET_, until it is taken */
  uint8_t deferred;        /* CANOPEN_DEFERRED_ */
  uint8_t late;            /* ticks that began before it was done */
  uint8_t node_id;         /* 1..127, LSS_NO_NODE_ID */
} canopen_t;

/* One element of a set. */
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

/* Whoever reaches the axis over this bus can no longer do so. */
static inline void canopen_lose_all(canopen_t *canopen, uint8_t fault) {
  canopen_lose(canopen, FW_SOURCE_CANOPEN, fault);
  canopen_lose(canopen, FW_SOURCE_MODBUS, fault);
  canopen_lose(canopen, FW_SOURCE_LCM, fault);
}

/* Position of an object in an array of `count` that begins with `first`, or -1. */
static inline int canopen_element(uint16_t object, uint16_t first, uint16_t count) {
  return (object >= first && object < first + count) ? object - first : -1;
}

#endif
