#ifndef FIRMWARE_APP_UPDATE_H_
#define FIRMWARE_APP_UPDATE_H_

/* Update of the firmware in operation: a client writes an image to the slot whose image does not
 * run (storage/slots.h), restarts the chip, and confirms the new image.
 *
 * An update consists of a head (update_head_t) and the image. The head is checked as soon as it is
 * complete: an update for another board, another object table or the other slot is refused, and the
 * slot is unchanged. Then the slot is erased, which takes up to 2 s. Each word of the image is
 * programmed when it has been received, and read back. The trailer is programmed if the CRC of the
 * whole image is correct. A client sends the bytes as the download program_data, or piece by piece
 * to the objects cycle_data. An update begins only while the axis is disabled, and the axis cannot
 * be enabled before the update has ended, or before UPDATE_SILENCE_TICKS have passed since its last
 * byte.
 *
 * Only a confirmed image accepts an update, because the update overwrites the other image, to which
 * the chip would return if the running image were not confirmed. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

enum {
  /* number of ticks from the command until the chip restarts: 100 ms */
  UPDATE_RESTART_TICKS = 150,
  UPDATE_CONFIRM_TICKS = 15000, /* time without an overrun before an image may be confirmed: 10 s */
  UPDATE_BYTES_MAX = (int)UPDATE_HEAD_BYTES + (int)SLOT_IMAGE_BYTES_MAX
};

/* First word of the head of an update of the firmware. */
#define UPDATE_MAGIC UINT32_C(0x55584146) /* "FAXU" */

/* update_init() sets the state at power-up. update_show() writes the state of the images to the
 * signals, after a reset of the node or of its communication. */
void update_init(fw_t *fw);
void update_show(fw_t *fw);

/* Begins an update. `size` is the number of its bytes if the client has announced it, otherwise 0.
 * Returns FW_OK; FW_ERROR_NO_MEMORY if the board has no slots; FW_ERROR_BUSY if a restart of the
 * chip is due; or FW_ERROR_STATE if the axis is enabled or the running image is not confirmed. */
int update_begin(fw_t *fw, uint32_t size);

/* Programs the next bytes of the update. Returns FW_OK; FW_ERROR_STATE if no update is in progress;
 * FW_ERROR_RANGE if the update is refused; or FW_ERROR_NO_DATA if the flash fails. After one of the
 * last two errors the update has ended, and the object program_refusal gives the reason. */
int update_append(fw_t *fw, const uint8_t *bytes, uint32_t count);

/* Programs 4 bytes of the update. `offset` is their offset modulo 65536. Bytes that were already
 * received are ignored, so a client may repeat a request. Bytes that follow missing bytes are
 * dropped. */
void update_part(fw_t *fw, uint16_t offset, const uint8_t bytes[4]);

/* Returns FW_OK if the last update is complete. Ends an update that is incomplete. */
int update_end(fw_t *fw);

/* Ends a firmware update in progress, because another download begins. */
static inline void update_abandon(fw_t *fw) { fw->update.is_receiving = 0; }

/* Executes a command that was written to the object program_control. */
int update_command(fw_t *fw, uint32_t value);

/* Call update_serve() between two ticks. It restarts the chip when a client has commanded a
 * restart. */
void update_serve(fw_t *fw);

#endif
