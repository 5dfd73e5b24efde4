#ifndef FIRMWARE_PORT_PORT_H_
#define FIRMWARE_PORT_PORT_H_

/* The functions that the code for one board implements. firmware/port/main.c is the program of
 * every board: it calls these functions, and the interrupt of the board calls port_tick() 1500
 * times a second. README.md beside this file describes how to add a board; blank/ is a board that
 * does nothing.
 *
 * The tick calls port_sample, port_sense, port_act and port_feed_watchdog. The main loop, which the
 * tick wakes, calls port_can_*, port_serial_*, port_lock, port_unlock, port_idle, and under
 * port_lock port_overran. No function waits longer than stated here; a peripheral that does not
 * respond in time is a fault of the axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Largest number of CAN frames that are received, and largest number that are sent, in one cycle of
 * the main loop. */
enum { PORT_CAN_AT_ONCE = 7 };

/* Sets safe outputs first: the DAC at mid-scale, which is 0 V, then the amplifier off and the brake
 * on. Then starts clocks and peripherals. The tick is started later, by port_start(). */
void port_init(void);

/* Returns the configuration for fw_init(). The configuration must outlive the firmware. */
const fw_config_t *port_config(void);

/* Starts the tick and the watchdog timer. From then on port_tick() is called in each tick, and the
 * watchdog timer resets the chip if port_feed_watchdog() is not called. */
void port_start(void);

/* Read the inputs of this tick. port_sample() reads encoder and digital inputs and starts the
 * conversion of both ADC channels. port_sense() is called some 200 instructions later, reads the
 * results and waits at most 5 us. If an input cannot be read, sensor_valid is 0. All fields are 0
 * before port_sample(), so a board without a drive and without old values leaves `drive` and the
 * ages alone. port_sample() returns false if no tick is due (in an emulator whose host has ended).
 */
bool port_sample(axis_inputs_t *inputs);
void port_sense(axis_inputs_t *inputs);

/* Sets the outputs of this tick. The amplifier is switched on only while the DAC is at mid-scale;
 * the DAC gets another code afterwards. Before the amplifier is switched off, the DAC is set to
 * mid-scale again. */
void port_act(const axis_outputs_t *outputs);

/* CAN. port_can_receive() returns the next received frame. port_can_transmit() sends a frame; if
 * the result is false, the caller repeats the call later. port_can_bus() returns the state of the
 * bus (CAN_BUS_) at least once in a tick. port_can_lost() returns the number of frames lost since
 * the last call. port_can_rate() sets the bit rate; a new bit rate aborts the waiting frames, and
 * the node joins the bus again. */
bool port_can_receive(can_frame_t *frame);
bool port_can_transmit(const can_frame_t *frame);
uint8_t port_can_bus(void);
uint16_t port_can_lost(void);
void port_can_rate(uint16_t kbit_s);

/* Serial line. port_serial_receive() returns at most `room` received bytes. port_serial_transmit()
 * accepts bytes to send and returns the number of accepted bytes. */
uint16_t port_serial_receive(uint8_t *bytes, uint16_t room);
uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count);

/* port_lock() masks the tick interrupt, and port_unlock() unmasks the tick interrupt. A masked tick
 * may be late, so only short sections may run between the two calls. */
void port_lock(void);
void port_unlock(void);

/* Returns true if a tick was late since the last call. `missed` is the number of ticks that did not
 * run at all: after a long stall, such as an erase of the flash, only one interrupt is pending. */
bool port_overran(uint32_t *missed);

/* Restarts the watchdog timer. A tick calls port_feed_watchdog() only if the main loop has run, so
 * the watchdog timer resets the chip if the tick or the main loop stops. */
void port_feed_watchdog(void);

/* The main loop calls port_idle() when there is no work until the next interrupt. The processor may
 * then sleep. */
void port_idle(void);

/* The following functions are in firmware/port/main.c, and the code for the board calls them. */

/* Computes one tick; the 1500 Hz interrupt calls port_tick(). While the inputs are converted,
 * port_tick() runs fw_prepare(), then fw_control() and fw_report(), and feeds the watchdog. The
 * main loop runs fw_between() and the buses. If the main loop stops for FW_BETWEEN_TICKS_MAX ticks,
 * the axis is disabled; if the main loop stays stopped, the watchdog resets the chip. */
void port_tick(void);

/* Completes the last tick with fw_between() if this call is still pending. Call port_settle()
 * before a write to an object. */
void port_settle(void);

/* Returns the firmware, for the code of a board that reads parameters or writes objects as
 * FW_SOURCE_LOCAL. */
fw_t *port_firmware(void);

#endif
