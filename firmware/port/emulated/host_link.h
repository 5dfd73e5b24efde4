#ifndef FIRMWARE_PORT_EMULATED_HOST_LINK_H_
#define FIRMWARE_PORT_EMULATED_HOST_LINK_H_

/* The connection of an emulated board to the plant on the host. host_link.c implements
 * port_sample(), port_sense() and port_act() of port.h, for every emulated board, and needs
 * tick_entries() of tick.h. */

#include <stdbool.h>

/* Opens the two files that the command line of the emulated program names: "forceaxis FROM_HOST
 * TO_HOST". With another command line there is no host. */
void host_link_open(void);
bool host_link_is_open(void);

#endif
