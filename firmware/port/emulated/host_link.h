#ifndef FIRMWARE_PORT_EMULATED_HOST_LINK_H_
#define FIRMWARE_PORT_EMULATED_HOST_LINK_H_

/* The connection of an emulated board to the simulated plant on the host. For every emulated board,
 * host_link.c implements the functions port_sample(), port_sense() and port_act() of port.h. It
 * needs tick_entries() of tick.h. */

#include <stdbool.h>

/* Opens the two files in the command line of the emulated program, "forceaxis FROM_HOST TO_HOST".
 * If the command line is different, the board runs without a host. */
void host_link_open(void);
bool host_link_is_open(void);

#endif
