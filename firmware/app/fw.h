#ifndef FIRMWARE_APP_FW_H_
#define FIRMWARE_APP_FW_H_

/* The firmware that runs on every board and in every simulation: axis, recorder, object dictionary,
 * drive profile, protocols and parameter store. The caller owns the state of the firmware. No
 * function here allocates memory, waits or has global variables. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/canopen/node.h"
#include "firmware/core/axis.h"
#include "firmware/core/blackbox.h"
#include "firmware/core/law_bank.h"
#include "firmware/core/recorder.h"
#include "firmware/cycle/curve.h"
#include "firmware/cycle/library.h"
#include "firmware/cycle/results.h"
#include "firmware/drive/drive.h"
#include "firmware/modbus/server.h"
#include "firmware/objects/dictionary.h"
#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"
#include "firmware/storage/archive.h"
#include "firmware/storage/slots.h"
#include "firmware/storage/store.h"

/* Size of the recorder buffer in bytes, on the host and by default on a board. The buffer has room
 * for 5 s of two 16-bit signals. */
#define FW_RECORDER_BYTES 32768

/* Size of the memory for programs of cycles in bytes, on the host: eight of the longest programs
 * and the staging area. */
#define FW_PROGRAM_BYTES (9 * CYCLE_PROGRAM_BYTES_MAX)

/* Number of results that wait for an acknowledgement, on the host and on a board with cycles. */
enum { FW_RESULTS = 32 };
/* Size of the memory for the curve of a cycle in bytes, on the host. */
#define FW_CURVE_BYTES (CYCLE_CURVE_POINTS * sizeof(cycle_curve_point_t))

/* Version of the firmware. software_version shows this version and the hash of the object table. */
#define FW_VERSION "0.1.0"

/* Emergency messages that are no fault of the axis. store_failed: at power-up the stored parameter
 * set is not active or is not the newest set; the first manufacturer byte is store_state.
 * source_lost: the owner was lost and abort_connection_option selects no fault. FF01h to FF04h are
 * sent immediately and are then inhibited for FW_HOLD_TICKS; contact_losses, force_saturated,
 * limit_cycle and overruns still count. FF07h watchdog_reset, 6000h core_fault and 5110h
 * brownout_reset report the reset before this power-up: the first manufacturer byte is reset_cause,
 * and the next four bytes are core_fault_pc. */
enum { FW_HELD_FIRST = AXIS_ERROR_CODE_CONTACT_LOST, FW_HELD = 4, FW_HOLD_TICKS = 1500 };

/* Registers of the processor core at its last fault. The board keeps these values over the
 * following reset. */
typedef struct {
  uint32_t pc;
  uint32_t lr;
  uint32_t cfsr;
  uint32_t hfsr;
  uint32_t bfar;
} fw_core_fault_t;

/* The two slots of a board whose firmware can be updated in operation (update.h). */
typedef struct {
  const store_memory_t *memory; /* memory with one sector for each slot */
  uint32_t address[SLOTS];      /* address for which the image of each slot is linked */
  const char *board;            /* name of the board in an update, 16 bytes, filled with zeros */
  void (*restart)(void);        /* restarts the chip through its loader; does not return */
  uint8_t running;              /* slot of the running image, which has a trailer */
} fw_slots_t;

/* Largest number of ticks between two calls of fw_between(): 15 ticks are 10 ms. */
enum { FW_BETWEEN_TICKS_MAX = 15 };

/* Node id of an axis that waits for an id from an LSS master. This axis answers only LSS requests
 * and has no Modbus unit. */
enum { FW_NODE_ID_BY_LSS = 255 };

