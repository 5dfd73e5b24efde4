#include "firmware/port/stm32f4/can.h"

#include "firmware/port/port.h"
#include "firmware/port/stm32f4/barrier.h"
#include "firmware/port/stm32f4/board.h"

enum { PIN_RX = 8, PIN_TX = 9, FUNCTION_CAN1 = 9 };

/* Longest time in ticks in which the CAN controller must join the bus, before the initialisation is
 * repeated: 1500 ticks (one second) plus 9 ticks for each step of the prescaler. A node joins the
 * bus after 11 recessive bits. After bus off the controller waits for 128 sequences of 11 recessive
 * bits, only in normal mode (RM0090 32.7.6). On an idle bus this takes 2.2 ticks at 1 Mbit/s. On a
 * full bus each frame of at most 135 bits has only one such sequence, so 128 sequences take 9 ticks
 * for each step of the prescaler. */
enum { PATIENCE_TICKS = 1500, PATIENCE_TICKS_OF_PRESCALER = 9 };

/* Number of ticks (100 ms) after which a frame that an error passive node could not send is too
 * old. Three of the longest frames take 41 ms at 10 kbit/s. */
enum { STALE_TICKS = 150 };

/* Bit timing of CAN. A bit has 14 quanta; at 1000 kbit/s a quantum is 3 cycles of 42 MHz. With an
 * external clock the sample point is after 12 quanta, at 86 % of the bit (CiA 301: 87.5 %): the
 * clocks of two nodes may then differ by 1.1 %, far more than crystals do. The internal oscillator
 * has an error of 1 % and needs three quanta for resynchronisation after the sample point: the
 * sample point is at 79 %, and a node with a crystal may differ by 1.7 %. */
#define QUANTA 14u
#define BIT_TIMING (CAN_BTR_TS1_11 | CAN_BTR_TS2_2 | CAN_BTR_SJW_2)
#define BIT_TIMING_INTERNAL (CAN_BTR_TS1_10 | CAN_BTR_TS2_3 | CAN_BTR_SJW_3)

/* Mode of the CAN controller: it sends frames in the order of their arrival, keeps the received
 * frames of a full FIFO, repeats a failed frame, does not return from bus off by itself, and does
 * not sleep. */
#define MODE (CAN_MCR_TXFP | CAN_MCR_RFLM)

static can_line_t bus;

static uint32_t prescaler_of(uint16_t kbit_s) { return CLOCK_APB1_HZ / (QUANTA * 1000u * kbit_s); }

void can_line_abort(can_line_t *line) {
  line->registers->TSR = CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2;
}

static void enter_initialisation(can_line_t *line) {
  line->registers->MCR = MODE | CAN_MCR_INRQ;
  line->state = CAN_LINE_ENTERING;
  line->waited_ticks = 0;
}

void can_line_start(can_line_t *line, can_t *registers, uint32_t interrupts, uint16_t kbit_s) {
  line->registers = registers;
  line->interrupts = interrupts;
  line->prescaler = prescaler_of(kbit_s);
  enter_initialisation(line);
}

/* Sets the bit timing, which can only be written during initialisation, and joins the bus. */
static void configure_and_join(can_line_t *line) {
  line->registers->BTR =
      (clock_is_external() ? BIT_TIMING : BIT_TIMING_INTERNAL) | CAN_BTR_BRP(line->prescaler);
  line->registers->IER = line->interrupts;
  line->registers->MCR = MODE;
  line->state = CAN_LINE_JOINING;
  line->waited_ticks = 0;
}

/* Sets the filters of both controllers. The first filter of each accepts every frame with an 11-bit
 * identifier into its FIFO 0. While filters are set no controller receives, so this is done once.
 */
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

void can_init(bool clock_is_right) {
  if (!clock_is_right) {
    bus.reported = CAN_BUS_OFF;
    return;
  }
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOBEN;
  RCC->APB1ENR |= RCC_APB1ENR_CAN1EN;
  (void)RCC->APB1ENR;
  pin_alternate(GPIOB, PIN_RX, FUNCTION_CAN1, PIN_PULL_UP);
  pin_alternate(GPIOB, PIN_TX, FUNCTION_CAN1, PIN_PULL_NONE);
  pin_speed(GPIOB, PIN_TX, PIN_SPEED_MEDIUM);
  NVIC->IPR5 = FIELD(0, 8, PRIORITY_BUS);
  NVIC->ISER0 = BIT(IRQ_CAN1_RX0);
  set_filters();
  can_line_start(&bus, CAN1, CAN_IER_FMPIE0, 1000);
}

/* Aborts frames that are too old. If no other node acknowledges the frames of an error passive
 * node, they stay in the mailboxes and are aborted after STALE_TICKS. Meanwhile can_line_send()
 * accepts further frames, which are lost too. */
static void give_up_stale(can_line_t *line) {
  const uint32_t empty = CAN_TSR_TME0 | CAN_TSR_TME1 | CAN_TSR_TME2;
  if (line->reported != CAN_BUS_PASSIVE || (line->registers->TSR & empty) == empty) {
    line->stalled_ticks = 0;
  } else if (line->stalled_ticks < STALE_TICKS) {
    line->stalled_ticks++;
  } else {
    can_line_abort(line);
  }
}

