#ifndef FIRMWARE_PORT_LINUX_AXIS_LINUX_H_
#define FIRMWARE_PORT_LINUX_AXIS_LINUX_H_

/* The port to Linux: the axis as a real-time process on a PC or a single-board computer. The drive
 * is a CiA 402 drive on one CAN interface, the force comes from a load cell on the same bus or from
 * a converter of this machine (iio.h), and the supervisor is on another CAN interface. README.md
 * beside this file says how to prepare the machine.
 *
 * A thread with real-time priority computes the ticks at absolute times of the monotonic clock. A
 * tick that is late by whole ticks is counted as an overrun of so many ticks. A tick that is late
 * by more than late_ticks_max ticks also disables an enabled axis with the fault of a wrong tick
 * (AXIS_BOARD_STATE_TICK). There is no watchdog but that of the drive: without the heartbeat of
 * this process, the drive stops by itself (1016h, 6007h). */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive402/drive402.h"
#include "firmware/port/linux/iio.h"
#include "firmware/port/linux/load_cell.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const char *supervisor_can; /* name of the interface of the supervisor */
  const char *drive_can;      /* name of the interface of the drive and the load cell */
  const char *store_path;     /* file of the stored parameters; NULL: nothing is stored */
  const char *archive_path;   /* file of the archive of incidents; NULL: no incident is kept */
  drive402_config_t drive;
  load_cell_t load_cell; /* identifier 0: there is none */
  iio_settings_t iio;    /* converter that measures the force; device NULL: there is none. Either
                          * a load cell or a converter is needed */
  /* 0: the axis runs. Otherwise it only measures for so many seconds how late ticks are: it opens
   * no interface and no file, and ends with the report. */
  uint32_t lateness_s;
  uint32_t late_ticks_max; /* largest delay of a tick, in ticks, that causes no fault */
  int priority;            /* priority of the tick under SCHED_FIFO, 1..99; 0: ordinary scheduling,
                            * memory not locked */
  int cpu;                 /* number of the CPU on which the ticks run; -1: any CPU */
  uint8_t node_id;         /* node id of the axis on the bus of the supervisor, 1..127 */
} axis_linux_config_t;

/* Runs the axis until SIGTERM or SIGINT; then stops the drive, writes a line of JSON with the
 * lateness of the ticks to standard output, and ends the process with status 0. Returns a text with
 * the error if the axis cannot be started. *config must exist as long as the process. */
const char *axis_linux_run(const axis_linux_config_t *config);

#ifdef __cplusplus
}
#endif

#endif