/* Configuration of the firmware for fw_init(). If all fields are 0, the axis is on no bus. */
typedef struct {
  /* buffer of the recorder, which needs no alignment and must outlive the firmware; NULL is
   * permitted if recorder_bytes is 0 */
  void *recorder_buffer;
  uint32_t recorder_bytes;
  /* Memory of the black box, which needs no initial value; NULL if there is no black box. To keep
   * an incident over a restart, this memory and recorder_buffer must be in memory that a restart
   * does not clear. */
  blackbox_t *blackbox;
  const store_memory_t *memory; /* memory of the parameter store; NULL if no parameter is stored */
  /* memory of the archive; NULL if no incident is kept over a power cut */
  const store_memory_t *archive;
  /* text of hardware_version, which must outlive the firmware; NULL selects the text "none" */
  const char *hardware;
  uint32_t serial_number;
  /* bit rate of the Modbus serial line in bit/s, which determines the silent interval that ends a
   * frame; 0 selects MODBUS_BAUD_DEFAULT */
  uint32_t modbus_baud;
  /* CANopen node id and Modbus unit, 1 to 127. 0: the axis uses stored_node_id, or 1 if no id is
   * stored. FW_NODE_ID_BY_LSS: the axis uses stored_node_id, or has no id until an LSS master gives
   * an id. */
  uint8_t node_id;
  uint8_t buses; /* 1 if the firmware serves CANopen and Modbus; 0 if the axis is on no bus */
  /* causes of the last reset, as a set of AXIS_RESET_CAUSE_ bits; 0 if no cause is known. When only
   * the supply was switched on, POWER is set; BROWN_OUT and PIN may be set too. A fault of the
   * processor core sets SOFTWARE. */
  uint8_t reset_cause;
  /* text of software_version, which must outlive the firmware; NULL selects FW_VERSION and the hash
   * of the object table */
  const char *software;
  /* set of the CAN bit rates that the board supports (lss.h); 0 permits all bit rates */
  uint16_t bit_rates;
  /* largest dac_bits that the code for the board outputs without a drive on a bus, 12 to 16; 0
   * permits 16 */
  uint8_t dac_bits;
  /* registers at the fault of the processor core that caused the last reset; NULL without such a
   * fault */
  const fw_core_fault_t *core_fault;
  /* memory for programs of cycles, which begins at a multiple of 4 and must outlive the firmware: a
   * staging area of CYCLE_PROGRAM_BYTES_MAX bytes, then the library. NULL: no program can be
   * downloaded */
  void *program_memory;
  uint32_t program_bytes; /* FW_PROGRAM_BYTES on the host */
  /* memory for the results of parts that wait for an acknowledgement, which begins at a multiple of
   * 4 and must outlive the firmware: FW_RESULTS of cycle_part_t. NULL: only the last result is
   * kept, and no cycle waits for an acknowledgement */
  void *result_memory;
  uint32_t result_bytes;
  /* memory for the curve of a cycle, which begins at a multiple of 4 and must outlive the firmware;
   * NULL: there is no curve */
  void *curve_memory;
  uint32_t curve_bytes;    /* FW_CURVE_BYTES on the host */
  const fw_slots_t *slots; /* NULL: the firmware cannot be updated in operation */
} fw_config_t;

/* The head of an update, in front of the image; numbers are little-endian. */
typedef struct {
  uint32_t magic;          /* UPDATE_MAGIC */
  uint32_t address;        /* address for which the image is linked */
  uint32_t length;         /* length of the image in bytes; a multiple of 4 */
  uint32_t crc;            /* CRC-32 of the image */
  uint32_t table;          /* AXIS_OBJECTS_HASH32 of the image */
  uint32_t replaced_table; /* AXIS_OBJECTS_HASH32 of the axis for which the update is */
  char board[16];          /* name of the board, as in identity.h */
  char version[16];
  uint32_t unused;
  uint32_t head_crc; /* CRC-32 of the bytes before */
} update_head_t;

enum { UPDATE_HEAD_BYTES = sizeof(update_head_t) };

