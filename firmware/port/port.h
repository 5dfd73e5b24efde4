#ifndef FIRMWARE_PORT_PORT_H_
#define FIRMWARE_PORT_PORT_H_

/* The functions that the code for one board implements. firmware/port/main.c is the program of
 * every board: it calls these functions, and the interrupt of the board calls port_tick() 1500
 * times a second. README.md beside this file describes how to add a board. The folder blank/ has a
 * board that does nothing.
 *
 * The tick calls port_sample, port_sense, port_act and port_feed_watchdog. The tick wakes the main
 * loop. The main loop calls port_can_*, port_serial_*, port_lock, port_unlock and port_idle, and it
 * calls port_overran while the tick is locked. No function waits longer than stated here. If a
 * peripheral does not respond in time, this is a fault of the axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Largest number of CAN frames that are received in one pass of the main loop, and largest number
 * that are sent in one pass. */
enum { PORT_CAN_AT_ONCE = 7 };

/* First sets safe outputs: the DAC is set to mid-scale, which is 0 V, then the amplifier is
 * switched off and the brake on. Then starts the clocks and the peripherals. The tick is started
 * later, by port_start(). */
void port_init(void);

/* Returns the configuration for fw_init(). The configuration must outlive the firmware. */
const fw_config_t *port_config(void);

/* Starts the tick and the watchdog timer. From then on port_tick() is called in each tick, and the
 * watchdog timer resets the chip if port_feed_watchdog() is not called. */
void port_start(void);

/* Read the inputs of this tick. port_sample() reads encoder and digital inputs and starts the
 * conversion of both ADC channels. port_sense() is called some 200 instructions later, reads the
 * results and waits at most 5 us. If an input cannot be read, sensor_valid is 0. All fields are 0
 * before port_sample(), so a board without a drive on a bus need not set `drive` and the ages.
 * port_sample() returns false if no tick must be computed, because the host of an emulator has
 * ended. */
bool port_sample(axis_inputs_t *inputs);
void port_sense(axis_inputs_t *inputs);

/* Sets the outputs of this tick. The amplifier is switched on only while the DAC is at mid-scale.
 * The DAC code of the tick is output after that. Before the amplifier is switched off, the DAC is
 * set to mid-scale again. */
void port_act(const axis_outputs_t *outputs);

/* Functions for CAN. port_can_receive() returns the next received frame. port_can_transmit() sends
 * a frame; if the result is false, the caller repeats the call later. port_can_bus() returns the
 * state of the bus (CAN_BUS_); it is called at least once in each tick. port_can_lost() returns the
 * number of frames lost since the last call. port_can_rate() sets the bit rate. If the bit rate
 * changes, the waiting frames are aborted, and the node joins the bus again. */
bool port_can_receive(can_frame_t *frame);
bool port_can_transmit(const can_frame_t *frame);
uint8_t port_can_bus(void);
uint16_t port_can_lost(void);
void port_can_rate(uint16_t kbit_s);

/* Functions for the serial line. port_serial_receive() returns at most `room` received bytes.
 * port_serial_transmit() accepts bytes that must be sent, and returns the number of accepted
 * bytes. */
uint16_t port_serial_receive(uint8_t *bytes, uint16_t room);
uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count);

/* port_lock() masks the tick interrupt, and port_unlock() unmasks the tick interrupt. A masked tick
 * may be late, so only short sections may run between the two calls. */
void port_lock(void);
void port_unlock(void);

/* Returns true if a tick was late since the last call. *missed is the number of ticks that did not
 * run at all. After a long stall, for example an erase of the flash, only one interrupt is pending
 * although several ticks have passed. */
bool port_overran(uint32_t *missed);

/* Restarts the watchdog timer. A tick calls port_feed_watchdog() only if the main loop has run, so
 * the watchdog timer resets the chip if the tick or the main loop stops. */
void port_feed_watchdog(void);

/* The main loop calls port_idle() when there is no work until the next interrupt. The processor may
 * then sleep. */
void port_idle(void);

/* The following functions are in firmware/port/main.c, and the code for the board calls them. */

/* Computes one tick. The 1500 Hz interrupt calls port_tick(). It runs fw_prepare() while the inputs
 * are converted, then fw_control() and fw_report(), and feeds the watchdog. The main loop runs
 * fw_between() and serves the buses. If the main loop stops for FW_BETWEEN_TICKS_MAX ticks, the
 * axis is disabled. If the main loop does not continue, the watchdog resets the chip. */
void port_tick(void);

/* Completes the last tick: runs fw_between() if it has not run after this tick yet. Call
 * port_settle() before a write to an object. */
void port_settle(void);

/* Returns the firmware. The code for a board uses it to read parameters, or to write objects as
 * FW_SOURCE_LOCAL. */
fw_t *port_firmware(void);

#endif
