#ifndef FIRMWARE_CANOPEN_COB_ID_H_
#define FIRMWARE_CANOPEN_COB_ID_H_

/* COB-IDs: an 11-bit identifier; bit 31 is 1 if the COB-ID is not valid. */

#include <stdbool.h>
#include <stdint.h>

static inline bool canopen_cob_valid(uint32_t cob_id) { return cob_id <= UINT32_C(0x7FFFFFFF); }

/* Returns the identifier of a COB-ID. */
static inline uint16_t canopen_can_id(uint32_t cob_id) { return (uint16_t)(cob_id & 0x7FFu); }

/* Whether a COB-ID is valid and has this identifier. */
static inline bool canopen_cob_is(uint32_t cob_id, uint16_t id) {
  return canopen_cob_valid(cob_id) && canopen_can_id(cob_id) == id;
}

/* Whether one of `count` COB-IDs is valid and has this identifier. */
bool canopen_any_cob_is(const uint32_t *cob_ids, uint8_t count, uint16_t id);

/* Whether CiA 301 restricts the use of the identifier. */
bool canopen_is_restricted(uint16_t id);

/* Whether a COB-ID may change from `present` to `wanted`: FW_OK; FW_ERROR_RANGE (29-bit identifier,
 * or valid with a restricted identifier); or FW_ERROR_STATE (another identifier while the COB-ID is
 * valid). */
int canopen_check_cob_id(uint32_t present, uint32_t wanted);

#endif
