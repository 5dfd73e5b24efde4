#ifndef FIRMWARE_APP_FW_STATE_H_
#define FIRMWARE_APP_FW_STATE_H_

/* The state of the firmware (fw.h) and its configuration. All files of this folder share this
 * state. */

#include <stdint.h>

#include "firmware/app/update_state.h"
#include "firmware/canopen/node.h"
#include "firmware/core/axis.h"
#include "firmware/core/blackbox.h"
#include "firmware/core/law_bank.h"
#include "firmware/core/recorder.h"
#include "firmware/cycle/curve.h"
#include "firmware/cycle/library.h"
#include "firmware/cycle/results.h"
#include "firmware/drive/drive_state.h"
#include "firmware/modbus/server.h"
#include "firmware/objects/dictionary.h"
#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"
#include "firmware/storage/archive.h"
#include "firmware/storage/slots.h"
#include "firmware/storage/store.h"

/* Emergency messages about events that are no fault of the axis. store_failed: at power-up the
 * stored parameter set is not active or is not the newest set; the first manufacturer byte is
 * store_state. source_lost: the owner was lost and abort_connection_option selects no fault. FF01h
 * to FF04h are sent immediately and are then inhibited for FW_HOLD_TICKS; contact_losses,
 * force_saturated, limit_cycle and overruns still count. FF07h watchdog_reset, 6000h core_fault and
 * 5110h brownout_reset report the reset before this power-up: the first manufacturer byte is
 * reset_cause, and the next four bytes are core_fault_pc. */
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

/* The two flash slots for firmware images on a board whose firmware can be updated in operation
 * (update.h). */
typedef struct {
  const store_memory_t *memory; /* flash memory with one sector for each slot */
  uint32_t address[SLOTS];      /* for each slot, the address for which its image is linked */
  /* name of the board, which an update must contain too; 16 bytes, filled with zeros */
  const char *board;
  /* function that restarts the chip through its loader; it does not return */
  void (*restart)(void);
  uint8_t running; /* number of the slot that contains the running image; the image has a trailer */
} fw_slots_t;

/* Largest number of ticks between two calls of fw_between(): 15 ticks are 10 ms. */
enum { FW_BETWEEN_TICKS_MAX = 15 };

/* Node id of an axis that waits for an id from an LSS master. This axis answers only LSS requests
 * and has no Modbus unit. */
enum { FW_NODE_ID_BY_LSS = 255 };

/* Configuration of the firmware for fw_init(). If all fields are 0, the axis is on no bus. */
typedef struct {
  /* buffer of the recorder. It needs no alignment, and it must outlive the firmware. NULL is
   * permitted if recorder_bytes is 0 */
  void *recorder_buffer;
  uint32_t recorder_bytes;
  /* Memory of the black box; it needs no initial value. NULL if there is no black box. To keep an
   * incident over a restart, this memory and recorder_buffer must be in memory that a restart does
   * not clear. */
  blackbox_t *blackbox;
  const store_memory_t *memory; /* memory of the parameter store; NULL if no parameter is stored */
  /* memory of the archive; NULL if no incident is kept over a power cut */
  const store_memory_t *archive;
  /* text of the object hardware_version. It must outlive the firmware. NULL selects the text
   * "none" */
  const char *hardware;
  uint32_t serial_number;
  /* bit rate of the Modbus serial line in bit/s. It determines the silent interval that ends a
   * frame. 0 selects MODBUS_BAUD_DEFAULT */
  uint32_t modbus_baud;
  /* CANopen node id and number of the Modbus unit, 1 to 127. 0: the axis uses stored_node_id, or 1
   * if no id is stored. FW_NODE_ID_BY_LSS: the axis uses stored_node_id, or has no id until an LSS
   * master gives an id. */
  uint8_t node_id;
  uint8_t buses; /* 1 if the firmware serves CANopen and Modbus; 0 if the axis is on no bus */
  /* causes of the last reset, as a set of AXIS_RESET_CAUSE_ bits; 0 if no cause is known. A normal
   * power-up sets the bit POWER, and may also set BROWN_OUT and PIN. A fault of the processor core
   * sets SOFTWARE. */
  uint8_t reset_cause;
  /* text of the object software_version. It must outlive the firmware. NULL selects FW_VERSION and
   * the hash of the object table */
  const char *software;
  /* set of the CAN bit rates that the board supports (lss.h); 0 permits all bit rates */
  uint16_t bit_rates;
  /* largest value of dac_bits, 12 to 16, that the DAC of the board can output; 0 permits 16. This
   * limit does not apply to a drive on a bus */
  uint8_t dac_bits;
  /* registers of the processor core at the fault of the core that has caused the last reset; NULL:
   * no fault of the core has caused it */
  const fw_core_fault_t *core_fault;
  /* memory for cycle programs: a staging area of CYCLE_PROGRAM_BYTES_MAX bytes, then the library.
   * Its address is a multiple of 4, and it must outlive the firmware. NULL: no program can be
   * downloaded */
  void *program_memory;
  uint32_t program_bytes; /* size of program_memory in bytes; FW_PROGRAM_BYTES on the host */
  /* memory for FW_RESULTS results (cycle_part_t) that wait for an acknowledgement. Its address is a
   * multiple of 4, and it must outlive the firmware. NULL: only the last result is kept, and no
   * cycle waits for an acknowledgement */
  void *result_memory;
  uint32_t result_bytes;
  /* memory for the curve of a cycle. Its address is a multiple of 4, and it must outlive the
   * firmware. NULL: no curve is recorded */
  void *curve_memory;
  uint32_t curve_bytes; /* size of curve_memory in bytes; FW_CURVE_BYTES on the host */
  /* slots of the firmware images; NULL: the firmware cannot be updated in operation */
  const fw_slots_t *slots;
} fw_config_t;

