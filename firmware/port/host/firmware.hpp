#ifndef FIRMWARE_PORT_HOST_FIRMWARE_HPP_
#define FIRMWARE_PORT_HOST_FIRMWARE_HPP_

// Every header of the firmware for C++ (tests, benchmarks). They are plain C without any
// conditional, so their C linkage is given here. Include this before any of them.

#include <stdbool.h>
#include <stdint.h>

extern "C" {
#include "firmware/app/fw.h"
#include "firmware/app/update.h"
#include "firmware/canopen/can.h"
#include "firmware/canopen/lss.h"
#include "firmware/canopen/node.h"
#include "firmware/core/axis.h"
#include "firmware/core/certificate.h"
#include "firmware/core/faults.h"
#include "firmware/core/laws.h"
#include "firmware/core/limits.h"
#include "firmware/core/profile.h"
#include "firmware/core/recorder.h"
#include "firmware/cycle/cycle.h"
#include "firmware/cycle/element.h"
#include "firmware/cycle/program.h"
#include "firmware/drive/drive.h"
#include "firmware/drive402/drive402.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/modbus/server.h"
#include "firmware/objects/dictionary.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/objects/value.h"
#include "firmware/port/host/axis_host.h"
#include "firmware/storage/slots.h"
#include "firmware/storage/store.h"
}

#endif
