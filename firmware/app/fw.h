#ifndef FIRMWARE_APP_FW_H_
#define FIRMWARE_APP_FW_H_

/* The firmware as every port and every simulation runs it: the axis, its recorder and its objects.
 * The caller owns the state; nothing here allocates, blocks or keeps globals. */

#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/core/recorder.h"

/* Recorder buffer of the host and the default of a port: the axis memory of 3.1.2. */
#define FW_RECORDER_BYTES 12288

typedef struct {
  axis_t axis;
  recorder_t recorder;
} fw_t;

/* Refusals. A refused call changes nothing. */
typedef enum {
  FW_OK = 0,
  FW_ERROR_NO_OBJECT = -1,  /* no object of this number */
  FW_ERROR_READ_ONLY = -2,  /* a signal cannot be written */
  FW_ERROR_WRITE_ONLY = -3, /* a command cannot be read */
  FW_ERROR_RANGE = -4,      /* outside the range of the object, or at odds with another one */
  FW_ERROR_STATE = -5,      /* not in this state of the axis or the recorder */
  FW_ERROR_NO_DATA = -6     /* no finished recording, or no sample of this index */
} fw_error_t;

/* Power-up: every parameter at its default, axis disabled, recorder idle. The buffer stays with the
 * caller and must outlive fw; it needs no alignment and may be NULL with 0 bytes. */
void fw_init(fw_t *fw, void *recorder_buffer, uint32_t recorder_bytes);

/* One tick: axis_tick(), then the recorder. */
void fw_tick(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs);

/* The raw value of an object (AXIS_OBJ_); u32 as the same 32 bits.
 * Returns FW_OK, FW_ERROR_NO_OBJECT or FW_ERROR_WRITE_ONLY. */
int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value);

/* Writes a raw value or gives a command, between ticks; the next tick sees it.
 * FW_ERROR_RANGE: outside the object's range (nothing is clipped); force_sign 0; position_min above
 *   position_max; a recorder channel or trigger that is no readable object; recorder_arm with no
 *   channel, or with a pretrigger or length that the buffer does not hold.
 * FW_ERROR_STATE: an object that may only be written with the axis disabled (or the recorder idle
 *   or done) while it is not; a mode other than disabled while a fault is latched.
 * The soft limits and position_setpoint are not checked against each other, in either order: a
 *   limit can always be drawn closer, and the axis stops at it on the way to a set-point beyond. */
int fw_object_write(fw_t *fw, uint16_t object, int32_t value);

/* Sample `index` (0 the oldest) of a finished recording: one value per chosen channel, in the order
 * of recorder_signal_1.., channels set to 0 left out. Returns how many values, or
 * FW_ERROR_NO_DATA. */
int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]);

#endif
