/* The functions of firmware/port/stm32/can.h for the CAN controllers of this chip (bxCAN). */

#include <stddef.h>

#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/can.h"

enum { PIN_RX = 8, PIN_TX = 9, FUNCTION_CAN1 = 9 };
enum { DRIVE_PIN_RX = 5, DRIVE_PIN_TX = 6, FUNCTION_CAN2 = 9 };

/* Bit timing of CAN. A bit has 14 quanta; at 1000 kbit/s a quantum is 3 cycles of 42 MHz. With an
 * external clock the sample point is after 12 quanta, at 86 % of the bit (CiA 301: 87.5 %). The
 * clocks of two nodes may then differ by 1.1 %, which is far more than the difference of two
 * crystals. The internal oscillator has an error of 1 %, so three quanta for resynchronisation are
 * needed after the sample point. Its sample point is at 79 %, and the clock of a node with a
 * crystal may differ by 1.7 %. */
#define QUANTA 14u
#define BIT_TIMING (CAN_BTR_TS1_11 | CAN_BTR_TS2_2 | CAN_BTR_SJW_2)
#define BIT_TIMING_INTERNAL (CAN_BTR_TS1_10 | CAN_BTR_TS2_3 | CAN_BTR_SJW_3)

/* Mode of the CAN controller. It sends frames in the order in which they were written to the
 * mailboxes, and repeats a failed frame. If the FIFO is full, the received frames in the FIFO are
 * kept. The controller does not leave bus off by itself, and does not sleep. */
#define MODE (CAN_MCR_TXFP | CAN_MCR_RFLM)

static uint32_t prescaler_of(uint16_t kbit_s) { return CLOCK_APB1_HZ / (QUANTA * 1000u * kbit_s); }

void can_controller_enter(can_line_t *line) { line->registers->MCR = MODE | CAN_MCR_INRQ; }

bool can_controller_has_entered(const can_line_t *line) {
  return (line->registers->MSR & CAN_MSR_INAK) != 0;
}

void can_controller_join(can_line_t *line) {
  line->registers->BTR = (clock_is_external() ? BIT_TIMING : BIT_TIMING_INTERNAL) |
                         CAN_BTR_BRP(prescaler_of(line->kbit_s));
  line->registers->IER = CAN_IER_FMPIE0 | (line->reports_sent ? CAN_IER_TMEIE : 0);
  line->registers->MCR = MODE;
}

/* Returns true if the controller has joined the bus. After bus off it must see 128 sequences of 11
 * recessive bits: the first sequence ends the initialisation, and the last one ends bus off. */
bool can_controller_has_joined(const can_line_t *line) {
  return (line->registers->MSR & CAN_MSR_INAK) == 0 && (line->registers->ESR & CAN_ESR_BOFF) == 0;
}

uint8_t can_controller_bus(const can_line_t *line) {
  const uint32_t errors = line->registers->ESR;
  if ((errors & CAN_ESR_BOFF) != 0) {
    return CAN_BUS_OFF;
  }
  return ((errors & CAN_ESR_EPVF) != 0) ? CAN_BUS_PASSIVE : CAN_BUS_ACTIVE;
}

/* Sets the filters of both CAN controllers. The first filter of each controller puts every frame
 * with an 11-bit identifier into FIFO 0 of the controller. While filters are set neither controller
 * receives, so they are set only once. */
static void set_filters(void) {
  const uint32_t scale = CAN_FS1R_FSC0 | CAN_FS1R_FSC14;
  const uint32_t active = CAN_FA1R_FACT0 | CAN_FA1R_FACT14;
  CAN1->FMR = (CAN1->FMR & ~CAN_FMR_CAN2SB) | CAN_FMR_CAN2SB_14 | CAN_FMR_FINIT;
  CAN1->FA1R = 0;
  CAN1->FM1R = 0;
  CAN1->FS1R = scale;
  CAN1->FFA1R = 0;
  CAN1->F0R1 = 0;
  CAN1->F0R2 = CAN_RI0R_IDE;
  CAN1->F14R1 = 0;
  CAN1->F14R2 = CAN_RI0R_IDE;
  CAN1->FA1R = active;
  CAN1->FMR &= ~CAN_FMR_FINIT;
}

