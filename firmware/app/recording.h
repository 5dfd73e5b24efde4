#ifndef FIRMWARE_APP_RECORDING_H_
#define FIRMWARE_APP_RECORDING_H_

/* The recorder's objects: what may be recorded, and the finished recording as a CANopen domain. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Channels and trigger are objects with a value, or none. */
int recording_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* An object as a channel. */
recorder_channel_t recording_channel(const fw_t *fw, uint16_t object);

/* Whether a firmware on no bus serves this object without its drive; and whether the present
 * choice of channels and trigger needs the drive. */
bool recording_is_without_drive(uint16_t object);
bool recording_needs_drive(const fw_t *fw);

/* Arms the recorder with the objects chosen, or stops it; FW_OK or FW_ERROR_RANGE. */
int recording_command(fw_t *fw, bool arm);

/* dictionary_domain_size() and dictionary_domain_read(). */
uint32_t recording_size(const dictionary_t *objects);
uint32_t recording_read(const dictionary_t *objects, uint32_t offset, uint8_t *bytes,
                        uint32_t count);

#endif