/* Counts of pressed parts (results.h); the parameter store keeps them. */
typedef struct {
  uint32_t power_up; /* number of power-ups at which the axis had cycle programs */
  uint32_t number;   /* number of the last pressed part */
  uint32_t parts[CYCLE_PART_VERDICTS];
  /* smallest number of a pressed part whose result waits for its acknowledgement; 0: no result
   * waits. This field is set only in the stored counts */
  uint32_t oldest_waiting;
  uint32_t bad_in_row; /* number of consecutive bad or aborted pressed parts, at most UINT16_MAX */
} results_counts_t;

typedef struct {
  cycle_results_t waiting;
  cycle_part_t last; /* result of the last pressed part; its number is 0 if no part was pressed */
  results_counts_t counts;
  /* counts of pressed parts that the parameter store contains or is about to write */
  results_counts_t stored;
  /* tick in which the parameter store was last asked to write the counts of pressed parts */
  uint32_t given_tick;
  /* number (cycle_count) of the last cycle to which a serial number was assigned */
  uint32_t starts;
  uint32_t serial[CYCLE_SERIAL_WORDS]; /* serial number of the part in the running cycle */
  /* 1 if the counts of pressed parts differ from the counts in the parameter store */
  uint8_t changed;
  uint8_t urgent;       /* 1 if the counts of pressed parts must be stored at once */
  uint8_t has_power_up; /* 1 if the number of this power-up is stored */
  /* 1 after the counts of pressed parts were read from the parameter store */
  uint8_t is_loaded;
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
  uint32_t source_silence; /* number of ticks since the last write of the owner of the axis */
  uint32_t ticks_alone;    /* number of ticks since the last call of fw_between() */
  uint32_t curve_cycle;    /* number (cycle_count) of the cycle to which the curve belongs */
  uint32_t parts_tick;     /* tick in which the last piece of a cycle program was received
                            * (programs.h) */
  /* tick in which each rate-limited emergency message (FF01h to FF04h) was last sent */
  uint32_t reported_tick[FW_HELD];
  /* 1 for each rate-limited emergency message that was sent since power-up */
  uint8_t reported[FW_HELD];
  /* state of contact, force law and calibration at the last call of reports_contact() */
  uint8_t contact_seen;
  /* 1 while the tare measurement writes force_tare. Such a write does not reset the date of the
   * verified configuration (1020h) */
  uint8_t tare_is_written;
  uint8_t on_serial;    /* 1 while a write from the serial line is executed */
  uint8_t owner_on_can; /* 1 if the owner reaches the axis over CAN (ownership.h) */
  /* 1 if the black box uses the recorder buffer; 0 if the recorder uses this buffer (incident.h) */
  uint8_t boxed;
  uint8_t has_parts; /* 1 while a client sends a cycle program in pieces (programs.h) */
  uint8_t live;      /* 1 if fw_tick() also computes the drive and the protocols */
} fw_t;

#endif
