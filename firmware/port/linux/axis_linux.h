#ifndef FIRMWARE_PORT_LINUX_AXIS_LINUX_H_
#define FIRMWARE_PORT_LINUX_AXIS_LINUX_H_

/* The port to Linux: the axis is a real-time process on a PC or a single-board computer. Its drive
 * is a CiA 402 drive on one CAN interface. The force comes from a load cell on the same CAN bus, or
 * from a converter of this computer (iio.h). The supervisor is on another CAN interface. README.md
 * beside this file describes how to prepare the computer.
 *
 * A thread with real-time priority computes the ticks at absolute times of the monotonic clock. If
 * a tick is late by n whole ticks, it is counted as an overrun of n ticks. If a tick is late by
 * more than late_ticks_max ticks, an enabled axis is also disabled with the fault clock_wrong
 * (AXIS_BOARD_STATE_TICK). This process has no watchdog timer. Instead, the drive monitors its
 * heartbeat and stops by itself if the heartbeat is missing (1016h, 6007h). */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive402/drive402.h"
#include "firmware/port/linux/iio.h"
#include "firmware/port/linux/load_cell.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const char *supervisor_can; /* name of the CAN interface of the supervisor */
  const char *drive_can;      /* name of the CAN interface of the drive and the load cell */
  const char *store_path;     /* file of the stored parameters; NULL: nothing is stored */
  const char *archive_path;   /* file of the archive of incidents; NULL: no incident is kept */
  drive402_config_t drive;
  /* load cell on the bus of the drive; if its CAN identifier is 0, there is no load cell */
  load_cell_t load_cell;
  /* converter that measures the force; if its device is NULL, there is no converter. The axis needs
   * either a load cell or a converter */
  iio_settings_t iio;
  /* 0: the axis runs. Otherwise the process only measures, for this number of seconds, how late its
   * ticks are. It opens no interface and no file, and ends with the report. */
  uint32_t lateness_s;
  uint32_t late_ticks_max; /* largest number of ticks by which a tick may be late without a fault */
  /* priority of the tick thread under SCHED_FIFO, 1..99; 0: ordinary scheduling, and the memory is
   * not locked */
  int priority;
  int cpu;         /* number of the CPU on which the ticks run; -1: any CPU */
  uint8_t node_id; /* node id of the axis on the bus of the supervisor, 1..127 */
} axis_linux_config_t;

/* Runs the axis until SIGTERM or SIGINT; then stops the drive, writes a line of JSON with the
 * lateness of the ticks to standard output, and ends the process with status 0. Returns a text with
 * the error if the axis cannot be started. *config must exist as long as the process. */
const char *axis_linux_run(const axis_linux_config_t *config);

#ifdef __cplusplus
}
#endif

#endif
