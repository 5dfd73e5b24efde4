#include "host/python/binding/parts.hpp"

const char *const kFirmwareHash = FORCEAXIS_FIRMWARE_HASH;
const char *const kSimulatorHash = FORCEAXIS_SIMULATOR_HASH;
