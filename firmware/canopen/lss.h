#ifndef FIRMWARE_CANOPEN_LSS_H_
#define FIRMWARE_CANOPEN_LSS_H_

/* LSS slave, CiA 305: node id and bit rate over the bus. Its address are the four numbers of 1018h;
 * requests are 7E5h, answers 7E4h, both of 8 bytes; others are ignored. Served in every NMT state,
 * also by a node without id, which serves nothing else.
 *
 *   waiting and configuration   switch state global, identify remote slave, identify non-configured
 *   waiting                     switch state selective, fast scan (of a node without id)
 *   configuration               configure node id, configure and activate bit timing, store
 *                               configuration, inquire
 *
 * None of them moves the axis. A node id counts from the next reset of communication; a node
 * without one that is given an id makes that reset as it enters waiting. A bit rate counts from its
 * activation, which stops the axis as bus off does, because the bus falls silent for two switch
 * delays; the rate changes between the two. Only table 0 of CiA 305 is known. Answers to configure:
 * 0; 1 for an id or a rate that does not exist or is not supported; 255, followed by 1, for a node
 * id that the port has fixed. The answer to store comes when the store has ended: 0; 1 without a
 * store; 2 where it refused or failed. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/state.h"

enum { LSS_REQUEST_ID = 0x7E5, LSS_ANSWER_ID = 0x7E4 };
enum { LSS_NO_NODE_ID = 255 };

/* Places in the table of bit rates. */
enum { LSS_RATES = 9, LSS_RATE_DEFAULT = 0 };

/* kbit/s of a place, 0: reserved; and the place of a rate, LSS_RATES without one. */
uint16_t lss_kbit_s(uint8_t rate);
uint8_t lss_rate_of(uint32_t kbit_s);

/* At power-up: node id or LSS_NO_NODE_ID; whether the port has fixed it; the bit rate; the set of
 * rates that the port supports, 0: all of them. */
void lss_init(canopen_t *canopen, uint8_t node_id, bool fixed, uint8_t rate, uint16_t rates);

/* A reset of communication: waiting. What is configured stays. */
void lss_restart(canopen_t *canopen);

/* Whether the port supports a rate. */
bool lss_has_rate(const canopen_t *canopen, uint8_t rate);

/* What the node is to do after a request. */
typedef enum { LSS_NOTHING, LSS_RESET, LSS_SILENCE } lss_result_t;
lss_result_t lss_receive(canopen_t *canopen, const can_frame_t *frame);

/* Store configuration: requested, in progress; its result is the answer. */
enum { LSS_STORE_IDLE, LSS_STORE_REQUESTED, LSS_STORE_RUNNING };
enum { LSS_STORED = 0, LSS_STORE_MISSING = 1, LSS_STORE_FAILED = 2 };
void lss_stored(canopen_t *canopen, uint8_t result);

/* Whether nothing is sent or received because the bit rate changes. */
static inline bool lss_is_silent(const canopen_t *canopen) { return canopen->lss.silence != 0; }

/* `ticks` of a silence have passed. True: it has ended. */
bool lss_tick(canopen_t *canopen, uint32_t ticks);

#endif
