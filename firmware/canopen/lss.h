#ifndef FIRMWARE_CANOPEN_LSS_H_
#define FIRMWARE_CANOPEN_LSS_H_

/* LSS slave (CiA 305): an LSS master sets the node id and the bit rate of the node over the bus.
 * The LSS address of the node is the four numbers of 1018h. Requests have the identifier 7E5h and
 * answers have 7E4h, both with 8 bytes; other frames are ignored. LSS works in every NMT state. LSS
 * is the only service of a node without node id.
 *
 * Commands that the node accepts in each LSS state:
 *
 *   waiting and configuration   switch state global, identify remote slave, identify non-configured
 *   waiting                     switch state selective, fast scan (of a node without id)
 *   configuration               configure node id, configure and activate bit timing, store
 *                               configuration, inquire
 *
 * No LSS command moves the axis. A new node id becomes active at the next reset of communication. A
 * node without id makes this reset itself: when it has received an id and then changes to the state
 * waiting. A new bit rate becomes active by the command activate bit timing. The node then sends
 * nothing for two switch delays, so the axis is stopped as with bus off; the bit rate changes
 * between the two delays. The node knows only table 0 of CiA 305.
 *
 * Answers to a configure command: 0 for success; 1 for a node id or bit rate that does not exist or
 * is not supported; 255, followed by 1, for a node id that the board fixes. The answer to store
 * configuration is sent when the store has finished: 0 for success; 1 if the board has no store; 2
 * if the store refused or failed. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

enum { LSS_REQUEST_ID = 0x7E5, LSS_ANSWER_ID = 0x7E4 };
enum { LSS_NO_NODE_ID = 255 };

/* LSS_RATES: number of entries in the table of bit rates. LSS_RATE_DEFAULT: index of the default
 * bit rate. */
enum { LSS_RATES = 9, LSS_RATE_DEFAULT = 0 };

/* lss_kbit_s() returns the bit rate in kbit/s with an index of the table of bit rates, or 0 for a
 * reserved index. lss_rate_of() returns the index of a bit rate, or LSS_RATES if the table does not
 * contain the rate. */
uint16_t lss_kbit_s(uint8_t rate);
uint8_t lss_rate_of(uint32_t kbit_s);

/* Initialises LSS at power-up. node_id is the id of the node or LSS_NO_NODE_ID. `fixed` is true if
 * the board fixes the node id. `rate` is the index of the bit rate. `rates` is the set of bit rates
 * that the board supports (0: all rates). */
void lss_init(canopen_t *canopen, uint8_t node_id, bool fixed, uint8_t rate, uint16_t rates);

/* Acts on a reset of communication: LSS changes to the state `waiting`. The configured node id and
 * bit rate do not change. */
void lss_restart(canopen_t *canopen);

/* Returns true if the board supports the bit rate with the index `rate`. */
bool lss_has_rate(const canopen_t *canopen, uint8_t rate);

/* Action that the node must carry out after an LSS request. */
typedef enum { LSS_NOTHING, LSS_RESET, LSS_SILENCE } lss_result_t;
lss_result_t lss_receive(canopen_t *canopen, const can_frame_t *frame);

/* State of the LSS command `store configuration`: no command, requested, in progress. lss_stored()
 * sends `result` (LSS_STORED to LSS_STORE_FAILED) as the answer to the command. */
enum { LSS_STORE_IDLE, LSS_STORE_REQUESTED, LSS_STORE_RUNNING };
enum { LSS_STORED = 0, LSS_STORE_MISSING = 1, LSS_STORE_FAILED = 2 };
void lss_stored(canopen_t *canopen, uint8_t result);

/* Returns true while the node neither sends nor receives because the bit rate changes. */
static inline bool lss_is_silent(const canopen_t *canopen) { return canopen->lss.silence != 0; }

/* Reduces the remaining switch delay by `ticks` ticks. Returns true when the switch delay has
 * ended. */
bool lss_tick(canopen_t *canopen, uint32_t ticks);

#endif
