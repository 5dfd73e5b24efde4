#ifndef FIRMWARE_CANOPEN_COB_ID_H_
#define FIRMWARE_CANOPEN_COB_ID_H_

/* COB-IDs: an 11-bit identifier, and in bit 31 whether it is not valid. */

#include <stdbool.h>
#include <stdint.h>

static inline bool canopen_cob_valid(uint32_t cob_id) { return cob_id <= UINT32_C(0x7FFFFFFF); }

/* The identifier in a COB-ID. */
static inline uint16_t canopen_can_id(uint32_t cob_id) { return (uint16_t)(cob_id & 0x7FFu); }

/* Whether a COB-ID is valid and has this identifier. */
static inline bool canopen_cob_is(uint32_t cob_id, uint16_t id) {
  return canopen_cob_valid(cob_id) && canopen_can_id(cob_id) == id;
}

/* Whether one of `count` COB-IDs does. */
bool canopen_any_cob_is(const uint32_t *cob_ids, uint8_t count, uint16_t id);

/* Whether CiA 301 reserves the identifier. */
bool canopen_is_restricted(uint16_t id);

/* Whether a COB-ID may become another one: FW_OK, FW_ERROR_RANGE (29 bits; restricted and valid) or
 * FW_ERROR_STATE (another identifier while valid). */
int canopen_check_cob_id(uint32_t present, uint32_t wanted);

#endif
