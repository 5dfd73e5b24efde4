#ifndef FIRMWARE_APP_FW_H_
#define FIRMWARE_APP_FW_H_

/* The firmware that runs on every board and in every simulation: axis, recorder, object dictionary,
 * drive profile, protocols and parameter store. The caller owns the state of the firmware. No
 * function here allocates memory, waits or has global variables. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/board.h"
#include "firmware/app/fw_state.h"
#include "firmware/canopen/can.h"
#include "firmware/drive/drive.h"

/* Size of the recorder buffer in bytes on the host, and the default size on a board. The buffer has
 * room for 5 s of two 16-bit signals. */
#define FW_RECORDER_BYTES 32768

/* Size in bytes, on the host, of the memory for cycle programs. It has room for eight programs of
 * the largest size and for the staging area. */
#define FW_PROGRAM_BYTES (9 * CYCLE_PROGRAM_BYTES_MAX)

/* Largest number of results of pressed parts that can wait for an acknowledgement, on the host and
 * on a board with cycles. */
enum { FW_RESULTS = 32 };
/* Size in bytes, on the host, of the memory for the curve of a cycle. */
#define FW_CURVE_BYTES (CYCLE_CURVE_POINTS * sizeof(cycle_curve_point_t))

/* Version of the firmware. software_version shows this version and the hash of the object table. */
#define FW_VERSION "0.1.0"

/* Initialises the firmware at power-up: parameters have their stored values or their defaults, the
 * axis is disabled, and the recorder is idle. */
void fw_init(fw_t *fw, const fw_config_t *config);

/* Computes one tick of drive, axis, recorder and protocols. A firmware on no bus computes only the
 * axis and the recorder, and the outputs are the same. When an object that belongs to neither the
 * axis nor the recorder is accessed, it also computes the drive and the protocols from then on.
 *
 * These events set code 0 and switch amplifier and brake off. The number is the tick in which this
 * happens; 1 is the first tick after the event:
 *   invalid sensors, enable chain, switches, ADC range, speed, force       1
 *   failure of the first motion test (guard/first_motion.h)                1
 *   errors of the force sensor that guard/sensor.h detects                 1
 *   no call of fw_between() for FW_BETWEEN_TICKS_MAX ticks; fw_board()     1
 *   CAN bus off (fw_can_bus), NMT stop, reset of communication             1
 *   a stop by any source: controlword, halt, native mode disabled          1
 *   a frame of another node with the same node id                          1
 *   a boot-up message of a node that 1016h monitors (owner on CAN); release of the enabled
 *     axis to a canopen that is lost or not monitored                      1
 *   NMT reset of the node: all at power-up values after the next tick      2
 *   owner other than canopen writes nothing, N ticks of its watchdog       N + 1
 *   heartbeat missing (owner on CAN), N ticks of its time                  N + 2
 *   RPDO missing (owner canopen), N ticks of its time                      N + 2
 * N is rounded up: ceil(1.5 ms). If fault_reaction_option selects a ramp, the ramp comes first and
 * takes at most CIA402_STOPPING_TICKS; the first four lines, a second node with this id and a reset
 * of the node have no ramp. abort_connection_option 0, or 3 with quick_stop_option 5 or 6, leaves
 * the axis enabled. Canopen is monitored only if 1016h or the time of an RPDO (1400h.., 5) is set.
 * Every owner is on CAN, except a Modbus client that acquired the axis over the serial line. */
void fw_tick(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs);

/* fw_tick() as four functions, for a board whose tick is an interrupt. In the interrupt,
 * fw_prepare() lets the drive set the targets of this tick. fw_prepare() needs no inputs, so the
 * conversion of the inputs may still run. fw_control() then computes the outputs from the inputs,
 * and the code for the board outputs them immediately. fw_report() does the work that most ticks
 * need after the outputs: status of the drive, a sample of the recorder, one event-driven TPDO.
 * fw_between() must run after the interrupt, before any other use of fw, and no tick may interrupt
 * it. fw_between() does the rare and long work: emergency messages, node timers that expire, the
 * silent interval of Modbus, resets (which can last longer than a tick), and a step of the store
 * (an erase can, too). Cost on a Cortex-M4: docs/chip/instructions.md.
 *
 * While fw_between() does not run, a lost heartbeat and NMT commands are not detected. After more
 * than FW_BETWEEN_TICKS_MAX ticks without fw_between(), fw_prepare() disables the axis with the
 * fault main_loop_lost, and fw_report() returns false: the caller must then not restart the
 * watchdog timer of the board. */
void fw_prepare(fw_t *fw);
void fw_control(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs);
bool fw_report(fw_t *fw);
void fw_between(fw_t *fw);

/* Functions for CAN. fw_can_receive() accepts a received frame before the tick that processes this
 * frame. fw_can_transmit() gives the next frame to send, or returns false if there is no frame.
 * fw_can_lost() accepts the number of lost frames, and fw_can_bus() accepts each new state of the
 * bus (CAN_BUS_). */
void fw_can_receive(fw_t *fw, const can_frame_t *frame);
bool fw_can_transmit(fw_t *fw, can_frame_t *frame);
void fw_can_lost(fw_t *fw, uint16_t frames);
void fw_can_bus(fw_t *fw, uint8_t state);

/* Returns the CAN bit rate in kbit/s; at power-up this is the stored bit rate. When the bit rate
 * changes, the code for the board sets the new bit rate immediately and does not send frames that
 * were queued before. */
uint16_t fw_can_kbit_s(const fw_t *fw);

/* Functions for Modbus RTU. fw_modbus_receive() accepts received bytes. fw_modbus_transmit() copies
 * bytes that must be sent, at most `room`, to `bytes`. It returns the number of copied bytes. */
void fw_modbus_receive(fw_t *fw, const uint8_t *bytes, uint16_t count);
uint16_t fw_modbus_transmit(fw_t *fw, uint8_t *bytes, uint16_t room);

/* Reports to the firmware a late tick (`missed` is 0), or `missed` ticks that did not run. The
 * signal overruns counts each of these ticks. tick_count and the timers of the CANopen node
 * (canopen_missed()) advance by the missed ticks. Call fw_overrun() after fw_between(), not in the
 * interrupt. */
void fw_overrun(fw_t *fw, uint32_t missed);

/* The code for the board reads and writes objects with these two functions. They return the same
 * results as dictionary_read() and dictionary_write(). If the firmware is on no bus, a write to an
 * object that belongs neither to the axis nor to the recorder starts the drive. */
int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value);
int fw_object_write(fw_t *fw, uint8_t source, uint16_t object, int32_t value);

/* Selects the cycle program `record` for the press cycles of mode -9. The address of the record is
 * a multiple of 4, and the record must not change while it is selected. Returns the result of
 * cycle_program_check(), or CYCLE_BUSY while a cycle runs; the previous program then stays
 * selected. After a reset of the node no program is selected. The record is not in the library, so
 * its number may be 0, and the object cycle_program is 0. A simulation or a test bench selects
 * programs with this function; a client on a bus downloads them (programs.h). */
cycle_check_t fw_select_program(fw_t *fw, const void *record, uint32_t size);

/* Reads one sample of a completed recording; index 0 is the oldest sample. `values` receives one
 * value for each selected channel in the order of recorder_signal_1 to _8; channels that are 0 have
 * no value. Returns the number of values, or FW_ERROR_NO_DATA. */
int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]);

#endif
