#include "firmware/canopen/pdo.h"

#include <stddef.h>

#include "firmware/canopen/cob_id.h"
#include "firmware/canopen/emcy.h"
#include "firmware/canopen/mapping.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"
#include "firmware/objects/value.h"

static bool rpdo_valid(const canopen_t *canopen, uint8_t i) {
  return canopen_cob_valid(canopen->params.rpdo_cob_id[i]);
}

static bool tpdo_valid(const canopen_t *canopen, uint8_t i) {
  return canopen_cob_valid(canopen->params.tpdo_cob_id[i]) && canopen->tpdo[i].bits != 0;
}

static bool is_event_driven(const canopen_t *canopen, uint8_t i) {
  return canopen->params.tpdo_transmission[i] >= PDO_EVENT_MANUFACTURER;
}

/* Updates the set of TPDOs whose values must be compared in every tick. A tick needs no
 * instructions for TPDOs that are not in this set. */
static void update_watched(canopen_t *canopen) {
  canopen->tpdos_watched = 0;
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    if (canopen->signals.nmt_state == AXIS_NMT_STATE_OPERATIONAL && tpdo_valid(canopen, i) &&
        is_event_driven(canopen, i)) {
      canopen_put(&canopen->tpdos_watched, i);
    }
  }
}

static void start_event_timer(canopen_t *canopen, uint8_t i) {
  const uint32_t ticks = fx_ticks_from_ms(canopen->params.tpdo_event_time[i]);
  canopen_drop(&canopen->tpdos_timed, i);
  if (ticks != 0 && canopen->signals.nmt_state == AXIS_NMT_STATE_OPERATIONAL &&
      tpdo_valid(canopen, i) && is_event_driven(canopen, i)) {
    canopen_put(&canopen->tpdos_timed, i);
    canopen->tpdo[i].event_tick = canopen->timers.now + ticks;
  }
}

/* Returns the initial SYNC count of a TPDO: PDO_SYNC_AWAITED if the TPDO has a SYNC start value,
 * otherwise 0. */
static uint8_t first_syncs(const canopen_t *canopen, uint8_t i) {
  return (canopen->params.tpdo_sync_start[i] != 0) ? PDO_SYNC_AWAITED : 0;
}

static void start_tpdo(canopen_t *canopen, const dictionary_t *objects, uint8_t i) {
  pdo_t *pdo = &canopen->tpdo[i];
  const uint8_t count = canopen->params.tpdo_mapped[i];
  uint16_t mapped[PDO_ENTRIES];
  const int bits =
      mapping_objects(&canopen->params.tpdo_mapping[i * PDO_ENTRIES], count, true, mapped);
  pdo->bits = (uint8_t)((bits < 0) ? 0 : bits);
  if (bits >= 0) {
    mapping_places(objects, mapped, count, pdo->places);
  }
  pdo->pending = 1;
  pdo->syncs = first_syncs(canopen, i);
  canopen_drop(&canopen->tpdos_inhibited, i);
  start_event_timer(canopen, i);
  update_watched(canopen);
}

static void rpdo_in_time(canopen_t *canopen, uint8_t i) {
  if (canopen_has(canopen->rpdos_late, i)) {
    canopen_drop(&canopen->rpdos_late, i);
    emcy_raise(canopen, AXIS_ERROR_CODE_NONE, 0);
  }
}

/* Applies the parameters of an RPDO. The deadline of the RPDO starts when a frame is received, or
 * when the axis becomes active. */
static void start_rpdo(canopen_t *canopen, uint8_t i) {
  pdo_t *pdo = &canopen->rpdo[i];
  const int bits = mapping_objects(&canopen->params.rpdo_mapping[i * PDO_ENTRIES],
                                   canopen->params.rpdo_mapped[i], false, pdo->places);
  pdo->bits = (uint8_t)((bits < 0) ? 0 : bits);
  pdo->pending = 0;
  pdo->reported = 0;
  rpdo_in_time(canopen, i);
  canopen_timer_stop(&canopen->timers, CANOPEN_TIMER_RPDO + (uint32_t)i);
  if (rpdo_valid(canopen, i) && canopen->params.rpdo_timeout[i] != 0) {
    canopen_put(&canopen->rpdos_waiting, i);
  } else {
    canopen_drop(&canopen->rpdos_waiting, i);
  }
}

