#ifndef FIRMWARE_APP_FW_H_
#define FIRMWARE_APP_FW_H_

/* The firmware as every port and every simulation runs it: the axis, its recorder and objects, the
 * drive profile, the protocols and the parameter store. The caller owns the state; nothing here
 * allocates, blocks or keeps globals. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/node.h"
#include "firmware/core/axis.h"
#include "firmware/core/blackbox.h"
#include "firmware/core/law_bank.h"
#include "firmware/core/recorder.h"
#include "firmware/drive/drive.h"
#include "firmware/modbus/server.h"
#include "firmware/objects/dictionary.h"
#include "firmware/storage/archive.h"
#include "firmware/storage/store.h"

/* Recorder buffer of the host and the default of a port: 5 s of two 16-bit codes. */
#define FW_RECORDER_BYTES 32768

/* The firmware's own version; software_version adds the hash of the object table. */
#define FW_VERSION "0.1.0"

/* Emergencies that are no fault of the axis: store_failed (at power-up: the stored set is not in
 * force, or is not the newest one; its first manufacturer byte is store_state), source_lost (where
 * abort_connection_option selects no fault), and those of FF01h to FF04h. These are sent at once,
 * and then inhibited for FW_HOLD_TICKS; contact_losses, force_saturated, limit_cycle and overruns
 * still count. FF07h watchdog_reset, 6000h core_fault and 5110h brownout_reset: at a power-up by
 * these, the first manufacturer byte is reset_cause, and the next four core_fault_pc. */
enum { FW_HELD_FIRST = AXIS_ERROR_CODE_CONTACT_LOST, FW_HELD = 4, FW_HOLD_TICKS = 1500 };

/* What has reset the chip, a set. A start by the supply alone is POWER, with or without BROWN_OUT
 * and PIN; a core fault resets by SOFTWARE. */
enum {
  FW_RESET_BROWN_OUT = 2,
  FW_RESET_PIN = 4,
  FW_RESET_POWER = 8,
  FW_RESET_SOFTWARE = 16,
  FW_RESET_WATCHDOG = 32,
  FW_RESET_WINDOW = 64,
  FW_RESET_LOW_POWER = 128
};

/* What a board kept of a fault of the core over the reset that followed. */
typedef struct {
  uint32_t pc;
  uint32_t lr;
  uint32_t cfsr;
  uint32_t hfsr;
  uint32_t bfar;
} fw_core_fault_t;

/* board_state: what a board finds of itself, a set. Those from BROWN_OUT_LEVEL to RAM are found at
 * power-up and stay. */
enum {
  FW_BOARD_CLOCK_INTERNAL = 1,
  FW_BOARD_BROWN_OUT_LEVEL = 2,
  FW_BOARD_IMAGE = 4,
  FW_BOARD_RAM = 8,
  FW_BOARD_SUPPLY = 16,
  FW_BOARD_REFERENCE = 32,
  FW_BOARD_DAC = 64,
  FW_BOARD_ENABLE = 128,
  FW_BOARD_TICK = 256,
  FW_BOARD_TICK_UNKNOWN = 512
};

/* Largest number of ticks between two calls of fw_between(), 10 ms. */
enum { FW_BETWEEN_TICKS_MAX = 15 };

/* A node without id is silent but for LSS, and no unit of Modbus. */
enum { FW_NODE_ID_BY_LSS = 255 };

/* The configuration by the port. All 0 is an axis on no bus. */
typedef struct {
  void *recorder_buffer; /* needs no alignment; must outlive fw; may be NULL with 0 bytes */
  uint32_t recorder_bytes;
  blackbox_t
      *blackbox; /* needs no initial value; lies with recorder_buffer in memory that a restart
                    does not clear, or keeps no incident over one; NULL: no black box */
  const store_memory_t *memory;  /* NULL: parameters are not stored */
  const store_memory_t *archive; /* NULL: no incident outlives a power cut */
  const char *hardware;          /* hardware_version, must outlive fw; NULL: "none" */
  uint32_t serial_number;
  uint32_t modbus_baud; /* sets the silence that ends a frame; 0: MODBUS_BAUD_DEFAULT */
  uint8_t node_id;      /* CANopen node and Modbus unit, 1..127; 0: stored_node_id, else 1;
                           FW_NODE_ID_BY_LSS: stored_node_id, else none until LSS gives one */
  uint8_t buses;        /* 1: CANopen and Modbus are served */
  uint8_t reset_cause;  /* FW_RESET_ set; 0: not known */
  const char *software; /* software_version, must outlive fw; NULL: FW_VERSION and table's hash */
  uint16_t bit_rates;   /* set of supported bit rates, see lss.h; 0: all */
  const fw_core_fault_t *core_fault; /* of the reset before this start, or NULL: there was none */
} fw_config_t;

typedef struct {
  dictionary_t objects; /* the first member: dictionary.h */
  axis_t axis;
  law_banks_t banks;
  recorder_t recorder;
  cia402_t drive;
  canopen_t canopen;
  modbus_t modbus;
  store_t store;
  archive_t archive;
  device_params_t device;
  device_signals_t device_signals;
  fw_config_t config;
  uint32_t source_silence;         /* ticks since the owner last wrote */
  uint32_t ticks_alone;            /* since fw_between() last ran */
  uint32_t reported_tick[FW_HELD]; /* when each limited emergency was last sent */
  uint8_t reported[FW_HELD];       /* 1: was sent since power-up */
  uint8_t contact_seen;            /* contact, saturation and limit cycle of the tick before */
  uint8_t tare_is_written;         /* 1: force_tare is written by the tare, which keeps 1020h */
  uint8_t on_serial;               /* 1: what is written now is received over the serial line */
  uint8_t owner_on_can;            /* 1: the owner reaches the axis over CAN; ownership.h */
  uint8_t boxed;                   /* 1: the black box records, not the recorder; incident.h */
  uint8_t live;                    /* drive and protocols are served; see fw_tick() */
} fw_t;

