#ifndef FIRMWARE_APP_LSS_SETTINGS_H_
#define FIRMWARE_APP_LSS_SETTINGS_H_

/* LSS settings of the axis: the node id and the bit rate. The values come from the configuration
 * fw_config_t, from the parameter store or from an LSS master. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"
#include "firmware/canopen/lss.h"

/* Checks whether `value` is permitted for stored_node_id, stored_bit_rate or drive_bit_rate.
 * Returns FW_OK or FW_ERROR_RANGE. */
int lss_settings_check(const fw_t *fw, uint16_t object, int32_t value);

/* Functions that initialise the LSS settings at power-up. lss_settings_begin() is called before the
 * stored parameters are loaded, and sets the node id of the configuration fw_config_t.
 * lss_settings_load() is called after the load, and sets the active node id and the bit rate. It
 * returns false if the stored parameter set is damaged. */
void lss_settings_begin(fw_t *fw);
bool lss_settings_load(fw_t *fw);

/* Sets the CANopen node to its state at power-up, before the boot-up message, with the node id that
 * LSS has configured. Returns false if the stored parameter set is damaged. */
bool lss_settings_reset_communication(fw_t *fw);

/* lss_settings_serve() serves LSS requests. During a change of the bit rate it also reduces the
 * remaining switch delay (CiA 305) by `ticks` ticks; the node neither sends nor receives in the
 * switch delay. Call lss_settings_serve() in fw_between() if lss_settings_pending() returns
 * true. */
static inline bool lss_settings_pending(const fw_t *fw) {
  return fw->canopen.lss.silence != 0 || fw->canopen.lss.store == LSS_STORE_REQUESTED;
}
void lss_settings_serve(fw_t *fw, uint32_t ticks);

/* Call lss_settings_stored() when the parameter store has ended its work with the state `state`
 * (AXIS_STORE_STATE_). LSS then answers the request to store the LSS settings. */
void lss_settings_stored(fw_t *fw, uint8_t state);

#endif
