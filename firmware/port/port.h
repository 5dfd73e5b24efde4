#ifndef FIRMWARE_PORT_PORT_H_
#define FIRMWARE_PORT_PORT_H_

/* The functions that a board implements. firmware/port/main.c is the program of every board: it
 * calls these, and the board's interrupt calls port_tick() 1500 times a second. README.md beside
 * this file describes how to add a board; blank/ is one that does nothing.
 *
 * Called from the tick: port_sample, port_sense, port_act, port_feed_watchdog. From the main loop,
 * which the tick wakes: port_can_*, port_serial_*, port_lock, port_unlock, port_idle, and under
 * port_lock port_overran. No call waits longer than stated here; a peripheral that does not respond
 * in time is a fault of the axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Frames received, and frames sent, in one round of the main loop. */
enum { PORT_CAN_AT_ONCE = 7 };

/* Safe outputs first: the DAC at mid-scale, which is 0 V, then amplifier off and brake on; then
 * clocks and peripherals. The tick does not run yet. */
void port_init(void);

/* Argument of fw_init(); must outlive the firmware. */
const fw_config_t *port_config(void);

/* From now on port_tick() is called, and a watchdog that is not fed resets the chip. */
void port_start(void);

/* The inputs of this tick. port_sample() reads encoder and digital inputs and starts the conversion
 * of both ADC channels; port_sense(), some 200 instructions later, reads them, waiting for at most
 * 5 us. If anything cannot be read, sensor_valid is 0. False: no tick is due (an emulator whose
 * host has ended). */
bool port_sample(axis_inputs_t *inputs);
void port_sense(axis_inputs_t *inputs);

/* Sets the outputs. The amplifier goes on only while the DAC stands at mid-scale, before it is
 * set to another code, and the DAC is back at mid-scale before the amplifier goes off. */
void port_act(const axis_outputs_t *outputs);

/* CAN: the next frame that was received; one to be sent (false: no room now, to be repeated later);
 * state of the bus, CAN_BUS_, polled at least once a tick; frames lost since the last call. The bit
 * rate, one of those in fw_config_t, before each poll: another one than before aborts what is still
 * to be sent and joins the bus again.
 */
bool port_can_receive(can_frame_t *frame);
bool port_can_transmit(const can_frame_t *frame);
uint8_t port_can_bus(void);
uint16_t port_can_lost(void);
void port_can_rate(uint16_t kbit_s);

/* Serial line: up to `room` bytes that were received; bytes to be sent, returns how many were
 * accepted. */
uint16_t port_serial_receive(uint8_t *bytes, uint16_t room);
uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count);

/* The tick interrupt is masked between the two, so a tick may be late: only for short sections. */
void port_lock(void);
void port_unlock(void);

/* Whether a tick was late since the last call; `missed`: how many did not run at all: a long
 * stall (an erase of the flash) leaves only one interrupt pending. */
bool port_overran(uint32_t *missed);

/* Called only from ticks after which the main loop has run, so that the watchdog resets the chip
 * when either of them stops. */
void port_feed_watchdog(void);

/* Nothing to do until the next interrupt. */
void port_idle(void);

/* firmware/port/main.c: called by the board. */

/* One tick, called from the 1500 Hz interrupt: fw_prepare() while inputs are converted,
 * fw_control(), fw_report(), watchdog. fw_between() and the buses run in the main loop: when
 * that hangs for FW_BETWEEN_TICKS_MAX ticks the axis is disabled, and if it does not resume the
 * watchdog resets the chip. */
void port_tick(void);

/* Completes the last tick with fw_between() if it is pending: before objects are written. */
void port_settle(void);

/* The firmware, for a board that reads parameters or writes as FW_SOURCE_LOCAL. */
fw_t *port_firmware(void);

#endif