uint8_t can_line_bus(can_line_t *line) {
  switch (line->state) {
    case CAN_LINE_RUNNING: {
      const uint32_t errors = line->registers->ESR;
      line->reported = ((errors & CAN_ESR_EPVF) != 0) ? CAN_BUS_PASSIVE : CAN_BUS_ACTIVE;
      give_up_stale(line);
      if ((errors & CAN_ESR_BOFF) != 0) {
        line->reported = CAN_BUS_OFF;
        can_line_abort(line);
        enter_initialisation(line);
      }
      break;
    }
    case CAN_LINE_ENTERING:
      if ((line->registers->MSR & CAN_MSR_INAK) != 0) {
        configure_and_join(line);
      } else {
        line->waited_ticks++;
      }
      break;
    case CAN_LINE_JOINING:
      /* Bus off needs 128 sequences of 11 recessive bits: the first sequence ends the
       * initialisation, the last one ends bus off. */
      if ((line->registers->MSR & CAN_MSR_INAK) == 0 &&
          (line->registers->ESR & CAN_ESR_BOFF) == 0) {
        line->state = CAN_LINE_RUNNING;
      } else {
        line->waited_ticks++;
      }
      break;
    default:
      break;
  }
  if (line->state != CAN_LINE_RUNNING &&
      line->waited_ticks >= PATIENCE_TICKS + PATIENCE_TICKS_OF_PRESCALER * line->prescaler) {
    line->reported = CAN_BUS_OFF;
    enter_initialisation(line);
  }
  return line->reported;
}

void can_line_rate(can_line_t *line, uint16_t kbit_s) {
  const uint32_t wanted = prescaler_of(kbit_s);
  if (line->state == CAN_LINE_STOPPED || wanted == line->prescaler) {
    return;
  }
  line->prescaler = wanted;
  can_line_abort(line);
  enter_initialisation(line);
}

uint16_t can_line_lost(can_line_t *line) {
  if (line->state == CAN_LINE_STOPPED) {
    return 0;
  }
  uint16_t lost = (uint16_t)(line->dropped - line->dropped_reported);
  line->dropped_reported = (uint16_t)(line->dropped_reported + lost);
  /* The controller does not count lost frames, but at least one frame was lost. */
  if ((line->registers->RF0R & CAN_RF0R_FOVR0) != 0) {
    line->registers->RF0R = CAN_RF0R_FOVR0;
    lost++;
  }
  return lost;
}

bool can_line_receive(can_line_t *line, can_frame_t *frame) {
  if (line->ring_out == line->ring_in) {
    return false;
  }
  BARRIER();
  *frame = line->ring[line->ring_out % CAN_LINE_RING];
  BARRIER();
  line->ring_out++;
  return true;
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

void can_line_take(can_line_t *line) {
  if ((line->registers->RF0R & CAN_RF0R_FMP0) == 0) {
    return;
  }
  if ((uint8_t)(line->ring_in - line->ring_out) < CAN_LINE_RING) {
    can_frame_t *frame = &line->ring[line->ring_in % CAN_LINE_RING];
    const uint32_t length = line->registers->RDT0R & CAN_RDT0R_DLC;
    frame->id = (uint16_t)(line->registers->RI0R >> 21);
    frame->remote = ((line->registers->RI0R & CAN_RI0R_RTR) != 0) ? 1 : 0;
    /* CAN permits a length code above 8, which means 8 bytes. */
    frame->length = (uint8_t)((length > 8) ? 8 : length);
    unpack(&frame->data[0], line->registers->RDL0R);
    unpack(&frame->data[4], line->registers->RDH0R);
    BARRIER();
    line->ring_in++;
  } else {
    line->dropped++;
  }
  line->registers->RF0R = CAN_RF0R_RFOM0;
  /* Wait until the FIFO has released the frame that was read. Before the release, the FIFO would
   * show this frame again. */
  for (uint8_t polls = 0; polls < 8 && (line->registers->RF0R & CAN_RF0R_RFOM0) != 0; polls++) {
  }
}

bool can_line_send(can_line_t *line, const can_frame_t *frame) {
  static const uint32_t empty[] = {CAN_TSR_TME0, CAN_TSR_TME1, CAN_TSR_TME2};
  if (line->state != CAN_LINE_RUNNING) {
    return false;
  }
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
  return line->stalled_ticks >= STALE_TICKS;
}

uint8_t port_can_bus(void) { return can_line_bus(&bus); }

void port_can_rate(uint16_t kbit_s) { can_line_rate(&bus, kbit_s); }

uint16_t port_can_lost(void) { return can_line_lost(&bus); }

bool port_can_receive(can_frame_t *frame) { return can_line_receive(&bus, frame); }

bool port_can_transmit(const can_frame_t *frame) { return can_line_send(&bus, frame); }

void can_interrupt(void) { can_line_take(&bus); }