void pdo_start(canopen_t *canopen, const dictionary_t *objects) {
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    start_rpdo(canopen, i);
    start_tpdo(canopen, objects, i);
  }
}

void pdo_operational(canopen_t *canopen, bool operational) {
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    canopen->rpdo[i].pending = 0;
    canopen->tpdo[i].pending = operational ? 1 : 0;
    canopen->tpdo[i].syncs = first_syncs(canopen, i);
    start_event_timer(canopen, i);
  }
  update_watched(canopen);
}

/* The 8 bytes that a TPDO would send now. `low` has the first four bytes, and `high` has the last
 * four bytes. */
typedef struct {
  uint32_t low;
  uint32_t high;
} payload_t;

static inline payload_t pack(const pdo_t *pdo, const dictionary_t *objects) {
  const uint8_t *base = (const uint8_t *)objects;
  return (payload_t){.low = fx_gather_le(base, pdo->places),
                     .high = fx_gather_le(base, &pdo->places[4])};
}

static inline bool has_changed(const pdo_t *pdo, payload_t now) {
  return pdo->pending != 0 || now.low != pdo->sent[0] || now.high != pdo->sent[1];
}

static inline void send(canopen_t *canopen, pdo_t *pdo, uint32_t cob_id, payload_t now) {
  can_frame_t *frame = can_output_add(&canopen->output, canopen_can_id(cob_id),
                                      (uint8_t)fx_octets(pdo->bits), CAN_OUTPUT_KEEP_PDO);
  if (frame != NULL) {
    fx_store_le(frame->data, now.low, 4);
    fx_store_le(frame->data + 4, now.high, 4);
  }
  pdo->sent[0] = now.low;
  pdo->sent[1] = now.high;
  pdo->pending = 0;
  pdo->syncs = 0;
}

/* Restarts the event time and the inhibit time of TPDO i after the TPDO was sent. The TPDO must be
 * valid, and the node must be operational. */
static inline void restart_times(canopen_t *canopen, pdo_t *pdo, uint32_t i, uint32_t now) {
  const uint32_t event = canopen->params.tpdo_event_time[i];
  const uint16_t inhibit = canopen->params.tpdo_inhibit_time[i];
  if (event != 0) {
    pdo->event_tick = now + fx_ticks_from_ms(event);
    canopen_put(&canopen->tpdos_timed, i);
  }
  if (inhibit != 0) {
    pdo->inhibit_tick = now + fx_ticks_from_100us(inhibit);
    canopen_put(&canopen->tpdos_inhibited, i);
  }
}

/* Checks whether the event time and the inhibit time of TPDO i end in the tick `now`. Returns true
 * while the inhibit time of the TPDO runs. */
static inline bool is_inhibited(canopen_t *canopen, pdo_t *pdo, uint32_t i, uint32_t now) {
  if (canopen_has(canopen->tpdos_timed, i) && pdo->event_tick == now) {
    canopen_drop(&canopen->tpdos_timed, i);
    pdo->pending = 1;
  }
  if (canopen_has(canopen->tpdos_inhibited, i) && pdo->inhibit_tick == now) {
    canopen_drop(&canopen->tpdos_inhibited, i);
  }
  return canopen_has(canopen->tpdos_inhibited, i);
}

void pdo_missed(canopen_t *canopen, uint32_t ticks) {
  const uint32_t now = canopen->timers.now;
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    pdo_t *pdo = &canopen->tpdo[i];
    pdo->event_tick = canopen_timer_caught_up(pdo->event_tick, now, ticks);
    pdo->inhibit_tick = canopen_timer_caught_up(pdo->inhibit_tick, now, ticks);
  }
}

