#include "firmware/app/store.h"

void store_init(store_t *store, const store_memory_t *memory) { store->memory = memory; }
uint8_t store_load(store_t *store, fw_t *fw) {
  (void)store, (void)fw;
  return AXIS_STORE_STATE_EMPTY;
}
void store_load_block(const store_t *store, fw_t *fw, uint8_t block) {
  (void)store, (void)fw, (void)block;
}
int store_save(store_t *store, const fw_t *fw) {
  (void)store, (void)fw;
  return FW_ERROR_STATE;
}
int store_forget(store_t *store) {
  (void)store;
  return FW_ERROR_STATE;
}
uint8_t store_tick(store_t *store, const fw_t *fw) {
  (void)store, (void)fw;
  return AXIS_STORE_STATE_COUNT;
}