void can_controller_connect_axis(void) {
  set_bits(&RCC->APB1ENR, RCC_APB1ENR_CAN1EN);
  pin_alternate(GPIOB, PIN_RX, FUNCTION_CAN1, PIN_PULL_UP);
  pin_alternate(GPIOB, PIN_TX, FUNCTION_CAN1, PIN_PULL_NONE);
  pin_speed(GPIOB, PIN_TX, PIN_SPEED_MEDIUM);
  NVIC->IPR5 = FIELD(0, 8, PRIORITY_BUS);
  NVIC->ISER0 = BIT(IRQ_CAN1_RX0);
  set_filters();
}

void can_controller_connect_drive(void) {
  set_bits(&RCC->APB1ENR, RCC_APB1ENR_CAN2EN);
  pin_alternate(GPIOB, DRIVE_PIN_RX, FUNCTION_CAN2, PIN_PULL_UP);
  pin_alternate(GPIOB, DRIVE_PIN_TX, FUNCTION_CAN2, PIN_PULL_NONE);
  pin_speed(GPIOB, DRIVE_PIN_TX, PIN_SPEED_MEDIUM);
  NVIC->IPR15 = FIELD(24, 8, PRIORITY_BUS);
  NVIC->IPR16 = FIELD(0, 8, PRIORITY_BUS);
  NVIC->ISER1 = BIT(IRQ_CAN2_TX - 32);
  NVIC->ISER2 = BIT(IRQ_CAN2_RX0 - 64);
}

bool can_controller_is_empty(const can_line_t *line) {
  const uint32_t empty = CAN_TSR_TME0 | CAN_TSR_TME1 | CAN_TSR_TME2;
  return (line->registers->TSR & empty) == empty;
}

bool can_controller_abort(can_line_t *line) {
  line->registers->TSR = CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2;
  return true;
}

bool can_controller_lost(can_line_t *line) {
  const bool is_lost = (line->registers->RF0R & CAN_RF0R_FOVR0) != 0;
  if (is_lost) {
    line->registers->RF0R = CAN_RF0R_FOVR0;
  }
  return is_lost;
}

static void unpack(uint8_t *bytes, uint32_t word) {
  for (uint8_t i = 0; i < 4; i++) {
    bytes[i] = (uint8_t)(word >> (8 * i));
  }
}

static uint32_t pack(const uint8_t *bytes) {
  return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
         (uint32_t)bytes[3] << 24;
}

bool can_controller_take(can_line_t *line, can_frame_t *frame) {
  if ((line->registers->RF0R & CAN_RF0R_FMP0) == 0) {
    return false;
  }
  if (frame != NULL) {
    const uint32_t length = line->registers->RDT0R & CAN_RDT0R_DLC;
    frame->id = (uint16_t)(line->registers->RI0R >> 21);
    frame->remote = ((line->registers->RI0R & CAN_RI0R_RTR) != 0) ? 1 : 0;
    /* CAN permits a length code above 8. Such a code means 8 bytes. */
    frame->length = (uint8_t)((length > 8) ? 8 : length);
    unpack(&frame->data[0], line->registers->RDL0R);
    unpack(&frame->data[4], line->registers->RDH0R);
  }
  line->registers->RF0R = CAN_RF0R_RFOM0;
  /* Waits until the FIFO has released the frame that was read. Before that, the FIFO would show the
   * same frame again. */
  for (uint8_t polls = 0; polls < 8 && (line->registers->RF0R & CAN_RF0R_RFOM0) != 0; polls++) {
  }
  return true;
}

bool can_controller_send(can_line_t *line, const can_frame_t *frame) {
  static const uint32_t empty[] = {CAN_TSR_TME0, CAN_TSR_TME1, CAN_TSR_TME2};
  const uint32_t status = line->registers->TSR;
  for (uint8_t i = 0; i < 3; i++) {
    if ((status & empty[i]) != 0) {
      reg_t *box = &line->registers->TI0R + 4 * i;
      const uint32_t head = CAN_TI0R_STID(frame->id) | ((frame->remote != 0) ? CAN_TI0R_RTR : 0);
      box[0] = head;
      box[1] = frame->length;
      box[2] = pack(&frame->data[0]);
      box[3] = pack(&frame->data[4]);
      box[0] = head | CAN_TI0R_TXRQ;
      return true;
    }
  }
  return false;
}

void can_controller_note_sent(can_line_t *line) {
  /* writing 1 to one of these bits of TSR clears it */
  line->registers->TSR = CAN_TSR_RQCP0 | CAN_TSR_RQCP1 | CAN_TSR_RQCP2;
}