typedef struct {
  update_head_t head;
  uint32_t size;         /* announced number of bytes, 0: none */
  uint32_t received;     /* number of bytes */
  uint32_t crc;          /* CRC-32 of the bytes of the image programmed so far */
  uint32_t tick;         /* tick of the last bytes */
  uint32_t sequence;     /* sequence number of the running image */
  uint32_t overrun_tick; /* tick of the last overrun */
  uint8_t word[4];       /* bytes of the word that is not complete */
  uint8_t is_receiving;
  uint8_t restart_ticks; /* ticks until the restart, 0: none */
} update_t;

/* Numbers that the parameter store keeps (results.h). */
typedef struct {
  uint32_t power_up; /* number of power-ups with programs */
  uint32_t number;   /* number of the last pressed part */
  uint32_t parts[CYCLE_PART_VERDICTS];
  uint32_t oldest_waiting; /* smallest number of a waiting result, 0: none; only in the store */
  uint32_t bad_in_row;     /* consecutive parts that are not good, at most UINT16_MAX */
} results_counts_t;

typedef struct {
  cycle_results_t waiting;
  cycle_part_t last; /* the last pressed part; number 0: none */
  results_counts_t counts;
  results_counts_t stored; /* counts that the store has, or is writing */
  uint32_t given_tick;     /* tick in which the counts were last given to the store */
  uint32_t starts;         /* cycle_count of the last cycle whose serial number was taken */
  uint32_t serial[CYCLE_SERIAL_WORDS]; /* serial number of the part in the running cycle */
  uint8_t changed;                     /* 1 if `counts` differ from `stored` */
  uint8_t urgent;                      /* 1 if they shall be stored at once */
  uint8_t has_power_up;                /* 1 if the store has the number of this power-up */
  uint8_t is_loaded;                   /* 1 after the counts were read from the store */
} results_t;

typedef struct {
  dictionary_t objects; /* The dictionary must be the first member of fw_t (dictionary.h). */
  axis_t axis;
  law_banks_t banks;
  recorder_t recorder;
  cia402_t drive;
  canopen_t canopen;
  modbus_t modbus;
  store_t store;
  archive_t archive;
  cycle_library_t library;
  results_t results;
  cycle_curve_t curve;
  update_t update;
  device_params_t device;
  device_signals_t device_signals;
  fw_config_t config;
  uint32_t source_silence; /* number of ticks since the last write of the owner */
  uint32_t ticks_alone;    /* number of ticks since the last call of fw_between() */
  uint32_t curve_cycle;    /* cycle_count of the cycle of the curve */
  uint32_t parts_tick;     /* tick of the last piece of a program (programs.h) */
  /* tick in which each rate-limited emergency message (FF01h to FF04h) was last sent */
  uint32_t reported_tick[FW_HELD];
  uint8_t reported[FW_HELD]; /* 1 if this rate-limited emergency message was sent since power-up */
  /* state of contact, force law and calibration at the last call of reports_contact() */
  uint8_t contact_seen;
  /* 1 while the tare measurement writes force_tare, which does not reset the date 1020h */
  uint8_t tare_is_written;
  uint8_t on_serial;    /* 1 while a write from the serial line is executed */
  uint8_t owner_on_can; /* 1 if the owner reaches the axis over CAN (ownership.h) */
  /* 1 if the black box uses the recorder buffer; 0 if the recorder uses this buffer (incident.h) */
  uint8_t boxed;
  uint8_t has_parts; /* 1 while a client sends a program in pieces (programs.h) */
  uint8_t live;      /* 1 if fw_tick() also computes the drive and the protocols */
} fw_t;

/* Initialises the firmware at power-up: parameters have their stored values or their defaults, the
 * axis is disabled, and the recorder is idle. */
void fw_init(fw_t *fw, const fw_config_t *config);

