#ifndef FIRMWARE_CANOPEN_COB_ID_H_
#define FIRMWARE_CANOPEN_COB_ID_H_

/* COB-IDs of CANopen. The lowest 11 bits of a COB-ID are a CAN identifier. Bit 31 is 1 if the
 * COB-ID is not valid. */

#include <stdbool.h>
#include <stdint.h>

static inline bool canopen_cob_valid(uint32_t cob_id) { return cob_id <= UINT32_C(0x7FFFFFFF); }

/* Returns the 11-bit CAN identifier in a COB-ID. */
static inline uint16_t canopen_can_id(uint32_t cob_id) { return (uint16_t)(cob_id & 0x7FFu); }

/* Returns true if a COB-ID is valid and has the identifier `id`. */
static inline bool canopen_cob_is(uint32_t cob_id, uint16_t id) {
  return canopen_cob_valid(cob_id) && canopen_can_id(cob_id) == id;
}

/* Returns true if one of `count` COB-IDs is valid and has the identifier `id`. */
bool canopen_any_cob_is(const uint32_t *cob_ids, uint8_t count, uint16_t id);

/* Returns true if CiA 301 restricts the use of the CAN identifier `id`. */
bool canopen_is_restricted(uint16_t id);

/* Checks whether a COB-ID may change from `present` to `wanted`. Returns FW_OK; FW_ERROR_RANGE for
 * a 29-bit identifier, or for a valid COB-ID with a restricted identifier; or FW_ERROR_STATE if the
 * identifier of a valid COB-ID would change. */
int canopen_check_cob_id(uint32_t present, uint32_t wanted);

#endif
