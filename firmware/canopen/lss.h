#ifndef FIRMWARE_CANOPEN_LSS_H_
#define FIRMWARE_CANOPEN_LSS_H_

/* LSS slave (CiA 305): sets node id and bit rate over the bus. Its address is the four numbers of
 * 1018h. Requests have the identifier 7E5h and answers 7E4h, both with 8 bytes; other frames are
 * ignored. LSS works in every NMT state, also on a node without id, which has no other service.
 *
 *   waiting and configuration   switch state global, identify remote slave, identify non-configured
 *   waiting                     switch state selective, fast scan (of a node without id)
 *   configuration               configure node id, configure and activate bit timing, store
 *                               configuration, inquire
 *
 * No LSS command moves the axis. A node id becomes active at the next reset of communication; a
 * node without id that receives one makes this reset when it changes to the state waiting. A bit
 * rate becomes active by the command activate bit timing. This stops the axis as bus off does,
 * because the node does not send for two switch delays; the rate changes between the two. The node
 * knows only table 0 of CiA 305. Answers to configure: 0 for success; 1 for a node id or rate that
 * does not exist or is not supported; 255, followed by 1, for a node id that the port has fixed.
 * The answer to store is sent when the store has finished: 0 for success; 1 without a store; 2 if
 * the store refused or failed. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

enum { LSS_REQUEST_ID = 0x7E5, LSS_ANSWER_ID = 0x7E4 };
enum { LSS_NO_NODE_ID = 255 };

/* Number of entries in the table of bit rates, and the index of the default rate. */
enum { LSS_RATES = 9, LSS_RATE_DEFAULT = 0 };

/* Returns the bit rate in kbit/s of an index in the table, 0 for a reserved index; and the index of
 * a bit rate, LSS_RATES if the table does not have it. */
uint16_t lss_kbit_s(uint8_t rate);
uint8_t lss_rate_of(uint32_t kbit_s);

/* Initialises LSS at power-up with the node id or LSS_NO_NODE_ID, whether the port has fixed the
 * node id, the bit rate, and the set of rates that the port supports (0: all rates). */
void lss_init(canopen_t *canopen, uint8_t node_id, bool fixed, uint8_t rate, uint16_t rates);

/* Acts on a reset of communication: LSS changes to the state waiting. Configured values remain. */
void lss_restart(canopen_t *canopen);

/* Whether the port supports a bit rate. */
bool lss_has_rate(const canopen_t *canopen, uint8_t rate);

/* Action of the node after an LSS request. */
typedef enum { LSS_NOTHING, LSS_RESET, LSS_SILENCE } lss_result_t;
lss_result_t lss_receive(canopen_t *canopen, const can_frame_t *frame);

/* State of the LSS command store configuration: none, requested, in progress. The result is sent as
 * the answer. */
enum { LSS_STORE_IDLE, LSS_STORE_REQUESTED, LSS_STORE_RUNNING };
enum { LSS_STORED = 0, LSS_STORE_MISSING = 1, LSS_STORE_FAILED = 2 };
void lss_stored(canopen_t *canopen, uint8_t result);

/* Whether the node neither sends nor receives because the bit rate changes. */
static inline bool lss_is_silent(const canopen_t *canopen) { return canopen->lss.silence != 0; }

/* Lets `ticks` ticks of the silence pass. Returns true when the silence has ended. */
bool lss_tick(canopen_t *canopen, uint32_t ticks);

#endif