void pdo_tick(canopen_t *canopen, const dictionary_t *objects) {
  const uint32_t now = canopen->timers.now;
  const uint8_t with_times = canopen->tpdos_timed | canopen->tpdos_inhibited;
  const uint8_t watched = canopen->tpdos_watched;
  for (uint32_t remaining = with_times | watched; remaining != 0; remaining &= remaining - 1) {
    const uint32_t i = fx_lowest_bit(remaining);
    pdo_t *pdo = &canopen->tpdo[i];
    if ((canopen_has(with_times, i) && is_inhibited(canopen, pdo, i, now)) ||
        !canopen_has(watched, i)) {
      continue;
    }
    const payload_t payload = pack(pdo, objects);
    if (has_changed(pdo, payload)) {
      send(canopen, pdo, canopen->params.tpdo_cob_id[i], payload);
      restart_times(canopen, pdo, i, now);
    }
  }
}

static void sync_tpdo(canopen_t *canopen, const dictionary_t *objects, uint8_t i, uint8_t counter) {
  pdo_t *pdo = &canopen->tpdo[i];
  const uint8_t type = canopen->params.tpdo_transmission[i];
  if (pdo->syncs == PDO_SYNC_AWAITED) {
    if (counter != 0 && counter != canopen->params.tpdo_sync_start[i]) {
      return;
    }
    pdo->syncs = 0;
  }
  const payload_t payload = pack(pdo, objects);
  bool due = has_changed(pdo, payload);
  if (type != PDO_SYNC_ACYCLIC) {
    pdo->syncs = (uint8_t)(pdo->syncs + 1);
    due = pdo->syncs >= type;
  }
  if (due) {
    send(canopen, pdo, canopen->params.tpdo_cob_id[i], payload);
  }
}

/* Sends an emergency message about RPDO i. The same message is not repeated until a correct frame
 * of the RPDO is received. */
static void report(canopen_t *canopen, uint8_t i, uint8_t what, uint16_t code) {
  pdo_t *pdo = &canopen->rpdo[i];
  if ((pdo->reported & what) == 0) {
    pdo->reported = (uint8_t)(pdo->reported | what);
    emcy_raise(canopen, code, (uint8_t)(i + 1));
  }
}

typedef struct {
  bool refused; /* true: at least one object refused its received value */
  /* true: the RPDO also has mapped objects that this call of write_part() does not write */
  bool skipped;
} written_t;

/* Writes mapped objects of RPDO i: either the controlword alone, or all other objects. */
static written_t write_part(canopen_t *canopen, dictionary_t *objects, uint8_t i,
                            bool controlword) {
  const pdo_t *pdo = &canopen->rpdo[i];
  const uint32_t *entries = &canopen->params.rpdo_mapping[i * PDO_ENTRIES];
  written_t written = {false, false};
  uint32_t bit = 0;
  for (uint8_t k = 0; bit < pdo->bits; k++) {
    const uint8_t bits = mapping_bits(entries[k]);
    const uint16_t object = pdo->places[k];
    if ((object == AXIS_OBJ_CONTROLWORD) != controlword) {
      written.skipped = true;
    } else if (object != AXIS_OBJ_NONE) {
      const uint32_t part = fx_payload_get(pdo->value, bit, bits);
      const int result = dictionary_write(objects, FW_SOURCE_CANOPEN, object,
                                          value_from_bits(part, axis_objects[object].type));
      /* No emergency message is sent if an object refuses its value because CANopen does not own
       * the axis. */
      written.refused = written.refused || (result != FW_OK && result != FW_ERROR_LOCKED);
    }
    bit += bits;
  }
  return written;
}

/* Writes the received values of RPDO i to the mapped objects. An object that refuses the received
 * value keeps its previous value; all other objects change. */
