#ifndef FIRMWARE_APP_RECORDING_H_
#define FIRMWARE_APP_RECORDING_H_

/* Functions for the objects of the recorder: the selection of the recorded signals, and the
 * completed recording as a CANopen domain. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Checks a write to a recorder channel or to the trigger source: the value must be 0 for none, or
 * the address of an object that has a value. Returns FW_OK or FW_ERROR_RANGE. */
int recording_check(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value);

/* Returns the recorder channel for an object. A channel consists of the offset and the type of the
 * value of the object. */
recorder_channel_t recording_channel(const fw_t *fw, uint16_t object);

/* recording_is_without_drive() returns true if a firmware on no bus can serve this object while the
 * drive does not run. recording_needs_drive() returns true if the selected channels or the trigger
 * need the drive. */
bool recording_is_without_drive(uint16_t object);
bool recording_needs_drive(const fw_t *fw);

/* Arms the recorder with the selected objects, or stops the recorder if `arm` is false. Returns
 * FW_OK or FW_ERROR_RANGE. */
int recording_command(fw_t *fw, bool arm);

/* Returns the size of the completed recording in bytes, or FW_ERROR_NO_DATA if there is no
 * completed recording. */
int32_t recording_size(const fw_t *fw);

#endif
