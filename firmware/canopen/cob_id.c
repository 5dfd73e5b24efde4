#include "firmware/canopen/cob_id.h"

#include "firmware/fx/bytes.h"
#include "firmware/objects/access.h"

/* Ranges of CAN identifiers, from `first` to `last`, whose use CiA 301 restricts. */
enum { RESTRICTED = 6 };
static const struct {
  uint16_t first;
  uint16_t last;
} restricted[RESTRICTED] = {
    {0x000, 0x07F}, /* CAN identifiers of NMT, and identifiers that CiA 301 reserves for safety */
    {0x101, 0x180}, {0x581, 0x5FF}, /* SDO answers from the server */
    {0x601, 0x67F},                 /* SDO requests to the server */
    {0x6E0, 0x6FF}, {0x701, 0x7FF}, /* heartbeats of NMT error control, and reserved identifiers */
};

bool canopen_any_cob_is(const uint32_t *cob_ids, uint8_t count, uint16_t id) {
  for (uint8_t i = 0; i < count; i++) {
    if (canopen_cob_is(cob_ids[i], id)) {
      return true;
    }
  }
  return false;
}

bool canopen_is_restricted(uint16_t id) {
  for (uint8_t i = 0; i < RESTRICTED; i++) {
    if (id >= restricted[i].first && id <= restricted[i].last) {
      return true;
    }
  }
  return false;
}

int canopen_check_cob_id(uint32_t present, uint32_t wanted) {
  const bool becomes_valid = canopen_cob_valid(wanted);
  if (wanted == present) {
    return FW_OK;
  }
  if (fx_field(wanted, 11, 19) != 0 ||
      (becomes_valid && canopen_is_restricted(canopen_can_id(wanted)))) {
    return FW_ERROR_RANGE;
  }
  const bool moves = canopen_can_id(wanted) != canopen_can_id(present);
  return (moves && becomes_valid && canopen_cob_valid(present)) ? FW_ERROR_STATE : FW_OK;
}
