#ifndef FIRMWARE_APP_PROGRAMS_H_
#define FIRMWARE_APP_PROGRAMS_H_

/* Objects for cycle programs: the library of programs (firmware/cycle/library.h), the download of a
 * program, the selected program, and the result of one evaluation element.
 *
 * One transfer at a time uses the staging area: a download by one SDO server, or a cycle program
 * that a client writes piece by piece to the objects cycle_data. If a client has sent no piece for
 * PROGRAMS_SILENCE_TICKS, another transfer may begin instead. A download and a removal are refused
 * unless the axis is disabled, because the check of a program or an erase of the flash can last
 * longer than a tick. The selection of a program takes little time. It is refused only while a
 * cycle runs or is evaluated. A change of the library is stored while the axis is disabled. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Longest time in ticks between two pieces of a cycle program: 5 s, the same time as in an SDO
 * transfer. */
enum { PROGRAMS_SILENCE_TICKS = 7500 };

/* Sets the state at power-up, after store_load(): the library has the stored programs, and no cycle
 * program is selected. */
void programs_init(fw_t *fw);

/* programs_check() checks a write to an object, and programs_written() acts on an accepted write.
 * Writes to objects that programs.c does not handle are accepted without a check. */
int programs_check(const fw_t *fw, uint16_t object, int32_t value);
void programs_written(fw_t *fw, uint16_t object, int32_t previous, int32_t value);

/* Selects a cycle program that is not in the library, for fw_select_program(). */
cycle_check_t programs_select(fw_t *fw, const cycle_header_t *program);

/* Executes the command cycle_program_remove or cycle_data_end. */
int programs_command(fw_t *fw, uint16_t object, uint32_t value);

/* Functions that the dictionary calls for a download (firmware/objects/access.h). An update of the
 * firmware (update.h) uses the same transfers, but its bytes are programmed into the flash and not
 * copied into the staging area. */
uint32_t programs_download_most(const dictionary_t *objects, uint16_t index);
int programs_download_begin(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);
int programs_download_append(dictionary_t *objects, uint32_t offset, const uint8_t *bytes,
                             uint32_t count);
int programs_download_end(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size);

#endif