/* Power-up: stored parameters, else defaults; axis disabled, recorder idle. */
void fw_init(fw_t *fw, const fw_config_t *config);

/* One tick: drive, axis, recorder, protocols. A firmware on no bus whose objects beyond axis and
 * recorder were never accessed runs only axis and recorder, with the same outputs.
 *
 * Faults set code 0, amplifier and brake off, counted from the event, 1 being the next tick:
 *   invalid sensors, enable chain, switches, ADC range, speed, force       1
 *   findings of the test before the first motion (guard/first_motion.h)    1
 *   findings of the force sensor's supervision (guard/sensor.h)            1
 *   no call of fw_between() for FW_BETWEEN_TICKS_MAX ticks; fw_board()     1
 *   CAN bus off (fw_can_bus), NMT stop, reset of communication             1
 *   a stop by any source: controlword, halt, native mode disabled          1
 *   a frame of another node with this one's id                             1
 *   a boot-up message of a node that 1016h supervises (owner on CAN); release of the enabled
 *     axis to a canopen that is lost or not supervised                     1
 *   NMT reset of the node: all at power-up values after the next tick      2
 *   owner other than canopen writes nothing, N ticks of its watchdog       N + 1
 *   heartbeat missing (owner on CAN), N ticks of its time                  N + 2
 *   RPDO missing (owner canopen), N ticks of its time                      N + 2
 * N is rounded up: ceil(1.5 ms). Where fault_reaction_option selects a ramp it comes first, of
 * at most CIA402_STOPPING_TICKS, but for the first four lines, a second node of this id and a
 * reset of the node; abort_connection_option 0, or 3 with quick_stop_option 5 or 6, leaves the axis
 * enabled. Canopen is not supervised at all unless 1016h or an RPDO's time (1400h.., 5) is set. On
 * CAN is every owner but a Modbus that acquired the axis over the serial line.
 */
void fw_tick(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs);

/* fw_tick() in four, for a port whose ticks are an interrupt. In the interrupt fw_prepare() has the
 * drive set the targets of this tick; it needs no inputs, whose conversion may still be running.
 * fw_control() turns inputs into outputs, which the port puts out at once; then fw_report() does
 * what is due in most ticks: status of the drive, recorder, one event-driven TPDO. After the
 * interrupt, before anything else is done with fw, and not interrupted by a tick, fw_between() does
 * what is seldom due and long: emergencies, timers of the node that run out, the silence of Modbus,
 * resets (they last longer than a tick), a step of the store (so does an erase). Cost on a
 * Cortex-M4: docs/chip/instructions.md.
 *
 * While fw_between() does not run, neither a lost heartbeat nor NMT is noticed. After more than
 * FW_BETWEEN_TICKS_MAX ticks without it fw_prepare() disables the axis, with the fault
 * main_loop_lost, and fw_report() returns false: the caller must not feed its watchdog then. */
void fw_prepare(fw_t *fw);
void fw_control(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs);
bool fw_report(fw_t *fw);
void fw_between(fw_t *fw);

/* CAN: a received frame, before the tick that processes it; a frame to send (false:
 * none); frames that were lost; the state of the bus, CAN_BUS_, at each change. */
void fw_can_receive(fw_t *fw, const can_frame_t *frame);
bool fw_can_transmit(fw_t *fw, can_frame_t *frame);
void fw_can_lost(fw_t *fw, uint16_t frames);
void fw_can_bus(fw_t *fw, uint8_t state);

/* The bit rate, kbit/s: at power-up the stored one. A port follows it at once and sends nothing
 * that was queued before a change. */
uint16_t fw_can_kbit_s(const fw_t *fw);

/* Modbus RTU: bytes that were received; bytes to send, at most `room`, 0: none. */
void fw_modbus_receive(fw_t *fw, const uint8_t *bytes, uint16_t count);
uint16_t fw_modbus_transmit(fw_t *fw, uint8_t *bytes, uint16_t room);

/* A tick of the port came late (missed 0), or `missed` ticks did not come at all. Each counts as
 * one of `overruns`, and time advances by those missed: tick_count, and the timers of the node, see
 * canopen_missed(). After fw_between(), not in the interrupt. */
void fw_overrun(fw_t *fw, uint32_t missed);

/* What the port finds of its board, FW_BOARD_ set, and of the tick's length beside a second clock,
 * 1/1000. Called between fw_prepare() and fw_control(), it disables the axis in that tick with
 *   board_unfit   BROWN_OUT_LEVEL, IMAGE, RAM: found at power-up
 *   supply_wrong  SUPPLY, REFERENCE
 *   clock_wrong   TICK
 *   output_wrong  DAC, ENABLE
 * each for as long as it is found; the others are shown alone. board_state keeps what was found
 * until the axis has no fault. */
void fw_board(fw_t *fw, uint16_t state, int16_t tick_deviation);

/* dictionary_read() and dictionary_write() for the port itself; a write wakes the drive of a
 * firmware on no bus where the object is beyond axis and recorder. */
int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value);
int fw_object_write(fw_t *fw, uint8_t source, uint16_t object, int32_t value);

/* Sample `index` (0 the oldest) of a finished recording: one value per chosen channel, in the order
 * of recorder_signal_1.., without channels set to 0. Returns how many values, or
 * FW_ERROR_NO_DATA. */
int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]);

#endif