static void take_over(canopen_t *canopen, dictionary_t *objects, uint8_t i) {
  pdo_t *pdo = &canopen->rpdo[i];
  pdo->pending = 0;
  /* The deadline of an RPDO is met when the received values are applied. A frame that still waits
   * for a SYNC does not meet the deadline. */
  rpdo_in_time(canopen, i);
  canopen_drop(&canopen->rpdos_waiting, i);
  canopen_timer_start(&canopen->timers, CANOPEN_TIMER_RPDO + (uint32_t)i,
                      fx_ticks_from_ms(canopen->params.rpdo_timeout[i]));
  /* The controlword is written last, because it uses the target and the mode in the same frame. */
  const written_t others = write_part(canopen, objects, i, false);
  const bool refused =
      (others.skipped && write_part(canopen, objects, i, true).refused) || others.refused;
  if (refused) {
    report(canopen, i, PDO_REPORTED_REFUSED, AXIS_ERROR_CODE_PARAMETER_REFUSED);
  } else {
    pdo->reported = (uint8_t)(pdo->reported & ~(uint32_t)PDO_REPORTED_REFUSED);
  }
}

static void receive(canopen_t *canopen, dictionary_t *objects, uint8_t i,
                    const can_frame_t *frame) {
  pdo_t *pdo = &canopen->rpdo[i];
  const uint8_t bytes = (uint8_t)fx_octets(pdo->bits);
  if (frame->length < bytes) {
    report(canopen, i, PDO_REPORTED_SHORT, AXIS_ERROR_CODE_PDO_SHORT);
    return;
  }
  if (frame->length > bytes) {
    report(canopen, i, PDO_REPORTED_LONG, AXIS_ERROR_CODE_PDO_LONG);
  } else {
    pdo->reported = (uint8_t)(pdo->reported & PDO_REPORTED_REFUSED);
  }
  pdo->value = fx_load_payload(frame->data, bytes);
  pdo->pending = 1;
  if (canopen->params.rpdo_transmission[i] > PDO_SYNC_MAX) {
    take_over(canopen, objects, i);
  }
}

void pdo_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame) {
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    if (rpdo_valid(canopen, i) && canopen->rpdo[i].bits != 0 &&
        canopen_can_id(canopen->params.rpdo_cob_id[i]) == frame->id) {
      receive(canopen, objects, i, frame);
    }
  }
}

bool pdo_receives(const canopen_t *canopen, uint16_t id) {
  return canopen_any_cob_is(canopen->params.rpdo_cob_id, CANOPEN_PDOS, id);
}

bool pdo_transmits(const canopen_t *canopen, uint16_t id) {
  return canopen_any_cob_is(canopen->params.tpdo_cob_id, CANOPEN_PDOS, id);
}

void pdo_sync(canopen_t *canopen, dictionary_t *objects, uint8_t counter) {
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    if (tpdo_valid(canopen, i) && !is_event_driven(canopen, i)) {
      sync_tpdo(canopen, objects, i, counter);
    }
  }
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    if (canopen->rpdo[i].pending != 0) {
      take_over(canopen, objects, i);
    }
  }
}

void pdo_late(canopen_t *canopen, bool active, uint8_t rpdo) {
  /* The deadline of this RPDO starts again when the axis becomes active, even if the RPDO was not
   * received meanwhile. */
  canopen_put(&canopen->rpdos_waiting, rpdo);
  if (!active) {
    return;
  }
  /* A received value that still waits for a SYNC is discarded, because it is too old. */
  canopen->rpdo[rpdo].pending = 0;
  if (!canopen_has(canopen->rpdos_late, rpdo)) {
    canopen_put(&canopen->rpdos_late, rpdo);
    emcy_raise(canopen, AXIS_ERROR_CODE_PDO_TIMEOUT, (uint8_t)(rpdo + 1));
  }
  canopen_lose(canopen, FW_SOURCE_CANOPEN, AXIS_FAULT_PDO_TIMEOUT);
}

