#ifndef FIRMWARE_APP_LAYERS_H_
#define FIRMWARE_APP_LAYERS_H_

/* Node id and bit rate of the axis, from the port, the store and LSS. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"
#include "firmware/canopen/lss.h"

/* Whether stored_node_id or stored_bit_rate may have a value: FW_OK, FW_ERROR_RANGE. */
int layers_check(const fw_t *fw, uint16_t object, int32_t value);

/* At power-up, before and after the stored parameters are loaded: the node id that the port gives,
 * then the one that counts, and the bit rate. False: the stored set is damaged by now. */
void layers_begin(fw_t *fw);
bool layers_load(fw_t *fw);

/* The node as after power-up, with the id that LSS has configured, before its boot-up message.
 * False: as above. */
bool layers_reset_communication(fw_t *fw);

/* In fw_between(): requests of LSS, and `ticks` ticks of a change of the bit rate. */
static inline bool layers_pending(const fw_t *fw) {
  return fw->canopen.lss.silence != 0 || fw->canopen.lss.store == LSS_STORE_REQUESTED;
}
void layers_serve(fw_t *fw, uint32_t ticks);

/* The store ended in a state (AXIS_STORE_STATE_). */
void layers_stored(fw_t *fw, uint8_t state);

#endif
