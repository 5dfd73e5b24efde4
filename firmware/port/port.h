#ifndef FIRMWARE_PORT_PORT_H_
#define FIRMWARE_PORT_PORT_H_

/* The functions that a board implements. firmware/port/main.c is the program of every board: it
 * calls these functions, and the interrupt of the board calls port_tick() 1500 times a second.
 * README.md beside this file describes how to add a board; blank/ is a board that does nothing.
 *
 * The tick calls port_sample, port_sense, port_act and port_feed_watchdog. The main loop, which the
 * tick wakes, calls port_can_*, port_serial_*, port_lock, port_unlock, port_idle, and under
 * port_lock port_overran. No function waits longer than stated here; a peripheral that does not
 * respond in time is a fault of the axis. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* Largest number of CAN frames received, and of frames sent, in one cycle of the main loop. */
enum { PORT_CAN_AT_ONCE = 7 };

/* Sets safe outputs first: the DAC at mid-scale, which is 0 V, then the amplifier off and the brake
 * on. Then starts clocks and peripherals. The tick does not run yet. */
void port_init(void);

/* Returns the argument of fw_init(); it must outlive the firmware. */
const fw_config_t *port_config(void);

/* Starts the tick and the watchdog: from now on port_tick() is called, and the watchdog resets the
 * chip if it is not fed. */
void port_start(void);

/* Reads the inputs of this tick. port_sample() reads encoder and digital inputs and starts the
 * conversion of both ADC channels; port_sense(), some 200 instructions later, reads the results and
 * waits at most 5 us. If an input cannot be read, sensor_valid is 0. port_sample() returns false if
 * no tick is due (in an emulator whose host has ended). */
bool port_sample(axis_inputs_t *inputs);
void port_sense(axis_inputs_t *inputs);

/* Sets the outputs. The amplifier is switched on only while the DAC is at mid-scale, before the DAC
 * gets another code; the DAC is at mid-scale again before the amplifier is switched off. */
void port_act(const axis_outputs_t *outputs);

/* CAN. The functions return the next received frame; send a frame (false: no room now, the caller
 * repeats it later); return the bus state, CAN_BUS_, which is polled at least once in a tick; and
 * return the number of frames lost since the last call. The bit rate, one of those in fw_config_t,
 * is set before each poll; a changed rate aborts waiting frames and joins the bus again. */
bool port_can_receive(can_frame_t *frame);
bool port_can_transmit(const can_frame_t *frame);
uint8_t port_can_bus(void);
uint16_t port_can_lost(void);
void port_can_rate(uint16_t kbit_s);

/* Serial line. The functions return up to `room` received bytes, and accept bytes to send and
 * return how many were accepted. */
uint16_t port_serial_receive(uint8_t *bytes, uint16_t room);
uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count);

/* port_lock() masks the tick interrupt, and port_unlock() unmasks it. A tick may be late meanwhile,
 * so use them only for short sections. */
void port_lock(void);
void port_unlock(void);

/* Whether a tick was late since the last call. `missed` is the number of ticks that did not run at
 * all: after a long stall (an erase of the flash) only one interrupt is pending. */
bool port_overran(uint32_t *missed);

/* Feeds the watchdog. Only ticks after which the main loop has run call it, so that the watchdog
 * resets the chip if tick or main loop stops. */
void port_feed_watchdog(void);

/* There is no work until the next interrupt: the processor may sleep. */
void port_idle(void);

/* Functions of firmware/port/main.c that the board calls. */

/* Computes one tick, called from the 1500 Hz interrupt: fw_prepare() while the inputs are
 * converted, fw_control(), fw_report(), watchdog. fw_between() and the buses run in the main loop:
 * if the main loop stops for FW_BETWEEN_TICKS_MAX ticks, the axis is disabled; if it does not
 * resume, the watchdog resets the chip. */
void port_tick(void);

/* Completes the last tick with fw_between() if this is pending. Call it before a write to an
 * object. */
void port_settle(void);

/* Returns the firmware, for a board that reads parameters or writes as FW_SOURCE_LOCAL. */
fw_t *port_firmware(void);

#endif
