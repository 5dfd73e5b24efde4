#ifndef FIRMWARE_CANOPEN_NODE_H_
#define FIRMWARE_CANOPEN_NODE_H_

/* A CANopen node, CiA 301: NMT, heartbeat producer and consumers, SYNC consumer, SDO servers, PDOs,
 * EMCY. Passive: frames go in by canopen_receive() between ticks and count as of the coming tick;
 * they come out by canopen_transmit(). Times of the object table are rounded up to ticks.
 *
 * By state: pre-operational has all but PDOs, stopped has NMT and the heartbeat alone; emergencies
 * of a stopped node wait. Remote requests are ignored, so there is no node guarding. A frame goes
 * to the first that takes it: NMT, heartbeat consumers, SYNC, SDO, RPDOs. A node that is stopped,
 * or whose communication is reset, while the axis is active has lost its owner (CANopen, fault
 * source_lost): nobody could stop the axis otherwise. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/emcy.h"
#include "firmware/canopen/output.h"
#include "firmware/canopen/pdo.h"
#include "firmware/canopen/sdo.h"
#include "firmware/canopen/timers.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"

enum { CANOPEN_RESET_NONE = 0, CANOPEN_RESET_COMMUNICATION = 1, CANOPEN_RESET_NODE = 2 };

struct canopen {
  canopen_params_t params;
  canopen_signals_t signals;
  canopen_timers_t timers;
  can_output_t output;
  pdo_t rpdo[CANOPEN_PDOS];
  pdo_t tpdo[CANOPEN_PDOS];
  sdo_server_t sdo[CANOPEN_SDOS];
  emcy_t emcy;
  /* Sets, one bit each from bit 0 up. */
  uint8_t heartbeats_lost;
  uint8_t rpdos_late;      /* did not come in time while the axis was active */
  uint8_t rpdos_waiting;   /* their deadline starts when the axis becomes active */
  uint8_t tpdos_watched;   /* are sent when they change */
  uint8_t tpdos_timed;     /* of those: are sent at their event_tick at the latest */
  uint8_t tpdos_inhibited; /* are not sent before their inhibit_tick */
  uint8_t sync_told;       /* 8240h was given since a SYNC was all right */
  uint8_t bus;             /* CAN_BUS_ */
  uint8_t reset;           /* CANOPEN_RESET_, until it is taken */
  uint8_t left;            /* not 0: canopen_tick_end() has something to do */
  uint8_t late;            /* ticks that began before it was done */
  uint8_t node_id;
};

/* Parameters at their defaults, with the node id added where it belongs; silent until
 * canopen_start(). node_id 1..31. */
void canopen_init(canopen_t *canopen, uint8_t node_id);

/* Boot-up: after power-up and after every reset, once the stored parameters are loaded. */
void canopen_start(canopen_t *canopen);

void canopen_receive(canopen_t *canopen, fw_t *fw, const can_frame_t *frame);

/* Once a tick, after the axis: timers, PDOs, emergencies. What is due in most ticks, one
 * event-driven TPDO, is done by the first one; a tick with more to do, or one that is asked to
 * `leave` it, is left whole to the second one. Frames are the same, in the same order. Ticks that
 * begin before what was left is done are made up for with it, up to 255 of them. */
void canopen_tick_begin(canopen_t *canopen, fw_t *fw, bool leave);
void canopen_tick_end(canopen_t *canopen, fw_t *fw);

/* So many ticks did not come, because the processor was at a standstill; not between the two calls
 * above. What was to be sent meanwhile is due in the coming tick, once. Deadlines of what is
 * received are put off by as much: nothing could be heard. */
void canopen_missed(canopen_t *canopen, uint32_t ticks);

/* The next frame to be sent; false: none. */
bool canopen_transmit(canopen_t *canopen, can_frame_t *frame);

/* A reset that NMT asked for since the last call, CANOPEN_RESET_; the caller carries it out. */
uint8_t canopen_take_reset(canopen_t *canopen);

/* Frames were lost on the way in: counted in can_lost, and an emergency. */
void canopen_lost(canopen_t *canopen, fw_t *fw, uint16_t frames);

/* State of the bus as the controller tells it, CAN_BUS_; each change is an emergency, bus off takes
 * the owner away. */
void canopen_bus(canopen_t *canopen, fw_t *fw, uint8_t state);

/* An emergency that is no fault of the axis: CiA code, and what is put in its manufacturer bytes.
 */
void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info);
void canopen_emergency_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail);

/* Whether a value within its range may be written now to an object of the node: FW_OK,
 * FW_ERROR_RANGE, FW_ERROR_STATE, FW_ERROR_MAPPING, or FW_ERROR_NO_OBJECT for an entry of a mapping
 * that names none. */
int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value);

/* An object of the node was `previous` and now is `value`. Writing what it was changes nothing. */
void canopen_written(canopen_t *canopen, uint16_t object, int32_t previous, int32_t value);

/* The node owns the axis from now on: deadlines of RPDOs that are not running begin anew. */
void canopen_owns(canopen_t *canopen);

/* Why nobody can be reached over the node: the fault (AXIS_FAULT_) of a bus that is off, a lost
 * heartbeat, a stopped node; AXIS_FAULT_NONE. */
uint8_t canopen_lost_for(const canopen_t *canopen);

/* Whether the end of a master would be noticed: a heartbeat is watched, or an RPDO has a deadline.
 */
bool canopen_is_watched(const canopen_t *canopen);

/* The recorder was stopped or armed: what is being uploaded is gone. */
void canopen_recording_replaced(canopen_t *canopen);

/* --- for the parts of the node ------------------------------------------------------------------
 */

/* Bit 31 of a COB-ID says that it is not valid. */
static inline bool canopen_cob_valid(uint32_t cob_id) { return cob_id <= UINT32_C(0x7FFFFFFF); }

/* The identifier in a COB-ID. */
static inline uint16_t canopen_can_id(uint32_t cob_id) { return (uint16_t)(cob_id & 0x7FFu); }

/* One element of a set. */
static inline bool canopen_has(uint8_t set, uint32_t i) { return (set & fx_bit(i)) != 0; }
static inline void canopen_put(uint8_t *set, uint32_t i) { *set = (uint8_t)(*set | fx_bit(i)); }
static inline void canopen_drop(uint8_t *set, uint32_t i) { *set = (uint8_t)(*set & ~fx_bit(i)); }

/* Position of an object in an array of `count` that begins with `first`, or -1. */
static inline int canopen_element(uint16_t object, uint16_t first, uint16_t count) {
  return (object >= first && object < first + count) ? object - first : -1;
}

/* Whether a COB-ID may become another one: FW_OK, FW_ERROR_RANGE (29 bits; restricted and valid) or
 * FW_ERROR_STATE (another identifier while valid). */
int canopen_check_cob_id(uint32_t present, uint32_t wanted);

#endif