void pdo_restart_deadlines(canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    if (rpdo_valid(canopen, i) && canopen->params.rpdo_timeout[i] != 0 &&
        (!canopen_timer_runs(&canopen->timers, CANOPEN_TIMER_RPDO + (uint32_t)i) ||
         canopen_has(canopen->rpdos_late, i))) {
      canopen_timer_stop(&canopen->timers, CANOPEN_TIMER_RPDO + (uint32_t)i);
      canopen_put(&canopen->rpdos_waiting, i);
    }
  }
}

bool pdo_has_deadline(const canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_PDOS; i++) {
    if (rpdo_valid(canopen, i) && canopen->params.rpdo_timeout[i] != 0) {
      return true;
    }
  }
  return false;
}

void pdo_axis_active(canopen_t *canopen) {
  for (uint32_t i = 0; i < CANOPEN_PDOS; i++) {
    if (canopen_has(canopen->rpdos_waiting, i)) {
      canopen_timer_start(&canopen->timers, CANOPEN_TIMER_RPDO + i,
                          fx_ticks_from_ms(canopen->params.rpdo_timeout[i]));
    }
  }
  canopen->rpdos_waiting = 0;
}

/* The objects that configure all RPDOs or, if `transmit` is true, all TPDOs. The same rules apply
 * to both kinds of PDOs, so the same functions check them. */
typedef struct {
  const uint32_t *cob_id;
  const uint8_t *mapped;
  const uint32_t *mapping; /* mapping entries of all PDOs, PDO_ENTRIES for each PDO */
  uint16_t first_cob_id; /* number of the object (AXIS_OBJ_) that is the COB-ID of the first PDO */
  uint16_t first_transmission;
  /* number of the object (AXIS_OBJ_) that is the first timeout (RPDO) or event time (TPDO) */
  uint16_t first_time;
  uint16_t first_mapped;
  uint16_t first_mapping;
  bool transmit;
} side_t;

static side_t side_of(const canopen_t *canopen, bool transmit) {
  const canopen_params_t *params = &canopen->params;
  if (transmit) {
    return (side_t){
        params->tpdo_cob_id,    params->tpdo_mapped,          params->tpdo_mapping,
        AXIS_OBJ_TPDO_COB_ID_1, AXIS_OBJ_TPDO_TRANSMISSION_1, AXIS_OBJ_TPDO_EVENT_TIME_1,
        AXIS_OBJ_TPDO_MAPPED_1, AXIS_OBJ_TPDO_MAPPING_1,      true};
  }
  return (side_t){params->rpdo_cob_id,    params->rpdo_mapped,          params->rpdo_mapping,
                  AXIS_OBJ_RPDO_COB_ID_1, AXIS_OBJ_RPDO_TRANSMISSION_1, AXIS_OBJ_RPDO_TIMEOUT_1,
                  AXIS_OBJ_RPDO_MAPPED_1, AXIS_OBJ_RPDO_MAPPING_1,      false};
}

static int check_cob_id(const side_t *side, uint32_t i, uint32_t value) {
  const uint32_t present = side->cob_id[i];
  /* If bit 30 in the COB-ID of a TPDO is 0, the COB-ID permits remote requests. */
  const bool asks_remote = side->transmit && value != present && fx_field(value, 30, 1) == 0;
  return asks_remote ? FW_ERROR_RANGE : canopen_check_cob_id(present, value);
}

/* Checks whether the first `count` mapping entries of PDO i can be mapped together. Returns FW_OK
 * or the reason for the refusal. */
static int check_mapped(const side_t *side, uint32_t i, uint8_t count) {
  uint16_t mapped[PDO_ENTRIES];
  const int bits = mapping_objects(&side->mapping[i * PDO_ENTRIES], count, side->transmit, mapped);
  return (bits < 0) ? bits : FW_OK;
}