/* Computes one tick of drive, axis, recorder and protocols. A firmware on no bus computes only axis
 * and recorder, with the same outputs, until an object that belongs to neither of them is accessed.
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
 * and the code for the board outputs them immediately. fw_report() does what most ticks need:
 * status of the drive, recorder, one event-driven TPDO. fw_between() must run after the interrupt,
 * before any other use of fw, and no tick may interrupt it. fw_between() does the rare and long
 * work: emergency messages, node timers that expire, the silent interval of Modbus, resets (which
 * can last longer than a tick), and a step of the store (an erase can, too). Cost on a Cortex-M4:
 * docs/chip/instructions.md.
 *
 * While fw_between() does not run, a lost heartbeat and NMT commands are not detected. After more
 * than FW_BETWEEN_TICKS_MAX ticks without fw_between(), fw_prepare() disables the axis with the
 * fault main_loop_lost, and fw_report() returns false: the caller must then not restart the
 * watchdog timer of the board. */
void fw_prepare(fw_t *fw);
void fw_control(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs);
bool fw_report(fw_t *fw);
void fw_between(fw_t *fw);

/* CAN. fw_can_receive() accepts a received frame before the tick that processes this frame.
 * fw_can_transmit() returns a frame to send; the result false means that there is no frame.
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

/* Modbus RTU. fw_modbus_receive() accepts received bytes. fw_modbus_transmit() writes at most
 * `room` bytes to send into `bytes` and returns the number of these bytes, or 0. */
void fw_modbus_receive(fw_t *fw, const uint8_t *bytes, uint16_t count);
uint16_t fw_modbus_transmit(fw_t *fw, uint8_t *bytes, uint16_t room);

/* Reports a late tick (`missed` is 0) or `missed` ticks that did not run. `overruns` counts each of
 * these ticks. tick_count and the timers of the CANopen node (canopen_missed()) advance by the
 * missed ticks. Call fw_overrun() after fw_between(), not in the interrupt. */
void fw_overrun(fw_t *fw, uint32_t missed);

/* Accepts the errors that the board has detected in its own hardware, as a set of AXIS_BOARD_STATE_
 * bits, and the deviation of the tick length from a second clock in 1/1000. Call fw_board() between
 * fw_prepare() and fw_control(). It disables the axis in that tick with one of the faults
 *   board_unfit   OPTION_BYTES, IMAGE, RAM, CONVERTER, which are detected at power-up
 *   supply_wrong  SUPPLY, REFERENCE
 *   clock_wrong   TICK
 *   output_wrong  DAC, ENABLE
 * as long as the error is detected; the other bits are only reported. board_state keeps the
 * detected errors until the axis has no fault. */
void fw_board(fw_t *fw, uint16_t state, int16_t tick_deviation);

/* Accepts the time that a tick took and by how much it began late, in us, or the greatest ones of
 * several ticks. tick_time_max and tick_late_max keep the greatest ones. Call fw_tick_times()
 * between two ticks. */
void fw_tick_times(fw_t *fw, uint16_t time_us, uint16_t late_us);

/* The code for the board reads and writes objects with these functions, which return what
 * dictionary_read() and dictionary_write() return. If the firmware is on no bus, a write to an
 * object that belongs neither to the axis nor to the recorder starts the drive. */
int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value);
int fw_object_write(fw_t *fw, uint8_t source, uint16_t object, int32_t value);

/* Selects the program of the cycles of mode -9, a record that begins at a multiple of 4 and stays
 * unchanged while the firmware has it. Returns what cycle_program_check() found, or CYCLE_BUSY
 * while a cycle runs; the program before then stays selected. After a reset of the node there is
 * none. The record is not in the library, so it may have the number 0, and cycle_program is 0. A
 * simulation and a test bench select so; a client of a bus downloads (programs.h). */
cycle_check_t fw_select_program(fw_t *fw, const void *record, uint32_t size);

/* Reads one sample of a completed recording; index 0 is the oldest sample. `values` receives one
 * value for each selected channel in the order of recorder_signal_1 to _8; channels that are 0 have
 * no value. Returns the number of values, or FW_ERROR_NO_DATA. */
int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]);

#endif
