#ifndef FIRMWARE_APP_LSS_SETTINGS_H_
#define FIRMWARE_APP_LSS_SETTINGS_H_

/* The LSS settings of the axis, its node id and bit rate, which come from the port, the store or an
 * LSS master. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"
#include "firmware/canopen/lss.h"

/* Whether stored_node_id or stored_bit_rate may have a value: FW_OK or FW_ERROR_RANGE. */
int lss_settings_check(const fw_t *fw, uint16_t object, int32_t value);

/* Initialise the LSS settings at power-up. The first function runs before the stored parameters are
 * loaded and sets the node id of the port; the second runs afterwards and sets the active node id
 * and the bit rate. It returns false if the stored set is damaged. */
void lss_settings_begin(fw_t *fw);
bool lss_settings_load(fw_t *fw);

/* Sets the node to its state after power-up, with the node id that LSS has configured, before its
 * boot-up message. Returns false if the stored set is damaged. */
bool lss_settings_reset_communication(fw_t *fw);

/* Call it in fw_between(). It serves LSS requests, and lets `ticks` ticks of a change of the bit
 * rate pass. */
static inline bool lss_settings_pending(const fw_t *fw) {
  return fw->canopen.lss.silence != 0 || fw->canopen.lss.store == LSS_STORE_REQUESTED;
}
void lss_settings_serve(fw_t *fw, uint32_t ticks);

/* The store has ended its work with a state (AXIS_STORE_STATE_): LSS answers its store request. */
void lss_settings_stored(fw_t *fw, uint8_t state);

#endif
