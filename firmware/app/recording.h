#ifndef FIRMWARE_APP_RECORDING_H_
#define FIRMWARE_APP_RECORDING_H_

/* The objects of the recorder: which signals may be recorded, and the completed recording as a
 * CANopen domain. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Whether channels and trigger are objects with a value, or 0 for none. */
int recording_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns the recorder channel of an object. */
recorder_channel_t recording_channel(const fw_t *fw, uint16_t object);

/* Whether the firmware can serve this object on no bus without its drive; and whether the selected
 * channels and trigger need the drive. */
bool recording_is_without_drive(uint16_t object);
bool recording_needs_drive(const fw_t *fw);

/* Arms the recorder with the selected objects, or stops it. Returns FW_OK or FW_ERROR_RANGE. */
int recording_command(fw_t *fw, bool arm);

/* Size and bytes of the recording, for dictionary_domain_size() and dictionary_domain_read(). */
uint32_t recording_size(const dictionary_t *objects);
uint32_t recording_read(const dictionary_t *objects, uint32_t offset, uint8_t *bytes,
                        uint32_t count);

#endif
