#include "firmware/canopen/identifier.h"

#include <stddef.h>

#include "firmware/canopen/cob_id.h"
#include "firmware/canopen/pdo.h"
#include "firmware/canopen/sdo_transfer.h"

static bool has_service(const canopen_t *canopen, uint16_t object, uint16_t id) {
  const canopen_params_t *params = &canopen->params;
  const bool is_rpdo = canopen_element(object, AXIS_OBJ_RPDO_COB_ID_1, CANOPEN_PDOS) >= 0;
  const bool is_tpdo = canopen_element(object, AXIS_OBJ_TPDO_COB_ID_1, CANOPEN_PDOS) >= 0;
  return (object != AXIS_OBJ_SYNC_COB_ID && id == canopen_can_id(params->sync_cob_id)) ||
         (object != AXIS_OBJ_EMCY_COB_ID && canopen_cob_is(params->emcy_cob_id, id)) ||
         (!is_rpdo && pdo_receives(canopen, id)) || (!is_tpdo && pdo_transmits(canopen, id)) ||
         sdo_uses(canopen, object, id);
}

/* Returns the present value of a COB-ID object, or NULL if the object is not a COB-ID. */
static const uint32_t *cob_id_of(const canopen_t *canopen, uint16_t object) {
  const canopen_params_t *params = &canopen->params;
  const int rpdo = canopen_element(object, AXIS_OBJ_RPDO_COB_ID_1, CANOPEN_PDOS);
  const int tpdo = canopen_element(object, AXIS_OBJ_TPDO_COB_ID_1, CANOPEN_PDOS);
  switch (object) {
    case AXIS_OBJ_SYNC_COB_ID:
      return &params->sync_cob_id;
    case AXIS_OBJ_EMCY_COB_ID:
      return &params->emcy_cob_id;
    case AXIS_OBJ_SDO_MODBUS_RECEIVE:
      return &params->sdo_modbus_receive;
    case AXIS_OBJ_SDO_MODBUS_TRANSMIT:
      return &params->sdo_modbus_transmit;
    case AXIS_OBJ_SDO_LCM_RECEIVE:
      return &params->sdo_lcm_receive;
    case AXIS_OBJ_SDO_LCM_TRANSMIT:
      return &params->sdo_lcm_transmit;
    default:
      return (rpdo >= 0)   ? &params->rpdo_cob_id[rpdo]
             : (tpdo >= 0) ? &params->tpdo_cob_id[tpdo]
                           : NULL;
  }
}

bool identifier_is_taken(const canopen_t *canopen, uint16_t object, uint32_t wanted) {
  const uint32_t *present = cob_id_of(canopen, object);
  return present != NULL && *present != wanted && canopen_cob_valid(wanted) &&
         has_service(canopen, object, canopen_can_id(wanted));
}