static int check_side(const side_t *side, uint16_t object, uint32_t value) {
  int i = canopen_element(object, side->first_cob_id, CANOPEN_PDOS);
  if (i >= 0) {
    return check_cob_id(side, (uint32_t)i, value);
  }
  if (canopen_element(object, side->first_transmission, CANOPEN_PDOS) >= 0) {
    return (value > PDO_SYNC_MAX && value < PDO_EVENT_MANUFACTURER) ? FW_ERROR_RANGE : FW_OK;
  }
  if (canopen_element(object, side->first_time, CANOPEN_PDOS) >= 0) {
    return FW_OK;
  }
  i = canopen_element(object, side->first_mapped, CANOPEN_PDOS);
  if (i >= 0) {
    if (side->mapped[i] == value) {
      return FW_OK;
    }
    return canopen_cob_valid(side->cob_id[i]) ? FW_ERROR_STATE
                                              : check_mapped(side, (uint32_t)i, (uint8_t)value);
  }
  i = canopen_element(object, side->first_mapping, CANOPEN_PDOS * PDO_ENTRIES);
  if (i >= 0) {
    if (side->mapping[i] == value) {
      return FW_OK;
    }
    const uint32_t pdo = fx_quotient((uint32_t)i, PDO_ENTRIES);
    if (canopen_cob_valid(side->cob_id[pdo]) || side->mapped[pdo] != 0) {
      return FW_ERROR_STATE;
    }
    uint16_t mapped = AXIS_OBJ_NONE;
    return (value == 0) ? FW_OK : mapping_resolve(value, side->transmit, &mapped);
  }
  return PDO_NOT_MINE;
}

/* Checks a write to the inhibit time or the SYNC start value of a TPDO. These values may only
 * change while the TPDO is not valid. */
static int check_tpdo_fixed(const canopen_params_t *params, uint16_t object, uint32_t value) {
  uint32_t present = 0;
  int i = canopen_element(object, AXIS_OBJ_TPDO_INHIBIT_TIME_1, CANOPEN_PDOS);
  if (i >= 0) {
    present = params->tpdo_inhibit_time[i];
  } else {
    i = canopen_element(object, AXIS_OBJ_TPDO_SYNC_START_1, CANOPEN_PDOS);
    if (i < 0) {
      return PDO_NOT_MINE;
    }
    present = params->tpdo_sync_start[i];
  }
  return (value != present && canopen_cob_valid(params->tpdo_cob_id[i])) ? FW_ERROR_STATE : FW_OK;
}

int pdo_check(const canopen_t *canopen, uint16_t object, int32_t value) {
  const side_t receive_side = side_of(canopen, false);
  const side_t transmit_side = side_of(canopen, true);
  int result = check_side(&receive_side, object, (uint32_t)value);
  if (result == PDO_NOT_MINE) {
    result = check_side(&transmit_side, object, (uint32_t)value);
  }
  return (result == PDO_NOT_MINE) ? check_tpdo_fixed(&canopen->params, object, (uint32_t)value)
                                  : result;
}

/* Returns the number of the PDO that has `object` as a communication parameter, or -1. A mapping
 * entry gives -1, because an entry can change only while its PDO is not valid, and acts when the
 * PDO becomes valid. */
static int communication_of(const side_t *side, uint16_t object) {
  const uint16_t first[] = {side->first_cob_id, side->first_transmission, side->first_time,
                            side->first_mapped};
  for (uint8_t k = 0; k < 4; k++) {
    const int i = canopen_element(object, first[k], CANOPEN_PDOS);
    if (i >= 0) {
      return i;
    }
  }
  return -1;
}

void pdo_written(canopen_t *canopen, const dictionary_t *objects, uint16_t object) {
  const side_t receive_side = side_of(canopen, false);
  int i = communication_of(&receive_side, object);
  if (i >= 0) {
    start_rpdo(canopen, (uint8_t)i);
    return;
  }
  const side_t transmit_side = side_of(canopen, true);
  i = communication_of(&transmit_side, object);
  if (i >= 0) {
    start_tpdo(canopen, objects, (uint8_t)i);
  }
}
