#ifndef FIRMWARE_PORT_PORT_H_
#define FIRMWARE_PORT_PORT_H_

/* What a board gives the firmware. firmware/port/main.c is the program of every board: it calls
 * these, and the board's interrupt calls port_tick() 1500 times a second. README.md beside this
 * file says how to add a board, blank/ is one that does nothing.
 *
 * Called from the tick: port_sample, port_sense, port_act, port_feed_watchdog. From the main loop,
 * which the tick wakes: port_can_*, port_serial_*, port_lock, port_unlock, port_idle, and under
 * port_lock port_overran. No call waits longer than it says; what a peripheral does not answer in
 * time is a fault the axis is told of. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Frames that are taken in, and given out, before the main loop looks elsewhere. */
enum { PORT_CAN_AT_ONCE = 8 };

/* Safe outputs first: the DAC at mid-scale, which is 0 V, then amplifier off and brake on; then
 * clocks and peripherals. The tick does not run yet. */
void port_init(void);

/* What fw_init() is to be given; must outlive the firmware. */
const fw_config_t *port_config(void);

/* From now on port_tick() is called, and a watchdog that is not fed resets the chip. */
void port_start(void);

/* The inputs of this tick. port_sample() reads encoder and digital inputs and starts the conversion
 * of both ADC channels; port_sense(), some 200 instructions later, reads them, waiting for at most
 * 5 us. What cannot be read leaves sensor_valid 0. False: there is nothing to be ticked this time
 * (an emulator whose host has ended). */
bool port_sample(axis_inputs_t *inputs);
void port_sense(axis_inputs_t *inputs);

/* Puts the outputs out. The amplifier goes on only while the DAC stands at mid-scale, before it is
 * given another code, and the DAC is back at mid-scale before the amplifier goes off. */
void port_act(const axis_outputs_t *outputs);

/* CAN: the next frame that was received; one to be sent (false: no room now, offer it again later);
 * state of the bus, CAN_BUS_, asked for once a tick or more often; frames lost since the last call.
 */
bool port_can_receive(can_frame_t *frame);
bool port_can_transmit(const can_frame_t *frame);
uint8_t port_can_bus(void);
uint16_t port_can_lost(void);

/* Serial line: up to `room` bytes that were received; bytes to be sent, returns how many were
 * taken. */
uint16_t port_serial_receive(uint8_t *bytes, uint16_t room);
uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count);

/* The tick stays away in between; it is then late, so this is for short stretches. */
void port_lock(void);
void port_unlock(void);

/* Whether a tick was late since the last call; `missed`: how many did not come at all, since what
 * keeps the interrupt away for long (an erase of the flash) leaves one of them pending. */
bool port_overran(uint32_t *missed);

/* Called from each tick that finds the main loop alive and from nowhere else, so that either one
 * that stops is found out. */
void port_feed_watchdog(void);

/* Nothing to do until the next interrupt. */
void port_idle(void);

/* --- firmware/port/main.c: what the board calls -------------------------------------------------
 */

/* One tick: fw_prepare() while inputs are converted, fw_control(), fw_report(), watchdog. From the
 * 1500 Hz interrupt. The rest of it, and all that comes and goes on buses, is the main loop's:
 * hanging for FW_BETWEEN_TICKS_MAX ticks, it costs the axis its outputs and, if it does not come
 * back, the watchdog resets the chip. */
void port_tick(void);

/* Does what the last tick left, if that is still to do: before the firmware is written to. */
void port_settle(void);

/* The firmware, for a board that looks at parameters or writes as FW_SOURCE_LOCAL. */
fw_t *port_firmware(void);

#endif
