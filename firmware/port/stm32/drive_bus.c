/* Connects a CiA 402 drive on the second CAN to the axis. The drive replaces the DAC and the
 * encoder. firmware/port/bus_drive.h converts between the axis and the drive. */

#include "firmware/port/bus_drive.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/can.h"

/* Number of frames that can wait for an empty mailbox; it must be a power of 2. In a bus cycle the
 * master sends at most 6 frames: SYNC, RPDO, a heartbeat, a quick stop, and an SDO request in each
 * of two ticks. */
enum { WAITING = 8 };

/* ADC code of torque 0 if adc_bits is 16. */
enum { TORQUE_MIDDLE = 32768 };

static can_line_t line;
static bus_drive_t drive;
static drive402_config_t config;
static bool is_fitted;
static bool has_begun; /* true: the ticks of the master have begun */

static can_frame_t waiting[WAITING];
/* index in `waiting` of the next frame to store; only the tick writes it */
static volatile uint8_t waiting_in;
/* index in `waiting` of the next frame to send; only the interrupt writes it */
static volatile uint8_t waiting_out;
static volatile bool is_stuck; /* true: the interrupt must discard all frames of `waiting` */

void drive_bus_start(const device_params_t *params) {
  is_fitted = bus_drive_config(params, &config);
  if (!is_fitted) {
    return;
  }
  /* If the configuration is refused, the master itself reports the reason. */
  (void)bus_drive_init(&drive, &config);
  if (!io_clock_is_right()) {
    line.reported = CAN_BUS_OFF;
    return;
  }
  can_controller_connect_drive();
  can_line_start(&line, CAN_OF_DRIVE, true, params->drive_bit_rate);
}

bool drive_bus_is_fitted(void) { return is_fitted; }

void drive_bus_sample(axis_inputs_t *inputs) {
  can_frame_t frame;
  for (uint8_t i = 0; i < CAN_LINE_RING && can_line_receive(&line, &frame); i++) {
    drive402_receive(&drive.master, &frame);
  }
  drive402_bus(&drive.master, can_line_bus(&line), can_line_lost(&line));
  bus_drive_sample(&drive, inputs);
  const drive402_feedback_t feedback = drive402_feedback(&drive.master);
  const uint8_t bits = port_firmware()->axis.params.adc_bits;
  inputs->adc_code[1] = (uint16_t)((uint32_t)(feedback.torque + TORQUE_MIDDLE) >> (16 - bits));
  device_signals_t *signals = &port_firmware()->device_signals;
  signals->drive_reason = feedback.reason;
  signals->drive_error_code = feedback.error_code;
  signals->drive_failed_object = (uint32_t)feedback.failed_index << 8 | feedback.failed_sub;
  signals->drive_abort_code = feedback.abort_code;
}

/* Adds a frame to `waiting` and requests the interrupt. Only the interrupt writes mailboxes, and
 * only the tick changes the state of the CAN line. The interrupt comes again when a mailbox is
 * empty. */
static void send(const can_frame_t *frame) {
  if ((uint8_t)(waiting_in - waiting_out) >= WAITING) {
    can_line_give_up(&line);
    is_stuck = true;
    request_sent_interrupt();
    return;
  }
  waiting[waiting_in % WAITING] = *frame;
  BARRIER();
  waiting_in++;
  request_sent_interrupt();
}

void drive_bus_act(const axis_outputs_t *outputs) {
  can_frame_t frame;
  /* The first frame resets the drive, so the master waits until the controller has joined the bus,
   * or cannot join it. */
  has_begun = has_begun || line.state == CAN_LINE_RUNNING || line.reported == CAN_BUS_OFF;
  if (!has_begun) {
    return;
  }
  bus_drive_act(&drive, outputs);
  while (drive402_transmit(&drive.master, &frame)) {
    send(&frame);
  }
}

void drive_bus_interrupt(void) {
  can_line_take(&line);
  HANDLER_END();
}

/* Writes waiting frames into empty mailboxes. While the controller is off the bus, or while no node
 * acknowledges its frames, the waiting frames are discarded, because they would be too old
 * later. */
static void fill_mailboxes(void) {
  if (is_stuck || line.state != CAN_LINE_RUNNING) {
    is_stuck = false;
    waiting_out = waiting_in;
    return;
  }
  while (waiting_out != waiting_in && can_line_send(&line, &waiting[waiting_out % WAITING])) {
    waiting_out++;
  }
}

void drive_bus_sent_interrupt(void) {
  can_controller_note_sent(&line);
  fill_mailboxes();
  HANDLER_END();
}
