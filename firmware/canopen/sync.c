#include "firmware/canopen/sync.h"

#include "firmware/canopen/cob_id.h"
#include "firmware/canopen/emcy.h"
#include "firmware/canopen/pdo.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/generated/axis_objects_drive.h"

void sync_receive(canopen_t *canopen, dictionary_t *objects, const can_frame_t *frame) {
  const bool has_counter = canopen->params.sync_counter_overflow != 0;
  if (frame->length != (has_counter ? 1 : 0)) {
    if (canopen->sync_reported == 0) {
      canopen->sync_reported = 1;
      emcy_raise(canopen, AXIS_ERROR_CODE_SYNC_LENGTH, frame->length);
    }
    return;
  }
  canopen->sync_reported = 0;
  canopen->signals.sync_count = (uint16_t)(canopen->signals.sync_count + 1);
  if (canopen->signals.nmt_state == AXIS_NMT_STATE_OPERATIONAL) {
    pdo_sync(canopen, objects, has_counter ? frame->data[0] : 0);
  }
}

/* Checks a new COB-ID of SYNC (1005h). This COB-ID is always valid: no bit switches it off. Bit 30
 * must be 0, because a node whose bit 30 is 1 must produce SYNC. */
int sync_check_cob_id(uint32_t wanted) {
  const bool fits = fx_field(wanted, 11, 20) == 0 && !canopen_is_restricted(canopen_can_id(wanted));
  return fits ? FW_OK : FW_ERROR_RANGE;
}

/* Checks a new overflow value of the SYNC counter. The overflow value 1 is refused, because the
 * SYNC counter would then always be 1. */
int sync_check_overflow(uint32_t wanted) { return (wanted == 1) ? FW_ERROR_RANGE : FW_OK; }
