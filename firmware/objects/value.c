#include "firmware/objects/value.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects.h"

const uint8_t value_bytes_of_type[AXIS_TYPE_I32 + 1] = {
    [AXIS_TYPE_U8] = 1,  [AXIS_TYPE_I8] = 1,  [AXIS_TYPE_U16] = 2,
    [AXIS_TYPE_I16] = 2, [AXIS_TYPE_U32] = 4, [AXIS_TYPE_I32] = 4,
};

int32_t value_load(const void *base, uint32_t offset, uint8_t type) {
  fx_assert((offset & (value_bytes(type) - UINT32_C(1))) == 0);
  const void *at = (const uint8_t *)base + offset;
  switch (type) {
    case AXIS_TYPE_U8:
      return *(const uint8_t *)at;
    case AXIS_TYPE_I8:
      return *(const int8_t *)at;
    case AXIS_TYPE_U16:
      return *(const uint16_t *)at;
    case AXIS_TYPE_I16:
      return *(const int16_t *)at;
    case AXIS_TYPE_U32:
      return fx_s32_from_u32(*(const uint32_t *)at);
    default:
      return *(const int32_t *)at;
  }
}

void value_store(void *base, uint32_t offset, uint8_t type, int32_t value) {
  fx_assert((offset & (value_bytes(type) - UINT32_C(1))) == 0);
  void *at = (uint8_t *)base + offset;
  switch (type) {
    case AXIS_TYPE_U8:
      *(uint8_t *)at = (uint8_t)value;
      break;
    case AXIS_TYPE_I8:
      *(int8_t *)at = (int8_t)value;
      break;
    case AXIS_TYPE_U16:
      *(uint16_t *)at = (uint16_t)value;
      break;
    case AXIS_TYPE_I16:
      *(int16_t *)at = (int16_t)value;
      break;
    case AXIS_TYPE_U32:
      *(uint32_t *)at = (uint32_t)value;
      break;
    default:
      *(int32_t *)at = value;
      break;
  }
}

void value_store_defaults(void *structure, uint8_t block) {
  for (uint16_t i = AXIS_OBJ_NONE + 1; i < AXIS_OBJ_COUNT; i++) {
    const axis_object_t *object = &axis_objects[i];
    if (object->block == block) {
      value_store(structure, object->offset, object->type, object->initial);
    }
  }
}

int32_t value_from_bits(uint32_t bits, uint8_t type) {
  switch (type) {
    case AXIS_TYPE_I8:
      return fx_sign_extend(bits, 8);
    case AXIS_TYPE_I16:
      return fx_sign_extend(bits, 16);
    default:
      return fx_s32_from_u32(bits);
  }
}
